//! Refractory period in the pixel, or a filter behind it.

use super::{CandidateEffect, CandidateParameter, EffectId, Evidence, PLAIN};
use crate::diagnose::PixelEvidence;
use crate::diagnose::evidence::refractory_peaks::refractory_peaks_us;
use evrig_core::stats::quantile_sorted;

/// Quantiles of the intervals at which a search starts: noise makes a few intervals shorter than
/// the period.
const SHORT_INTERVAL_QUANTILES: [f64; 2] = [0.002, 0.02];

const MAX_START_US: f64 = 100_000.0;

fn intervals_us(evidence: &Evidence) -> impl Iterator<Item = f64> + '_ {
    evidence.pixels.iter().flat_map(intervals_of)
}

fn intervals_of(pixel: &PixelEvidence) -> impl Iterator<Item = f64> + '_ {
    pixel.spikes.windows(2).map(|pair| (pair[1].t_us - pair[0].t_us) as f64)
}

/// Short quantiles of the intervals, of the whole sensor and of each half: no interval is shorter
/// than the period, and a longer one is excluded by every event.
fn shortest_us(evidence: &Evidence) -> Vec<f64> {
    let shortest = |is_in: &dyn Fn(&PixelEvidence) -> bool, share: f64| {
        let own = evidence.pixels.iter().filter(|pixel| is_in(pixel));
        let mut all: Vec<f64> = own.flat_map(intervals_of).collect();
        all.push(MAX_START_US);
        all.sort_by(f64::total_cmp);
        quantile_sorted(&all, share).clamp(30.0, MAX_START_US)
    };
    let [x, y] = evidence.middle;
    let split_half: [&dyn Fn(&PixelEvidence) -> bool; 4] = [
        &|pixel| f64::from(pixel.x) < x,
        &|pixel| f64::from(pixel.x) >= x,
        &|pixel| f64::from(pixel.y) < y,
        &|pixel| f64::from(pixel.y) >= y,
    ];
    let whole = SHORT_INTERVAL_QUANTILES.map(|share| shortest(&|_| true, share));
    whole
        .into_iter()
        .chain(split_half.map(|half| shortest(half, SHORT_INTERVAL_QUANTILES[1])))
        .collect()
}

pub(super) const CANDIDATE: CandidateEffect = CandidateEffect {
    id: EffectId::RefractoryPeriod,
    equation: "no event in (t_i, t_i + t_r); x_mem = x(t_i + t_r), or events are discarded \
         meanwhile",
    source: "Lichtsteiner, Posch and Delbruck, IEEE JSSC 43, 2008; \
             Joubert et al., Front. Neurosci. 15, 2021",
    parameters: &[
        CandidateParameter::log("refractory_us", [20.0, 200_000.0]),
        // Whether the pixel goes on comparing meanwhile, as in front of a filter.
        CandidateParameter::fixed("compares_on", [0.0, 1.0]).hidden(),
    ],
    starting_points: |evidence| {
        let in_pixel = [300.0_f64, 1_000.0, 3_000.0, 8_000.0, 25_000.0].map(|us| [us, 0.0]);
        let shortest = shortest_us(evidence).into_iter().flat_map(|us| [[us, 0.0], [us, 1.0]]);
        let peaks = refractory_peaks_us(evidence).into_iter().map(|us| [us, 0.0]);
        let all = in_pixel.into_iter().chain(shortest).chain(peaks);
        all.map(|[us, mode]| vec![us.ln(), mode]).collect()
    },
    apply: |values, _, view| {
        let dead_s = values[0] * 1e-6;
        if values[1] < 0.5 {
            view.law.refractory_s = dead_s;
        } else {
            view.law.filter_refractory_s = dead_s;
        }
    },
    derived: |_, values| vec![("compares_on", values[1])],
    competing: &[
        EffectId::PhotoreceptorBandwidth,
        EffectId::EventDrop,
        EffectId::ReadoutSaturation,
    ],
    separating_recording: "a second, faster pass: a refractory period is a fixed time, a low-pass \
         a fixed share of the contrast",
    has_signature: |evidence, values| {
        // Noise and background make few intervals within the period.
        let within = intervals_us(evidence).filter(|us| *us < 0.9 * values[0]).count();
        within * 25 < intervals_us(evidence).count()
    },
    describe: |values| {
        let then = if values[1] < 0.5 {
            "the pixel is blind and then stores a new reference level"
        } else {
            "a pixel's events are discarded, while it goes on comparing and storing reference \
             levels"
        };
        format!("for {:.0} us after an event {then}", values[0])
    },
    ..PLAIN
};
