//! Temporal noise of a frame's pixels as a function of intensity.

/// Intensity classes.
const INTENSITY_CLASSES: usize = 8;
/// Pixels sampled over all frames, approximately.
const MAX_SAMPLES: usize = 1 << 17;
/// Quantile of the absolute differences that estimates the noise: moving content affects the values
/// above it.
const NOISE_QUANTILE: f64 = 0.4;
/// The same quantile of the absolute standard normal distribution.
const NORMAL_QUANTILE: f64 = 0.524_4;

#[derive(Debug, Clone, Default)]
pub(super) struct PixelNoise {
    /// Upper intensity of each class, ascending, and its standard deviation.
    classes: Vec<(f32, f32)>,
}

impl PixelNoise {
    /// From consecutive frames of `n_pixels` intensities each: differences from the mean of the two
    /// neighbouring frames. `least` is the quantization limit.
    pub(super) fn estimate(values: &[f32], n_pixels: usize, least: f32) -> Self {
        let inner = values.len().saturating_sub(2 * n_pixels);
        let step = inner.div_ceil(MAX_SAMPLES).max(1);
        let mut samples: Vec<(f32, f32)> = (0..inner)
            .step_by(step)
            .map(|i| {
                let [a, b, c] = [0, 1, 2].map(|k| values[i + k * n_pixels]);
                (b, (b - 0.5 * (a + c)).abs())
            })
            .collect();
        samples.sort_by(|a, b| a.0.total_cmp(&b.0));
        let size = samples.len().div_ceil(INTENSITY_CLASSES).max(1);
        let classes = samples
            .chunks_mut(size)
            .map(|class| {
                let end = class[class.len() - 1].0;
                class.sort_by(|a, b| a.1.total_cmp(&b.1));
                let quiet = f64::from(class[(class.len() as f64 * NOISE_QUANTILE) as usize].1);
                // The mean of two neighbours adds half a frame's variance.
                (end, least.max((quiet / NORMAL_QUANTILE / 1.5_f64.sqrt()) as f32))
            })
            .collect();
        Self { classes }
    }

    /// At an intensity; beyond the brightest class, that class's value.
    pub(super) fn at(&self, intensity: f32) -> f32 {
        let class = self.classes.partition_point(|(end, _)| *end < intensity);
        self.classes.get(class).or(self.classes.last()).map_or(0.0, |(_, noise)| *noise)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use evrig_core::stats::SplitMix;

    #[test]
    fn noise_that_grows_with_the_light_is_met_beside_something_that_moves() {
        let mut random = SplitMix::new(4, 4);
        let n_pixels = 2_000;
        let light = |frame: usize, i: usize| {
            let still = 0.1 + 0.8 * (i as f32 / n_pixels as f32);
            // A third of the pixels is inverted in every frame.
            if i.is_multiple_of(3) && frame.is_multiple_of(2) { 1.0 - still } else { still }
        };
        let values: Vec<f32> = (0..40 * n_pixels)
            .map(|i| {
                let light = light(i / n_pixels, i % n_pixels);
                light + 0.02 * light.sqrt() * random.normal() as f32
            })
            .collect();
        let noise = PixelNoise::estimate(&values, n_pixels, 1e-4);
        for light in [0.2_f32, 0.5, 0.85] {
            let is = noise.at(light) / (0.02 * light.sqrt());
            assert!((0.8..1.9).contains(&is), "{is} of the noise at {light}");
        }
        assert!(PixelNoise::estimate(&[], 4, 0.1).at(0.5).abs() < 1e-9);
    }
}
