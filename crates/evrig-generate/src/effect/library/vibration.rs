//! Vibration: the arm shakes while it moves.
//!
//! The place that a pixel looks at swings along one direction; the light there is taken from the
//! parabola through the place and the two ends of the swing, which is true as long as the
//! image is smooth over it. How many pixels a millimetre is, and in which direction, has a default.
//! Signature: a line in the spectrum where the image has edges across the direction, and none
//! where it is flat.

use crate::effect::model::EffectModel;
use crate::effect::pixel_site::{PixelSite, SiteSignal};
use std::f64::consts::TAU;

effect! {
    /// A sine on the place a pixel looks at.
    Vibration, Optics, "p_seen = p + a sin(2 pi f (t - t_0) + phi)" {
        /// Frequency, Hz.
        frequency_hz: 0.1 to 1e4,
        /// Amplitude on the target, mm.
        amplitude_mm: 0.0 to 10.0,
        /// Event pixels a millimetre on the target.
        #[serde(default = "px_per_mm")]
        px_per_mm: 0.01 to 100.0,
        /// Direction of the swing, degrees from x towards y.
        #[serde(default)]
        direction_deg: -360.0 to 360.0,
        /// Phase of the sine at `phase_at_us`, degrees.
        #[serde(default)]
        phase_deg: -360.0 to 360.0,
        /// Instant of the phase, µs.
        #[serde(default)]
        phase_at_us: -1e18 to 1e18,
    }
}

const fn px_per_mm() -> f64 {
    1.0
}

impl EffectModel for Vibration {
    fn apply_to_signal(&self, _site: &PixelSite<'_>, signal: &mut SiteSignal<'_>) {
        let swing = self.amplitude_mm * self.px_per_mm;
        if swing == 0.0 {
            return;
        }
        let (sin, cos) = self.direction_deg.to_radians().sin_cos();
        let end = [cos * swing, sin * swing];
        let grid = signal.grid();
        signal.add_from_around([end.map(|p| -p), end], |&[back, ahead], here, i| {
            let t_s = (grid.at(i) as f64 - self.phase_at_us) * 1e-6;
            let phase = TAU * (self.frequency_hz * t_s).fract() + self.phase_deg.to_radians();
            let at = phase.sin() as f32;
            here + 0.5 * at * (ahead - back) + 0.5 * at * at * (ahead - 2.0 * here + back)
        });
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::test_support::*;
    #[test]
    fn edges_across_the_swing_fire_in_its_rhythm_and_edges_along_it_do_not() {
        let words = ["vibration:frequency_hz=40,amplitude_mm=1,px_per_mm=2"];
        let across = synthetic(|[x, _], _| (x * 0.3).sin() - 1.0);
        let along = synthetic(|[_, y], _| (y * 0.3).sin() - 1.0);
        let all = events(&across, 1.0, &words);
        assert!(all.len() > 10 * SIZE.n_pixels(), "{}", all.len());
        assert!(events(&along, 1.0, &words).is_empty());
        let counts = counts(&all);
        // Twice a period the place comes by: 80 times where the slope is steepest, 0.6 of 5 each.
        let most = counts.iter().copied().fold(0.0, f64::max);
        assert!(most >= 80.0 * 4.0, "{most}");
    }
}
