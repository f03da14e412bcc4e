//! Does a model leave structure? Every event beside one that the model would have had there.
//!
//! Behind each event of the recording one next event is drawn from the model, given the same light
//! and the pixel's same past. If the model is true the drawn one and the one that came are of one
//! law, whatever is known without the pixel's later events: the light, the pixel's past, the events
//! of its neighbours, its row, of all pixels, the camera's own frames. Trees that have not seen
//! them tell them apart as well as they can; what they gain over a coin is the structure left.

use super::boost::{Examples, FOLDS, Told, told_apart, told_apart_by};
use super::fit::Fitted;
use super::kinds::kinds_of_pixels;
use super::{Evidence, PixelEvidence, ProposedTerm, Where};
use crate::predict::{Spike, SpikeContext, next_events};
use evrig_core::stats::SplitMix;
use rayon::prelude::*;

/// Most events that are looked at, so that a long recording takes no longer.
const MOST: usize = 30_000;

/// A threshold is not told finer than this share of it: below lies the error of the light.
const FINEST: f64 = 0.2;

/// How far back neighbours' events are counted, microseconds.
const NEAR_US: i64 = 5_000;

/// How far back the pixel's own events are counted, microseconds.
const RECENT_US: i64 = 150_000;

/// What a feature is of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Of {
    /// The pixel's place, its own past, the time.
    Own,
    /// Its light.
    Light,
    /// Its neighbours, which see what it sees a little earlier or later.
    Around,
    /// The sensor as a whole.
    Sensor,
}

impl Of {
    /// Whether it is beside what a pixel's own light and past hold.
    const fn is_other(self) -> bool {
        matches!(self, Self::Around | Self::Sensor)
    }

    /// Whether an error of the light shows in it: where an edge comes later than it was taken to come, the
    /// neighbours have fired already.
    const fn is_by_light(self) -> bool {
        matches!(self, Self::Light | Self::Around)
    }
}

/// What an event is looked at by.
struct Feature {
    key: &'static str,
    of: Of,
    /// How a range of it is said.
    says: fn([f64; 2]) -> String,
}

const fn feature(key: &'static str, of: Of, says: fn([f64; 2]) -> String) -> Feature {
    Feature { key, of, says }
}

const FEATURES: [Feature; 16] = [
    feature("interval_us", Of::Own, |[a, b]| {
        format!("{a:.0} to {b:.0} us after the pixel's last event")
    }),
    feature("polarity_turned", Of::Own, |[a, _]| {
        format!(
            "of {} polarity to the pixel's last one",
            if a >= 0.5 { "opposite" } else { "equal" }
        )
    }),
    feature("polarity_on", Of::Own, |[a, _]| if a >= 0.5 { "On".into() } else { "Off".into() }),
    feature("innovation", Of::Light, |[a, b]| {
        format!("where the light has changed by {:.2} to {:.2} thresholds", a + 1.0, b + 1.0)
    }),
    feature("contrast_rate_per_s", Of::Light, |[a, b]| {
        format!("where log intensity changes by {a:.1} to {b:.1} a second")
    }),
    feature("log_intensity", Of::Light, |[a, b]| {
        format!("where the light is {:.0} to {:.0} % of white", a.exp() * 100.0, b.exp() * 100.0)
    }),
    feature("column", Of::Own, |[a, b]| format!("in columns {a:.0} to {b:.0}")),
    feature("row", Of::Own, |[a, b]| format!("in rows {a:.0} to {b:.0}")),
    feature("time_s", Of::Own, |[a, b]| format!("between {a:.2} and {b:.2} s of the recording")),
    feature("neighbour_us", Of::Around, |[a, b]| {
        format!("{a:.0} to {b:.0} us after the last event of the eight pixels around")
    }),
    feature("neighbours", Of::Around, |[a, b]| {
        format!("with {a:.0} to {b:.0} events of the eight pixels around in the 5 ms before")
    }),
    feature("neighbour_next_us", Of::Around, |[a, b]| {
        format!("{a:.0} to {b:.0} us before the next event of the eight pixels around")
    }),
    feature("own_events", Of::Own, |[a, b]| {
        format!("with {a:.0} to {b:.0} events of the same pixel in the 150 ms before")
    }),
    feature("sensor_rate_hz", Of::Sensor, |[a, b]| {
        format!("while all pixels together make {a:.0} to {b:.0} events a second")
    }),
    feature("row_us", Of::Sensor, |[a, b]| {
        format!("{a:.0} to {b:.0} us from another event of their row")
    }),
    feature("since_frame_us", Of::Sensor, |[a, b]| {
        format!("{a:.0} to {b:.0} us after a frame's exposure began")
    }),
];

/// What a model leaves.
#[derive(Debug, Clone)]
pub(super) struct Structure {
    /// What trees gain over a coin, nats an event.
    pub(super) nats: f64,
    /// Its standard error.
    pub(super) error: f64,
    /// Share of events told rightly.
    pub(super) accuracy: f64,
    /// What they gain by nothing that an error of the light shows in; only where the light between frames is
    /// guessed.
    pub(super) apart_from_light: Option<f64>,
    /// What of that takes the rest of the sensor, beyond the pixel's own light and past, and its
    /// standard error.
    pub(super) others: [f64; 2],
    /// By what they are told apart, the most telling first, with its share.
    pub(super) by: Vec<(&'static str, f64)>,
    /// Where real events are more or fewer than the model's, the most telling first.
    pub(super) places: Vec<Where>,
}

#[cfg(test)]
impl Structure {
    /// So much is left, nats an event, and nothing is known of where.
    pub(super) fn of(nats: f64) -> Self {
        Self {
            nats,
            error: 0.001,
            accuracy: 0.5,
            apart_from_light: None,
            others: [0.0; 2],
            by: Vec::new(),
            places: Vec::new(),
        }
    }
}

impl Structure {
    /// The hazard's dependence on what the pixel's own light and past do not hold, where that tells
    /// most: the logarithm of real events over the model's in each range of it.
    pub(super) fn term(&self) -> Option<ProposedTerm> {
        let is_other = |key: &str| FEATURES.iter().any(|f| f.of.is_other() && f.key == key);
        let most = self.by.iter().find(|(key, _)| is_other(key))?.0;
        let mut places: Vec<&Where> =
            self.places.iter().filter(|place| place.covariate == most).collect();
        places.sort_by(|a, b| a.range[0].total_cmp(&b.range[0]));
        let point = |place: &&Where| {
            let ratio = place.ratio?;
            let error = 1.645 / (place.n_events.max(1) as f64).sqrt();
            let middle = 0.5 * (place.range[0] + place.range[1]);
            let log = ratio.max(1e-6).ln();
            Some([middle, log, log - error, log + error])
        };
        let curve: Vec<[f64; 4]> = places.iter().filter_map(point).collect();
        (!curve.is_empty()).then(|| ProposedTerm {
            enters: "hazard".into(),
            depends_on: most.into(),
            curve,
            heldout_gain_nats_per_event: self.others[0],
        })
    }
}

/// The structure that a model leaves in the evidence. The seed decides the events drawn.
pub(super) fn structure(evidence: &Evidence, model: &Fitted, seed: u64) -> Option<Structure> {
    let examples = examples(evidence, model, seed);
    let told = told_apart(&examples)?;
    let own = told_apart_by(&examples, |feature| !FEATURES[feature].of.is_other())?;
    let others = told.more_than(&own);
    let by_others = || told_apart_by(&examples, |feature| !FEATURES[feature].of.is_by_light());
    let apart_from_light = evidence.facts.is_led.then(by_others).flatten().map(|told| told.nats);
    let Told { nats, error, accuracy, ref share, .. } = told;
    let mut by: Vec<(&'static str, f64)> =
        FEATURES.iter().zip(share).map(|(f, s)| (f.key, *s)).collect();
    by.sort_by(|a, b| b.1.total_cmp(&a.1));
    let others = [others.0, others.1];
    let places = places(&examples);
    Some(Structure { nats, error, accuracy, apart_from_light, others, by, places })
}

fn examples(evidence: &Evidence, model: &Fitted, seed: u64) -> Examples {
    let kinds = kinds_of_pixels(evidence, &model.hypothesis);
    let every = evidence.n_events().div_ceil(MOST).max(1);
    let parts: Vec<Examples> = evidence
        .pixels
        .par_iter()
        .zip(kinds)
        .enumerate()
        .map(|(number, (pixel, kind))| {
            let view = model.hypothesis.view(evidence, pixel, kind, Vec::new());
            let mut random = SplitMix::new(seed ^ 0x6e65_7874, number as u64);
            let end = evidence.blocks.length_us();
            let all = next_events(&view.law, view.light(), &pixel.spikes, end, &mut random);
            let mut part = Examples { n_features: FEATURES.len(), ..Examples::default() };
            for one in all.iter().skip(number % every).step_by(every) {
                let past = &pixel.spikes[..=one.before];
                for (moment, is_real) in [(one.real, true), (one.drawn, false)] {
                    let Some(moment) = moment else { continue };
                    let theta = view.law.theta(moment.spike.on);
                    part.features.extend(features(evidence, pixel, past, &moment, theta));
                    part.is_real.push(is_real);
                    let block = evidence.blocks.of(moment.spike.t_us as f64);
                    part.cell.push(evidence.cell(pixel, block) as u32);
                    part.fold.push(fold(evidence, pixel.tile, block));
                }
            }
            part
        })
        .collect();
    let mut all = Examples { n_features: FEATURES.len(), ..Examples::default() };
    for part in parts {
        all.features.extend(part.features);
        all.is_real.extend(part.is_real);
        all.cell.extend(part.cell);
        all.fold.extend(part.fold);
    }
    all
}

/// The fold of a cell; the third of them that a fit holds out is one.
fn fold(evidence: &Evidence, tile: usize, block: usize) -> u8 {
    (0..FOLDS)
        .find(|fold| evidence.is_held_out(tile, block + usize::from(*fold)))
        .unwrap_or_default()
}

fn features(
    evidence: &Evidence,
    pixel: &PixelEvidence,
    past: &[Spike],
    moment: &SpikeContext,
    theta: f64,
) -> [f32; FEATURES.len()] {
    let Spike { t_us, on } = moment.spike;
    let around = &evidence.around;
    let before = past.last().copied().unwrap_or(moment.spike);
    let (near_us, n_near) = around.neighbours(pixel.x, pixel.y, t_us, NEAR_US);
    let own = past.iter().rev().take_while(|s| t_us - s.t_us < RECENT_US).count();
    [
        (t_us - before.t_us) as f32,
        f32::from(u8::from(on != before.on)),
        f32::from(u8::from(on)),
        (((moment.change / theta - 1.0) / FINEST).round() * FINEST) as f32,
        moment.slope_per_s as f32,
        moment.level as f32,
        f32::from(pixel.x),
        f32::from(pixel.y),
        t_us as f32 * 1e-6,
        near_us as f32,
        n_near as f32,
        around.next_us(pixel.x, pixel.y, t_us) as f32,
        own as f32,
        evidence.rate_hz(t_us) as f32,
        around.row_us(pixel.x, pixel.y, t_us) as f32,
        around.since_frame_us(t_us) as f32,
    ]
}

/// Parts of a feature's range.
const PARTS: usize = 8;

/// Ranges of single features in which real events and the model's differ in number, by what that
/// difference is worth in nats an event; the most telling first.
fn places(examples: &Examples) -> Vec<Where> {
    let mut found = Vec::new();
    let n_real = examples.is_real.iter().filter(|real| **real).count().max(1) as f64;
    let n_drawn = (examples.is_real.len() as f64 - n_real).max(1.0);
    for (number, feature) in FEATURES.iter().enumerate() {
        let values: Vec<(f64, bool)> = examples
            .features
            .iter()
            .skip(number)
            .step_by(FEATURES.len())
            .map(|v| f64::from(*v))
            .zip(examples.is_real.iter().copied())
            .filter(|(v, _)| v.is_finite())
            .collect();
        let mut sorted: Vec<f64> = values.iter().map(|v| v.0).collect();
        sorted.sort_by(f64::total_cmp);
        let mut edges: Vec<f64> =
            (1..PARTS).filter_map(|i| sorted.get(i * sorted.len() / PARTS).copied()).collect();
        edges.dedup();
        let mut counts = vec![[0.0, 0.0]; edges.len() + 1];
        let mut ends = vec![[f64::INFINITY, f64::NEG_INFINITY]; edges.len() + 1];
        for (value, is_real) in values {
            let part = edges.partition_point(|edge| *edge <= value);
            counts[part][usize::from(is_real)] += 1.0;
            ends[part] = [ends[part][0].min(value), ends[part][1].max(value)];
        }
        for (range, [drawn, real]) in ends.into_iter().zip(counts) {
            let (p, q) = (real / n_real, drawn / n_drawn);
            let middle = 0.5 * (p + q);
            let part = |x: f64| if x > 0.0 { 0.5 * x * (x / middle).ln() } else { 0.0 };
            // Its share of the two samples' divergence, less what chance makes of as many events.
            let nats = part(p) + part(q) - 0.125 * (1.0 / n_real + 1.0 / n_drawn) * (1.0 - middle);
            let surprise = (p - q).abs() / (p / n_real + q / n_drawn).max(1e-300).sqrt();
            if surprise > 4.0 && nats > 0.0 {
                let ratio = p / q.max(0.5 / n_drawn);
                let says = format!(
                    "{:.2} real events for each of the model's {}",
                    ratio,
                    (feature.says)(range)
                );
                found.push(Where {
                    covariate: feature.key.into(),
                    range,
                    excess_nats_per_event: nats,
                    innovation_thresholds: None,
                    ratio: Some(ratio),
                    n_events: real as u64,
                    says,
                });
            }
        }
    }
    found.sort_by(|a, b| b.excess_nats_per_event.total_cmp(&a.excess_nats_per_event));
    found.truncate(8);
    found
}
