//! What scatters in a pixel of the Pi's frames that light does not: the noise of its readout.

use super::looks::looks;
use super::map::RadianceMap;
use super::splat::{Key, Optics};
use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;

/// Every so many pixels of every so many rows are looked at, in at most so many frames.
const STEP: usize = 9;
const FRAMES: usize = 40;

/// Classes of signal, and the fewest pixels of one.
const CLASSES: usize = 16;
const LEAST: usize = 400;

/// Where the map changes by more than this share of its light from pixel to pixel, a misplaced frame
/// scatters more than its noise.
const SMOOTH: f64 = 0.02;

/// A median of absolute values, in standard deviations of a normal law, and the share of pixels that
/// tell as much by their squares.
const MEDIAN_AT: f64 = 0.674_49;
const TELLING: f64 = 0.37;

/// Standard deviation of the readout's noise in DN, and its standard error; none where the frames show
/// too little that is smooth.
///
/// Of the variance one part does not depend on light, one (photons) goes with it, one (gains that
/// differ from pixel to pixel) with its square.
pub(super) fn read_noise(optics: &Optics, map: &RadianceMap, keys: &[Key]) -> Option<[f64; 2]> {
    let chosen: Vec<&Key> = keys.iter().step_by(keys.len().div_ceil(FRAMES).max(1)).collect();
    let of_key = |key: &&Key| smooth(optics, map, key).unwrap_or_default();
    let all: Vec<Vec<[f64; 2]>> = chosen.par_iter().map(of_key).collect();
    let mut all: Vec<[f64; 2]> = all.into_iter().flatten().collect();
    all.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let size = all.len().div_ceil(CLASSES).max(LEAST);
    let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
    let classes: Vec<[f64; 3]> = all.chunks_exact_mut(size).filter_map(class).collect();
    for [signal, variance, n] in &classes {
        let row = Vector3::new(1.0, signal / 100.0, (signal / 100.0).powi(2));
        let precision = TELLING * n / (2.0 * variance * variance);
        normal += precision * row * row.transpose();
        right += precision * *variance * row;
    }
    let inverse = normal.try_inverse().filter(|_| classes.len() > 3)?;
    let fit = inverse * right;
    let misfit = |[signal, variance, n]: &[f64; 3]| {
        let at = signal / 100.0;
        let left = variance - fit[0] - at * (fit[1] + at * fit[2]);
        left * left * TELLING * n / (2.0 * variance * variance)
    };
    let freedom = (classes.len() - 3) as f64;
    let scale = (classes.iter().map(misfit).sum::<f64>() / freedom).max(1.0);
    let noise = fit[0].max(1.0 / 12.0).sqrt();
    Some([noise, 0.5 * (scale * inverse[(0, 0)]).sqrt() / noise])
}

/// Signal and what it lies beside the expected, DN, of pixels that look at smooth places.
fn smooth(optics: &Optics, map: &RadianceMap, key: &Key) -> Option<Vec<[f64; 2]>> {
    let camera = &optics.camera;
    let pixel_mm = key.pose[2].abs() / camera.lens.focal_px;
    let level = key.ln_gain.exp();
    let mut found = Vec::new();
    looks(optics, map, key, STEP, |look| {
        let [value, dx, dy] = look.mapped;
        if dx.hypot(dy) * pixel_mm < SMOOTH * value {
            let expected = level * value;
            let signal = |light| camera.signal(light, look.x, look.y);
            found.push([signal(expected), signal(look.light - expected)]);
        }
    })?;
    Some(found)
}

/// Middle signal, variance and number of pixels of a class.
fn class(pixels: &mut [[f64; 2]]) -> Option<[f64; 3]> {
    let n = pixels.len();
    let signal = pixels[n / 2][0];
    let mut sizes: Vec<f64> = pixels.iter().map(|pixel| pixel[1].abs()).collect();
    let median = crate::stats::upper_median(&mut sizes)? / MEDIAN_AT;
    (median > 0.0).then_some([signal, median * median, n as f64])
}
