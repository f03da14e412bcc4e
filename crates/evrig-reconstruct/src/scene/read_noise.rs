//! Readout noise of the Pi camera: the part of the variance that does not depend on light.

use super::accumulate::{Keyframe, MapOptics};
use super::map::RadianceMap;
use super::map_samples::visit_map_samples;
use evrig_core::stats::upper_median;
use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;

/// Pixel step in both axes, and most frames.
const PIXEL_STEP: usize = 9;
const MAX_FRAMES: usize = 40;
/// Signal classes, and the fewest pixels of one.
const SIGNAL_CLASSES: usize = 16;
const MIN_CLASS_PIXELS: usize = 400;
/// Greatest relative change of the map per pixel: above it, registration errors exceed the noise.
const MAX_GRADIENT: f64 = 0.02;
/// Median absolute deviation of a standard normal variable, and the efficiency of the median
/// absolute deviation as a scale estimate.
const MAD_OF_NORMAL: f64 = 0.674_49;
const MAD_EFFICIENCY: f64 = 0.37;

/// Standard deviation of the readout noise in DN, and its standard error; None with too few smooth
/// samples.
///
/// The variance is modelled as a constant, a term proportional to the signal (shot noise) and one
/// proportional to its square (pixel gain spread).
pub(super) fn read_noise(
    optics: &MapOptics,
    map: &RadianceMap,
    keys: &[Keyframe],
) -> Option<[f64; 2]> {
    let chosen: Vec<&Keyframe> =
        keys.iter().step_by(keys.len().div_ceil(MAX_FRAMES).max(1)).collect();
    let of_key = |key: &&Keyframe| smooth_pixels(optics, map, key).unwrap_or_default();
    let all: Vec<Vec<SmoothPixel>> = chosen.par_iter().map(of_key).collect();
    let mut all: Vec<SmoothPixel> = all.into_iter().flatten().collect();
    all.sort_by(|a, b| a.signal.total_cmp(&b.signal));
    let size = all.len().div_ceil(SIGNAL_CLASSES).max(MIN_CLASS_PIXELS);
    let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
    let classes: Vec<[f64; 3]> = all.chunks_exact(size).filter_map(class_variance).collect();
    for [signal, variance, n] in &classes {
        let row = Vector3::new(1.0, signal / 100.0, (signal / 100.0).powi(2));
        let precision = MAD_EFFICIENCY * n / (2.0 * variance * variance);
        normal += precision * row * row.transpose();
        right += precision * *variance * row;
    }
    let inverse = normal.try_inverse().filter(|_| classes.len() > 3)?;
    let fit = inverse * right;
    let misfit = |[signal, variance, n]: &[f64; 3]| {
        let at = signal / 100.0;
        let residual = variance - fit[0] - at * (fit[1] + at * fit[2]);
        residual * residual * MAD_EFFICIENCY * n / (2.0 * variance * variance)
    };
    let freedom = (classes.len() - 3) as f64;
    let scale = (classes.iter().map(misfit).sum::<f64>() / freedom).max(1.0);
    let noise = fit[0].max(1.0 / 12.0).sqrt();
    Some([noise, 0.5 * (scale * inverse[(0, 0)]).sqrt() / noise])
}

#[derive(Debug, Clone, Copy)]
struct SmoothPixel {
    /// Expected signal and residual, DN.
    signal: f64,
    residual: f64,
    site: usize,
}

fn smooth_pixels(
    optics: &MapOptics,
    map: &RadianceMap,
    key: &Keyframe,
) -> Option<Vec<SmoothPixel>> {
    let camera = &optics.camera;
    let pixel_mm = key.pose[2].abs() / camera.lens.focal_px;
    let level = key.ln_gain.exp();
    let mut found = Vec::new();
    visit_map_samples(optics, map, key, PIXEL_STEP, |sample| {
        let [value, dx, dy] = sample.mapped;
        if dx.hypot(dy) * pixel_mm < MAX_GRADIENT * value {
            let expected = level * value;
            let signal = |light| camera.signal(light, sample.x, sample.y);
            let (signal, residual) = (signal(expected), signal(sample.light - expected));
            found.push(SmoothPixel { signal, residual, site: sample.y % 2 * 2 + sample.x % 2 });
        }
    })?;
    Some(found)
}

/// Median signal, variance and size of a class.
///
/// The median residual of each Bayer site is removed: an error of the black level is not noise.
fn class_variance(pixels: &[SmoothPixel]) -> Option<[f64; 3]> {
    let n = pixels.len();
    let residual = |site: usize| -> Vec<f64> {
        let of_site = pixels.iter().filter(|pixel| pixel.site == site);
        of_site.map(|pixel| pixel.residual).collect()
    };
    let mut sizes: Vec<f64> = (0..4)
        .map(residual)
        .filter_map(|all| Some((upper_median(&mut all.clone())?, all)))
        .flat_map(|(middle, all)| all.into_iter().map(move |residual| (residual - middle).abs()))
        .collect();
    let deviation = upper_median(&mut sizes)? / MAD_OF_NORMAL;
    (deviation > 0.0).then_some([pixels[n / 2].signal, deviation * deviation, n as f64])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pedestal_that_each_place_of_the_mosaic_has_its_own_of_is_no_noise() {
        let pixel = |i: u32| {
            let site = (i % 4) as usize;
            let even = f64::from(i.wrapping_mul(2_654_435_761) >> 16) / 65_536.0 - 0.5;
            SmoothPixel { signal: 30.0, residual: [9.0, 0.0, -4.0, 6.0][site] + even, site }
        };
        let pixels: Vec<SmoothPixel> = (0..4_000).map(pixel).collect();
        let [signal, variance, n] = class_variance(&pixels).unwrap();
        // Half of the values uniform in ±1/2 lie within ±1/4.
        let expected = (0.25 / MAD_OF_NORMAL).powi(2);
        assert!((variance / expected - 1.0).abs() < 0.1, "{variance} for {expected}");
        assert_eq!([signal, n], [30.0, 4_000.0]);
    }
}
