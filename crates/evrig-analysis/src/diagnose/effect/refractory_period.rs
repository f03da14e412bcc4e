//! Refractory period in the pixel, or a filter behind it.

use super::{LibraryEffect, ModelTerm, PLAIN, fixed, log};
use crate::diagnose::ConfidenceInterval;
use crate::diagnose::Evidence;
use evrig_core::effect_id::EffectId;

pub(super) static EFFECT: LibraryEffect = LibraryEffect {
    id: EffectId::RefractoryPeriod,
    equation: "no event in (t_i, t_i + t_r); x_mem = x(t_i + t_r), or events are discarded \
         meanwhile",
    source: "Lichtsteiner, Posch and Delbruck, IEEE JSSC 43, 2008; \
             Joubert et al., Front. Neurosci. 15, 2021",
    term: Some(&TERM),
    competing: &[
        EffectId::PhotoreceptorBandwidth,
        EffectId::EventDrop,
        EffectId::ReadoutSaturation,
    ],
    separating_recording: "a second, faster pass: a refractory period is a fixed time, a low-pass \
         a fixed share of the contrast",
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

pub(super) static TERM: ModelTerm = ModelTerm {
    id: EffectId::RefractoryPeriod,
    parameters: &[
        log("refractory_us", [50.0, 200_000.0]),
        // Its end is resolved to a hundredth; a wider one than a third is no period.
        log("onset_share", [0.01, 0.3]),
        fixed("retake"),
    ],
    changes_signal: false,
    ordinary: |_| [0.0; 2],
    starts: |evidence| {
        // The next crossing takes time after the period, so that the shortest intervals bound it.
        let mut all = intervals(evidence);
        all.sort_by(f64::total_cmp);
        let quantile =
            |share: f64| all.get((share * all.len() as f64) as usize).copied().unwrap_or(1e3);
        let below = [0.2, 0.35, 0.5, 0.7, 0.85].map(|share| share * quantile(0.002));
        let beyond = [0.002, 0.01, 0.03, 0.1].map(quantile);
        let start = |us: &f64| {
            let us = us.clamp(100.0, 100_000.0);
            vec![us, 0.15, 1.0]
        };
        below.iter().chain(&beyond).map(start).collect()
    },
    stage: 3,
    apply: |v, view| {
        view.law.refractory_s = v[0] * 1e-6;
        view.law.onset_s = v[1] * view.law.refractory_s;
        view.law.retake = v[2];
    },
    report: |_, all| {
        let pixel = ConfidenceInterval { value: 0.0, ci90: [Some(0.0); 2] };
        let [period, share] = [all[0].1, all[1].1];
        let onset = ConfidenceInterval {
            value: period.value * share.value,
            ci90: share.ci90.map(|end| end.map(|end| period.value * end)),
        };
        vec![all[0], ("compares_on", pixel), ("onset_us", onset)]
    },
};

/// Intervals between the events of each pixel, microseconds.
fn intervals(evidence: &Evidence) -> Vec<f64> {
    evidence
        .pixels
        .iter()
        .flat_map(|p| p.spikes.windows(2).map(|w| (w[1].t_us - w[0].t_us) as f64))
        .collect()
}
