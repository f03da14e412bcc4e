//! Classifier two-sample test (C2ST) of recorded against simulated next events.
//!
//! After each recorded event a next event is simulated from the model, given the same signal and
//! the same past of the pixel. Under a true model the simulated and the recorded next event have
//! the same distribution given anything but the pixel's later events: the signal, the past, events
//! of neighbours, the row, the sensor, the camera's frames. The cross-validated log-loss gain of
//! boosted trees is the residual structure.

use super::boosted_trees::{ClassifierResult, LabelledEvents, N_FOLDS, classify, classify_with};
use crate::diagnose::levels::NEGLIGIBLE_NATS_PER_EVENT;
use crate::diagnose::{Evidence, MisfitStratum, PixelEvidence, ProposedTerm};
use crate::predict::{NextEventPair, Spike, SpikeContext};
use rayon::prelude::*;

/// Events per sample (work budget).
const MAX_EVENTS: usize = 30_000;

/// Resolution of the innovation, thresholds: the error of the light lies below.
const INNOVATION_STEP: f64 = 0.2;

/// Window in which neighbours' events are counted.
const NEIGHBOUR_WINDOW_US: i64 = 5_000;

/// Window in which the pixel's own events are counted.
const OWN_WINDOW_US: i64 = 150_000;

/// What a feature depends on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum FeatureSource {
    /// The pixel's place, its own past, the time.
    Own,
    /// Its signal.
    Light,
    /// Its neighbours, which receive the same light slightly earlier or later.
    EventContext,
    /// The sensor as a whole.
    Sensor,
}

impl FeatureSource {
    /// Whether it goes beyond the pixel's own signal and past.
    const fn is_other(self) -> bool {
        matches!(self, Self::EventContext | Self::Sensor)
    }

    /// Whether a light error changes it: the neighbours of a late edge have fired already.
    const fn reflects_light_error(self) -> bool {
        matches!(self, Self::Light | Self::EventContext)
    }
}

/// A feature of an event.
struct EventFeature {
    key: &'static str,
    of: FeatureSource,
    /// Describes a range of its values.
    describe: fn([f64; 2]) -> String,
}

const fn feature(
    key: &'static str,
    of: FeatureSource,
    describe: fn([f64; 2]) -> String,
) -> EventFeature {
    EventFeature { key, of, describe }
}

const FEATURES: [EventFeature; 16] = [
    feature("interval_us", FeatureSource::Own, |[a, b]| {
        format!("{a:.0} to {b:.0} us after the pixel's last event")
    }),
    feature("polarity_turned", FeatureSource::Own, |[a, _]| {
        format!(
            "of {} polarity to the pixel's last one",
            if a >= 0.5 { "opposite" } else { "equal" }
        )
    }),
    feature(
        "polarity_on",
        FeatureSource::Own,
        |[a, _]| if a >= 0.5 { "ON".into() } else { "OFF".into() },
    ),
    feature("innovation", FeatureSource::Light, |[a, b]| {
        format!("where the signal has changed by {:.2} to {:.2} thresholds", a + 1.0, b + 1.0)
    }),
    feature("contrast_rate_per_s", FeatureSource::Light, |[a, b]| {
        format!("where log intensity changes by {a:.1} to {b:.1} per second")
    }),
    feature("log_intensity", FeatureSource::Light, |[a, b]| {
        format!("where the signal is {:.0} to {:.0} % of white", a.exp() * 100.0, b.exp() * 100.0)
    }),
    feature("column", FeatureSource::Own, |[a, b]| format!("in columns {a:.0} to {b:.0}")),
    feature("row", FeatureSource::Own, |[a, b]| format!("in rows {a:.0} to {b:.0}")),
    feature("time_s", FeatureSource::Own, |[a, b]| {
        format!("between {a:.2} and {b:.2} s of the recording")
    }),
    feature("neighbour_us", FeatureSource::EventContext, |[a, b]| {
        format!("{a:.0} to {b:.0} us after the last event of the eight neighbours")
    }),
    feature("neighbours", FeatureSource::EventContext, |[a, b]| {
        format!("with {a:.0} to {b:.0} events of the eight neighbours in the 5 ms before")
    }),
    feature("neighbour_next_us", FeatureSource::EventContext, |[a, b]| {
        format!("{a:.0} to {b:.0} us before the next event of the eight neighbours")
    }),
    feature("own_events", FeatureSource::Own, |[a, b]| {
        format!("with {a:.0} to {b:.0} events of the same pixel in the 150 ms before")
    }),
    feature("sensor_rate_hz", FeatureSource::Sensor, |[a, b]| {
        format!("at {a:.0} to {b:.0} events per second over the whole sensor")
    }),
    feature("row_us", FeatureSource::Sensor, |[a, b]| {
        format!("{a:.0} to {b:.0} us from another event of their row")
    }),
    feature("since_frame_us", FeatureSource::Sensor, |[a, b]| {
        format!("{a:.0} to {b:.0} us after a frame's exposure began")
    }),
];

/// Residual structure of a model.
#[derive(Debug, Clone)]
pub(crate) struct StructureTest {
    /// Log-loss gain over chance, nats per event.
    pub(crate) nats: f64,
    /// Its standard error.
    pub(crate) error: f64,
    /// Balanced accuracy.
    pub(crate) accuracy: f64,
    /// Gain without the features that a light error changes; only with interpolated light.
    pub(crate) without_light_features: Option<f64>,
    /// Gain from features beyond the pixel's own signal and past, and its standard error.
    pub(crate) others: [f64; 2],
    /// Features by importance, largest first.
    pub(crate) by: Vec<(&'static str, f64)>,
    /// Ranges in which recorded and simulated events differ in number, most significant first.
    pub(crate) misfit_ranges: Vec<MisfitStratum>,
}

impl StructureTest {
    /// A hazard term by the most important feature beyond the pixel's own signal and past: log
    /// ratio of recorded to simulated events per range. None where these features gain less than
    /// is neglected, or the ratio differs in one range only.
    pub(crate) fn hazard_term(&self) -> Option<ProposedTerm> {
        let is_other = |key: &str| FEATURES.iter().any(|f| f.of.is_other() && f.key == key);
        let most = self.by.iter().find(|(key, _)| is_other(key))?.0;
        let mut misfit_ranges: Vec<&MisfitStratum> =
            self.misfit_ranges.iter().filter(|place| place.covariate == most).collect();
        misfit_ranges.sort_by(|a, b| a.range[0].total_cmp(&b.range[0]));
        let point = |place: &&MisfitStratum| {
            let ratio = place.ratio?;
            let error = 1.645 / (place.n_events.max(1) as f64).sqrt();
            let middle = 0.5 * (place.range[0] + place.range[1]);
            let log = ratio.max(1e-6).ln();
            Some([middle, log, log - error, log + error])
        };
        let curve: Vec<[f64; 4]> = misfit_ranges.iter().filter_map(point).collect();
        let is_worth_it = curve.len() > 1 && self.others[0] > NEGLIGIBLE_NATS_PER_EVENT;
        is_worth_it.then(|| ProposedTerm {
            enters: "hazard".into(),
            depends_on: most.into(),
            curve,
            heldout_gain_nats_per_event: self.others[0],
        })
    }
}

/// Stream of random numbers of the drawn next events.
pub(crate) const NEXT_EVENT_STREAM: u64 = 0x6e65_7874;

/// Residual structure between recorded and drawn next events; `next_of` gives those of a pixel, and
/// its ON and OFF threshold.
pub(crate) fn test_structure(
    evidence: &Evidence,
    next_of: impl Fn(usize) -> (Vec<NextEventPair>, [f64; 2]) + Sync,
) -> Option<StructureTest> {
    let examples = examples(evidence, next_of);
    let result = classify(&examples)?;
    let own = classify_with(&examples, |feature| !FEATURES[feature].of.is_other())?;
    let others = result.more_than(&own);
    let by_other_features =
        || classify_with(&examples, |feature| !FEATURES[feature].of.reflects_light_error());
    let without_light_features = evidence
        .facts
        .is_motion_compensated
        .then(by_other_features)
        .flatten()
        .map(|result| result.nats);
    let ClassifierResult { nats, error, accuracy, ref share, .. } = result;
    let mut by: Vec<(&'static str, f64)> =
        FEATURES.iter().zip(share).map(|(f, s)| (f.key, *s)).collect();
    by.sort_by(|a, b| b.1.total_cmp(&a.1));
    let others = [others.0, others.1];
    let misfit_ranges = misfit_ranges(&examples);
    Some(StructureTest { nats, error, accuracy, without_light_features, others, by, misfit_ranges })
}

fn examples(
    evidence: &Evidence,
    next_of: impl Fn(usize) -> (Vec<NextEventPair>, [f64; 2]) + Sync,
) -> LabelledEvents {
    let every = evidence.n_events().div_ceil(MAX_EVENTS).max(1);
    let parts: Vec<LabelledEvents> = evidence
        .pixels
        .par_iter()
        .enumerate()
        .map(|(number, pixel)| {
            let (all, theta) = next_of(number);
            let mut part =
                LabelledEvents { n_features: FEATURES.len(), ..LabelledEvents::default() };
            for one in all.iter().skip(number % every).step_by(every) {
                let past = &pixel.spikes[..=one.before];
                for (moment, is_real) in [(one.real, true), (one.drawn, false)] {
                    let Some(moment) = moment else { continue };
                    let theta = theta[usize::from(!moment.spike.on)];
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
    let mut all = LabelledEvents { n_features: FEATURES.len(), ..LabelledEvents::default() };
    for part in parts {
        all.features.extend(part.features);
        all.is_real.extend(part.is_real);
        all.cell.extend(part.cell);
        all.fold.extend(part.fold);
    }
    all
}

/// The fold of a cell; the held-out third of a fit is one.
fn fold(evidence: &Evidence, tile: usize, block: usize) -> u8 {
    (0..N_FOLDS)
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
    let around = &evidence.event_context;
    let before = past.last().copied().unwrap_or(moment.spike);
    let (near_us, n_near) = around.neighbours(pixel.x, pixel.y, t_us, NEIGHBOUR_WINDOW_US);
    let own = past.iter().rev().take_while(|s| t_us - s.t_us < OWN_WINDOW_US).count();
    [
        (t_us - before.t_us) as f32,
        f32::from(u8::from(on != before.on)),
        f32::from(u8::from(on)),
        (((moment.change / theta - 1.0) / INNOVATION_STEP).round() * INNOVATION_STEP) as f32,
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

const N_FEATURE_RANGES: usize = 8;

/// Ranges of single features with different numbers of recorded and simulated events, by their
/// share of the divergence, largest first.
fn misfit_ranges(examples: &LabelledEvents) -> Vec<MisfitStratum> {
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
        let mut edges: Vec<f64> = (1..N_FEATURE_RANGES)
            .filter_map(|i| sorted.get(i * sorted.len() / N_FEATURE_RANGES).copied())
            .collect();
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
            // Share of the divergence less its expectation under equal distributions.
            let nats = part(p) + part(q) - 0.125 * (1.0 / n_real + 1.0 / n_drawn) * (1.0 - middle);
            let surprise = (p - q).abs() / (p / n_real + q / n_drawn).max(1e-300).sqrt();
            if surprise > 4.0 && nats > 0.0 {
                let ratio = p / q.max(0.5 / n_drawn);
                let description = format!(
                    "{:.2} recorded events per simulated event {}",
                    ratio,
                    (feature.describe)(range)
                );
                found.push(MisfitStratum {
                    covariate: feature.key.into(),
                    range,
                    excess_nats_per_event: nats,
                    innovation_thresholds: None,
                    ratio: Some(ratio),
                    n_events: real as u64,
                    description,
                });
            }
        }
    }
    found.sort_by(|a, b| b.excess_nats_per_event.total_cmp(&a.excess_nats_per_event));
    found.truncate(8);
    found
}
