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
    needs: |evidence| {
        if evidence.facts.from_scene {
            Ok(())
        } else {
            Err("what happens between frames cannot be told from noise without a map".into())
        }
    },
    agrees: |evidence, values| {
        // Pairs within a few of the noise's own times are in turns On and Off.
        let near_us = 5e6 / values[1].max(1e-3);
        let pairs = evidence.pixels.iter().flat_map(|pixel| pixel.spikes.windows(2));
        let near = pairs.filter(|pair| ((pair[1].t_us - pair[0].t_us) as f64) < near_us);
        let (n, turned) = near.fold((0, 0), |(n, turned), pair| {
            (n + 1, turned + usize::from(pair[0].on != pair[1].on))
        });
        n > 100 && turned * 10 > n * 3
    },
    says: |values| {
        format!(
            "noise of {:.2} thresholds makes pixels fire by themselves, in turns On and Off",
            values[0]
        )
    },
    ..PLAIN
};
