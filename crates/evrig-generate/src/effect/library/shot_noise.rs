//! Shot noise: the photoreceptor's band-limited noise crosses the thresholds.
//!
//! Photon and electron shot noise, limited by the photoreceptor's bandwidth, is an
//! Ornstein-Uhlenbeck process n; the comparator remembers the noisy value at its reset (Hu et al.,
//! v2e, 2021; Graca, McReynolds, Delbruck 2023). Signature: still pixels fire pairs of opposite
//! side, so alternation is far above one half, and falls as noise nears the threshold.

use crate::effect::model::EffectModel;
use crate::effect::pixel_site::PixelSite;
use crate::pixel_model::BandNoise;
use crate::pixel_model::PixelModel;

effect! {
    /// An Ornstein-Uhlenbeck process on top of the signal.
    ShotNoise, Noise, "V + n - n_reset, dn = -n dt/tau + rms sqrt(2/tau) dW, tau = 1/(2 pi f)" {
        /// Standard deviation on white paper, nominal thresholds.
        rms_thresholds: 0.0 to 3.0,
        /// Cut-off (-3 dB) of its spectrum, Hz.
        bandwidth_hz: 0.1 to 1e5,
        /// The standard deviation goes with light to the power of minus this; 0 for none.
        #[serde(default)]
        light_exponent: 0.0 to 1.0,
    }
}

impl EffectModel for ShotNoise {
    fn apply_to_pixel(&self, _site: &PixelSite<'_>, pixel: &mut PixelModel) {
        pixel.band = Some(BandNoise {
            rms: self.rms_thresholds,
            bandwidth_hz: self.bandwidth_hz,
            light_exponent: self.light_exponent,
        });
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::test_support::*;
    /// Alternation and rate of events of a pixel that only noise moves, by a simulation of the
    /// process at steps of a five hundredth of its correlation time.
    fn fine(rms: f64, seed: u64) -> (f64, f64) {
        let step: f64 = 2e-3;
        let (kept, spread) = ((-step).exp(), (1.0 - (-2.0 * step).exp()).sqrt());
        let (mut n_events, mut n_pairs, mut n_turned) = (0.0, 0.0, 0.0);
        // Resets lie on a lattice about the first of them, so many first ones are tried.
        let (n_pixels, n_steps) = (2_000, 10_000);
        for pixel in 0..n_pixels {
            let mut draws = crate::random::RandomSource::new(seed).draws(pixel, 0);
            let mut n = draws.normal();
            let (mut reset, mut last) = (n, None);
            for _ in 0..n_steps {
                n = kept * n + spread * draws.normal();
                // Between steps a path goes beyond its ends by 0.5826 standard deviations of a
                // step in the mean (Broadie, Glasserman, Kou 1997): the barrier moves in by it.
                let v: f64 = rms * (n - reset);
                if v.abs() >= 1.0 - 0.582_6 * rms * spread {
                    let on = v > 0.0;
                    // The path was at the barrier then, not beyond.
                    reset += v.signum() / rms;
                    n = reset;
                    n_turned += f64::from(last.is_some_and(|last| last != on));
                    n_pairs += f64::from(last.is_some());
                    (last, n_events) = (Some(on), n_events + 1.0);
                }
            }
        }
        (n_turned / n_pairs, n_events / (f64::from(n_pixels) * f64::from(n_steps) * step))
    }

    #[test]
    fn rate_and_alternation_are_those_of_the_process_itself() {
        for (rms, bandwidth_hz) in [(0.5, 20.0), (0.35, 300.0)] {
            let (alternation_expected, per_tau) = fine(rms, 5);
            let words = format!("shot_noise:rms_thresholds={rms},bandwidth_hz={bandwidth_hz}");
            // As many correlation times as there, so that the beginning weighs the same.
            let seconds = 20.0 / (std::f64::consts::TAU * bandwidth_hz);
            let all = events(&still(-1.0), seconds, &[&words]);
            let tau = 1.0 / (std::f64::consts::TAU * bandwidth_hz);
            let rate = all.len() as f64 / SIZE.n_pixels() as f64 / seconds * tau;
            assert!((rate / per_tau - 1.0).abs() < 0.06, "{rate} {per_tau} at {rms}");
            let found = alternation(&all);
            assert!((found - alternation_expected).abs() < 0.02, "{found} {alternation_expected}");
            assert!(found > 0.75);
        }
    }

    #[test]
    fn with_an_exponent_the_dark_is_noisier() {
        let words = ["shot_noise:rms_thresholds=0.2,bandwidth_hz=50,light_exponent=0.5"];
        let bright = events(&still(0.0), 2.0, &words).len();
        let dark = events(&still(-1.4), 2.0, &words).len();
        assert!(dark > 20 * bright.max(1), "{dark} {bright}");
    }
}
