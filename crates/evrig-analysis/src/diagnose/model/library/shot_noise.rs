//! Band-limited noise of the photoreceptor.

use super::{CandidateEffect, CandidateParameter, EffectId, Nuisance, PLAIN};
use crate::predict::SHOT_NOISE_RMS_SPEED;
use std::f64::consts::TAU;

pub(super) const CANDIDATE: CandidateEffect = CandidateEffect {
    id: EffectId::ShotNoise,
    equation: "event when |V + n - n_mem| > theta, n band-limited",
    source: "Rice, Bell Syst. Tech. J. 24, 1945; \
             Graca, Paredes-Valles and Delbruck, arXiv 2304.04019",
    parameters: &[
        CandidateParameter::log("rms_thresholds", [0.02, 1.5]),
        CandidateParameter::log("bandwidth_hz", [1.0, 5_000.0]),
    ],
    starting_points: |_| {
        // The event rate is steep in both parameters: gradient steps are slow, so starts are
        // dense.
        let sizes = [0.1_f64, 0.15, 0.2, 0.25, 0.3, 0.4];
        let paces = [30.0_f64, 75.0, 190.0, 480.0, 1200.0];
        sizes.into_iter().flat_map(|rms| paces.map(|hz| vec![rms.ln(), hz.ln()])).collect()
    },
    // Signal noise may have been fitted as threshold noise.
    nuisance_resets: &[(Nuisance::LogNoise, -3.5), (Nuisance::LogNoiseHz, 0.0)],
    theta_raises: &[0.0, 0.2, 0.4],
    apply: |values, _, view| {
        let law = &mut view.law;
        law.shot_at_white = values[0] * 0.5 * (law.theta_on + law.theta_off);
        law.shot_speed_per_s = law.shot_at_white * SHOT_NOISE_RMS_SPEED * TAU * values[1];
    },
    competing: &[EffectId::BackgroundActivity, EffectId::FrameNoise, EffectId::StampJitter],
    separating_recording: "a static segment: more than 3/4 of the noise events alternate in \
         polarity",
    requires: |evidence| {
        if evidence.facts.from_scene {
            Ok(())
        } else {
            Err("without a map, changes between frames cannot be separated from noise".into())
        }
    },
    has_signature: |evidence, values| {
        // Events within a few correlation times alternate in polarity.
        let near_us = 5e6 / values[1].max(1e-3);
        let pairs = evidence.pixels.iter().flat_map(|pixel| pixel.spikes.windows(2));
        let near = pairs.filter(|pair| ((pair[1].t_us - pair[0].t_us) as f64) < near_us);
        let (n, turned) = near.fold((0, 0), |(n, turned), pair| {
            (n + 1, turned + usize::from(pair[0].on != pair[1].on))
        });
        n > 100 && turned * 10 > n * 3
    },
    describe: |values| {
        format!("noise of {:.2} thresholds causes events of alternating polarity", values[0])
    },
    ..PLAIN
};
