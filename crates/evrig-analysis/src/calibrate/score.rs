//! The default objective: negative predictive log-likelihood of the real events
//! ([`crate::predict`]), in nats per event.
//!
//! k enters as threshold 1/k1, log-intensity signal ln(L + k2) and leak (k4 + k5 L). Threshold
//! scatter, noise speed and background rates are nuisance parameters.
//!
//! # Limitations
//! Independent of k3 and k6 (diffusion): the predictor's noise does not grow with the time since
//! the last event. They keep the values of the passage fit.

use super::BrightnessSeries;
use super::brightness::TileSubset;
use super::search::{HeldObjective, Objective};
use crate::predict::{
    ComparatorLaw, EventsByPixel, HazardTerm, SampledSignal, TermVisitor, TimeBlocks, visit,
};
use evrig_core::event::EventSlice;
use rayon::prelude::*;
use std::sync::Arc;

/// Bound on the samples of one evaluation, so that a search takes seconds.
const MAX_SAMPLES: usize = 2_000_000;
/// Factor by which the thinned objective has fewer samples.
const THINNING: usize = 8;
/// Samples per mean frame interval.
const PER_FRAME: usize = 2;

/// Real events by pixel, and the brightness they came from.
pub struct ScoreObjective<'a> {
    brightness: &'a BrightnessSeries,
    recording: Arc<EventsByPixel>,
    slots: [Vec<u32>; 2],
    white_dn: f64,
    thinned: Option<Box<Self>>,
}

impl<'a> ScoreObjective<'a> {
    /// Scores `events`, on tiles drawn with `seed` where all would take too long.
    #[must_use]
    pub fn new(brightness: &'a BrightnessSeries, events: EventSlice<'_>, seed: u64) -> Self {
        let times = brightness.times_us();
        let [first, last] = [times.first(), times.last()].map(|t| t.copied().unwrap_or_default());
        let recording = Arc::new(EventsByPixel::new(events, brightness.size(), [first, last]));
        let brightest = |slot: usize| brightness.series(slot).iter().copied().fold(0.0, f32::max);
        let white_dn = f64::from((0..brightness.pixels().len()).map(brightest).fold(1.0, f32::max));
        let of = |most: usize| {
            let most = (most / (PER_FRAME * times.len().max(1))).max(64);
            let slots = [TileSubset::Train, TileSubset::HeldOut]
                .map(|part| brightness.slots(part, most, seed));
            Self { brightness, recording: Arc::clone(&recording), slots, white_dn, thinned: None }
        };
        Self { thinned: Some(Box::new(of(MAX_SAMPLES / THINNING))), ..of(MAX_SAMPLES) }
    }

    /// Log-likelihood and events of one pixel.
    fn pixel(&self, slot: u32, at: &Signal, law: &ComparatorLaw) -> (f64, u32) {
        let pixel = self.brightness.pixels()[slot as usize];
        let width = u32::from(self.brightness.size().width);
        let (x, y) = ((pixel % width) as u16, (pixel / width) as u16);
        let blocks = TimeBlocks::new(self.recording.length_us(), 1);
        let signal = SampledSignal {
            start_us: 0.0,
            step_us: at.step_us,
            signal: &at.signal,
            level: &at.level,
            darkness: &at.darkness,
            bursts: &[],
        };
        let mut sum = LogLikelihood::default();
        visit(law, signal, self.recording.of(x, y), &blocks, &mut sum);
        (sum.nats, sum.n_events)
    }

    /// The signal of the comparators on a regular grid: the integral of the model's drift over k1.
    fn signal(&self, slot: u32, k: &[f64; 6]) -> Signal {
        let [k1, k2, _, k4, k5, _] = *k;
        let (times, series) = (self.brightness.times_us(), self.brightness.series(slot as usize));
        let n = (times.len() - 1) * PER_FRAME + 1;
        let step_us = self.recording.length_us() as f64 / (n - 1) as f64;
        let (mut signal, mut level) = (Vec::with_capacity(n), Vec::with_capacity(n));
        let (mut frame, mut reached) = (0, 0.0);
        for i in 0..n {
            let t_us = i as f64 * step_us;
            let at = |frame: usize| (times[frame] - times[0]) as f64;
            let drift = |frame: usize| {
                let (before, after) = (f64::from(series[frame]), f64::from(series[frame + 1]));
                let mean = 0.5 * (before + after);
                let span = at(frame + 1) - at(frame);
                ((after - before) / (mean + k2) / span + (k4 + k5 * mean) / k1, mean)
            };
            while frame + 2 < times.len() && t_us >= at(frame + 1) {
                reached += drift(frame).0 * (at(frame + 1) - at(frame));
                frame += 1;
            }
            let (rate, mean) = drift(frame);
            signal.push(reached + rate * (t_us - at(frame)));
            level.push((mean / self.white_dn).ln() as f32);
        }
        let law = ComparatorLaw::default();
        let darkness = level.iter().map(|l| law.darkness(f64::from(*l))).collect();
        Signal { signal, level, darkness, step_us }
    }
}

struct Signal {
    signal: Vec<f64>,
    level: Vec<f32>,
    /// Of the default noise exponent, which no nuisance parameter changes.
    darkness: Vec<f64>,
    step_us: f64,
}

/// Log-likelihood of a pixel and its scored events.
#[derive(Default)]
struct LogLikelihood {
    nats: f64,
    n_events: u32,
}

impl TermVisitor for LogLikelihood {
    fn silence(&mut self, _block: usize, compensator: f64) {
        self.nats -= compensator;
    }
    fn event(&mut self, term: &HazardTerm) {
        self.nats += term.log_hazard;
        self.n_events += 1;
    }
}

impl Objective for ScoreObjective<'_> {
    fn name(&self) -> &'static str {
        "score"
    }

    fn depends_on(&self) -> [bool; 6] {
        [true, true, false, true, true, false]
    }

    fn nuisances(&self) -> Vec<f64> {
        let ComparatorLaw { theta, noise, noise_rate_hz, background_hz: [on, off], .. } =
            ComparatorLaw::default();
        let nuisances = [noise / theta[0], noise_rate_hz, on, off];
        nuisances.map(f64::ln).to_vec()
    }

    fn thinned(&self) -> Option<&dyn Objective> {
        self.thinned.as_deref().map(|thinned| thinned as &dyn Objective)
    }

    fn value(&self, k: [f64; 6], nuisances: &[f64], part: TileSubset) -> f64 {
        self.at(k, part)(nuisances)
    }

    fn at(&self, k: [f64; 6], part: TileSubset) -> HeldObjective<'_> {
        let slots = &self.slots[usize::from(part == TileSubset::HeldOut)];
        let signals: Vec<Signal> = slots.par_iter().map(|&slot| self.signal(slot, &k)).collect();
        Box::new(move |nuisances| {
            let Some(law) = law(k, nuisances) else { return f64::INFINITY };
            // Collected first, so that the order of summation is fixed.
            let scores: Vec<(f64, u32)> = slots
                .par_iter()
                .zip(&signals)
                .map(|(&slot, signal)| self.pixel(slot, signal, &law))
                .collect();
            let (log_likelihood, n_events) =
                scores.iter().fold((0.0, 0.0), |(a, n), (l, m)| (a + l, n + f64::from(*m)));
            if n_events > 0.0 { -log_likelihood / n_events } else { f64::INFINITY }
        })
    }
}

/// The law of constants and nuisance parameters; none where it has no meaning.
fn law(k: [f64; 6], nuisances: &[f64]) -> Option<ComparatorLaw> {
    let value = |i: usize| nuisances.get(i).map_or(f64::NAN, |n| n.exp());
    let theta = 1.0 / k[0];
    let law = ComparatorLaw {
        theta: [theta; 2],
        noise: theta * value(0),
        noise_rate_hz: value(1),
        background_hz: [value(2), value(3)],
        ..ComparatorLaw::default()
    };
    (theta > 0.0 && theta.is_finite() && law.noise > 0.0).then_some(law)
}
