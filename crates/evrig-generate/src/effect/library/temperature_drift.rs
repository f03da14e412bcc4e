//! Temperature drift: the leak grows while the chip warms.
//!
//! Junction leakage doubles about every 8 degrees, and a camera warms for many minutes (Nozaki and
//! Delbruck 2017). Signature: the rate of ON events of still pixels rises with time.

use crate::effect::model::EffectModel;
use crate::effect::pixel_site::PixelSite;
use crate::pixel_model::PixelModel;

effect! {
    /// A leak that grows linearly from the start of the window.
    TemperatureDrift, Drift, "dV = a (t - t_start) dt" {
        /// Growth of the leak, nominal thresholds a second and second.
        rate_hz_per_s: -100.0 to 100.0,
    }
}

impl EffectModel for TemperatureDrift {
    fn apply_to_pixel(&self, _site: &PixelSite<'_>, pixel: &mut PixelModel) {
        pixel.leak_hz_per_s += self.rate_hz_per_s;
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::test_support::*;
    #[test]
    fn the_leak_grows_with_time() {
        let all = events(&still(-1.0), 10.0, &["temperature_drift:rate_hz_per_s=0.5"]);
        let n = |from: i64, to: i64| {
            all.iter().filter(|e| (from..to).contains(&(e.t / 1_000_000))).count() as f64
        };
        // The rise is 0.25 t^2 thresholds: 4 in the first four seconds, 21 in the next six.
        assert!((n(0, 10) / SIZE.n_pixels() as f64 - 25.0).abs() < 1.1);
        assert!((n(0, 4) / SIZE.n_pixels() as f64 - 4.0).abs() < 1.1);
    }
}
