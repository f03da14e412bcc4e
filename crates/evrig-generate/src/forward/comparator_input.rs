//! From a pixel's light to what its comparator sees, without noise.

use crate::pixel_model::PixelModel;
use wide::f32x8;

/// What a pixel's comparator sees at the instants of a grid.
#[derive(Debug, Default)]
pub(super) struct ComparatorInput {
    /// Signal and leak together, nominal thresholds from an arbitrary zero; `NaN` where the light
    /// is not known.
    pub(super) volts: Vec<f64>,
    /// Variance of the white noise from the instant before to this one; empty without noise.
    pub(super) variance: Vec<f64>,
    /// Standard deviation of the band-limited noise; empty without.
    pub(super) band_rms: Vec<f64>,
    /// Scale of the thresholds' scatter; empty without.
    pub(super) scatter: Vec<f64>,
    intensity: Vec<f32>,
}

impl ComparatorInput {
    /// Fills in what the pixel makes of `light`, log intensity over white at a step of `step_s`.
    pub(super) fn fill(&mut self, pixel: &PixelModel, light: &[f32], step_s: f64) {
        let has_floor = pixel.floor_of_white > MIN_FLOOR_OF_WHITE;
        let varies = pixel.band.is_some_and(|band| band.light_exponent != 0.0)
            || pixel.scatter.is_some_and(|scatter| scatter.light_exponent != 0.0);
        let needs_intensity =
            has_floor || pixel.leak_hz_at_white != 0.0 || pixel.shot_per_sqrt_s != 0.0 || varies;
        self.intensity.clear();
        if needs_intensity {
            exponentials(light, &mut self.intensity);
        }
        self.signal(pixel, light, has_floor);
        self.leak(pixel, step_s);
        self.noise(pixel, light.len(), step_s);
    }

    fn signal(&mut self, pixel: &PixelModel, light: &[f32], has_floor: bool) {
        self.volts.clear();
        let gain = pixel.gain;
        if has_floor {
            let floor = pixel.floor_of_white;
            let log = |&i: &f32| gain * (f64::from(i) + floor).ln();
            self.volts.extend(self.intensity.iter().map(log));
        } else {
            self.volts.extend(light.iter().map(|&x| gain * f64::from(x)));
        }
    }

    fn leak(&mut self, pixel: &PixelModel, step_s: f64) {
        let PixelModel { leak_hz, leak_hz_at_white, leak_hz_per_s, .. } = *pixel;
        if leak_hz != 0.0 || leak_hz_per_s != 0.0 {
            for (i, volts) in self.volts.iter_mut().enumerate() {
                let t_s = i as f64 * step_s;
                *volts += t_s * (leak_hz + 0.5 * leak_hz_per_s * t_s);
            }
        }
        if leak_hz_at_white != 0.0 {
            let mut sum = 0.0;
            let mut before = f64::NAN;
            for (volts, &intensity) in self.volts.iter_mut().zip(&self.intensity) {
                let now = f64::from(intensity);
                let mean = 0.5 * (before + now);
                if mean.is_finite() {
                    sum += mean;
                }
                before = now;
                *volts += leak_hz_at_white * step_s * sum;
            }
        }
    }

    fn noise(&mut self, pixel: &PixelModel, n: usize, step_s: f64) {
        self.variance.clear();
        if pixel.shot_per_sqrt_s != 0.0 {
            let variance = |&i: &f32| pixel.white_noise(f64::from(i)).powi(2) * step_s;
            self.variance.extend(self.intensity.iter().map(variance));
        } else if !pixel.is_quiet() {
            self.variance.resize(n, pixel.white_per_sqrt_s.powi(2) * step_s);
        }
        let at_light = |white: f64, exponent: f64, out: &mut Vec<f64>| {
            out.clear();
            if exponent == 0.0 {
                out.resize(if white > 0.0 { n } else { 0 }, white);
            } else if white > 0.0 {
                let there =
                    |&i: &f32| white * f64::from(i).max(MIN_NOISE_INTENSITY).powf(-exponent);
                out.extend(self.intensity.iter().map(there));
            }
        };
        let band = pixel.band.map_or([0.0; 2], |band| [band.rms, band.light_exponent]);
        at_light(band[0], band[1], &mut self.band_rms);
        let scatter = pixel.scatter.map_or([0.0; 2], |s| [s.scale, s.light_exponent]);
        at_light(scatter[0], scatter[1], &mut self.scatter);
    }
}

/// A floor inside the logarithm below this share of white changes nothing that a pixel sees.
const MIN_FLOOR_OF_WHITE: f64 = 1e-6;

/// The least intensity of white at which noise is still taken to grow.
const MIN_NOISE_INTENSITY: f64 = 1e-4;

/// e to the power of each value, eight at a time (relative error below 1e-6).
fn exponentials(values: &[f32], out: &mut Vec<f32>) {
    let (parts, rest) = values.as_chunks::<8>();
    out.reserve(values.len());
    for part in parts {
        out.extend_from_slice(&f32x8::from(*part).exp().to_array());
    }
    out.extend(rest.iter().map(|x| x.exp()));
    // The lanes do not keep what is not known.
    for (out, value) in out.iter_mut().zip(values) {
        if !value.is_finite() {
            *out = f32::NAN;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::voltmeter::Coefficients;

    #[test]
    fn exponentials_agree_with_the_library_and_keep_what_is_not_known() {
        let mut values: Vec<f32> = (0..1003).map(|i| -9.0 + 0.01 * i as f32).collect();
        values[17] = f32::NAN;
        let mut out = Vec::new();
        exponentials(&values, &mut out);
        for (i, (x, e)) in values.iter().zip(&out).enumerate() {
            let exact = f64::from(*x).exp();
            assert!(if i == 17 { e.is_nan() } else { (f64::from(*e) / exact - 1.0).abs() < 1e-6 });
        }
    }

    #[test]
    fn signal_and_leak_add_up_to_the_stated_voltage() {
        let k = Coefficients::new([5.0, 20.0, 0.0, 1e-7, 5e-9, 0.0]).unwrap();
        let pixel = PixelModel { leak_hz_per_s: 0.3, ..PixelModel::from_k(k, 200.0) };
        let light = vec![-0.5_f32; 2001];
        let mut potential = ComparatorInput::default();
        potential.fill(&pixel, &light, 1e-3);
        let i = (-0.5_f64).exp();
        let expected = 2.0 * (0.1 + 1.0 * i + 0.5 * 0.3 * 2.0);
        let found = potential.volts[2000] - potential.volts[0];
        assert!((found - expected).abs() < 1e-5, "{found} {expected}");
        assert!((potential.volts[0] - 5.0 * (i + 0.1).ln()).abs() < 1e-5);
        assert!(potential.variance.is_empty());
    }
}
