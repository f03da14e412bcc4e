//! Band-limited noise of the photoreceptor.

use super::{Candidate, EffectId, Freed, Nuisance, PLAIN};
use std::f64::consts::PI;

pub(super) const CANDIDATE: Candidate = Candidate {
    id: EffectId::ShotNoise,
    equation: "event when |V + n - n_mem| > theta, n band-limited",
    source: "Rice, Bell Syst. Tech. J. 24, 1945; Graca, Paredes-Valles and Delbruck, arXiv 2304.04019",
    frees: &[
        Freed { nuisance: Nuisance::LogNoise, range: [-5.3, 0.0] },
        Freed { nuisance: Nuisance::LogNoiseHz, range: [-3.0, 7.6] },
    ],
    starts: |_| vec![vec![-2.2, 6.0], vec![-1.6, 5.0], vec![-1.2, 3.0]],
    report: |values| {
        // A logistic law's standard deviation is pi over the root of three of its scale.
        let scale = values[Nuisance::LogNoise as usize].exp();
        vec![scale * PI / 3.0_f64.sqrt(), values[Nuisance::LogNoiseHz as usize].exp() / (2.0 * PI)]
    },
    rivals: &[EffectId::BackgroundActivity, EffectId::FrameNoise, EffectId::StampJitter],
    splitter: "a static segment: polarities of noise alternate, more than three in four",
    says: |values| {
        format!(
            "noise of {:.2} thresholds makes pixels fire by themselves, in turns On and Off",
            values[0]
        )
    },
    ..PLAIN
};
