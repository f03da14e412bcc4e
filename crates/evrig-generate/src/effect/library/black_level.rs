//! Black level: the frames' pedestal is not the stated one.
//!
//! What the frames read without light was taken to be less than it is, so all their values are too
//! high by the difference; the generator takes it off. Signature: the drive's contrast is too small
//! in the dark, equal for both sides.

use crate::effect::model::EffectModel;
use crate::effect::pixel_site::{PixelSite, SiteSignal};

effect! {
    /// True pedestal less the stated one.
    BlackLevel, Frames, "I_true = I - b / white" {
        /// True pedestal less the stated one, digital units.
        offset_dn: -1e4 to 1e4,
    }
}

/// The least intensity above black that has a logarithm here, digital units: half a step.
const FLOOR_DN: f64 = 0.5;

impl EffectModel for BlackLevel {
    fn apply_to_signal(&self, site: &PixelSite<'_>, signal: &mut SiteSignal<'_>) {
        let offset = (self.offset_dn / site.white_dn) as f32;
        let floor = (FLOOR_DN / site.white_dn) as f32;
        signal.values.iter_mut().filter(|x| x.is_finite()).for_each(|x| {
            *x = (x.exp() - offset).max(floor).ln();
        });
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::test_support::*;
    use std::f64::consts::TAU;

    #[test]
    fn frames_with_a_pedestal_give_the_events_of_the_light() {
        let wave = |x: f64, t: f64| 0.5 * (TAU * (2.0 * t + x / 16.0)).sin() - 3.0;
        let light = synthetic(move |[x, _], t| wave(x, t));
        let raised = synthetic(move |[x, _], t| (wave(x, t).exp() + 10.0 / 200.0).ln());
        let truth = events(&light, 1.0, &[]);
        assert!(events(&raised, 1.0, &[]).len() < truth.len() * 3 / 4);
        let corrected = events(&raised, 1.0, &["black_level:offset_dn=10"]);
        assert!((corrected.len() as f64 / truth.len() as f64 - 1.0).abs() < 2e-3);
        assert!(mean_lag(&truth, &corrected).abs() < 5.0);
    }
}
