//! Spectral lines of the net event rate: where a periodic light or motion shows.

use crate::diagnose::Evidence;
use std::f64::consts::TAU;

const MAX_DURATION_S: f64 = 8.0;

/// Below lies the motion of the target.
const MIN_FREQUENCY_HZ: f64 = 4.0;

const MIN_LINE_SPACING_HZ: f64 = 1.0;

/// The `n` most prominent frequencies. Pixels fire in bursts, so that a harmonic may be the
/// strongest.
pub(crate) fn lines(evidence: &Evidence, n: usize) -> Vec<f64> {
    let step_s = evidence.step_us * 1e-6;
    let net = &evidence.rates[0];
    let net = &net[..net.len().min((MAX_DURATION_S / step_s) as usize)];
    if net.len() < 64 {
        return Vec::new();
    }
    let resolution = 0.5 / (net.len() as f64 * step_s);
    let highest = (0.49 / step_s).min(490.0);
    let n_lines = ((highest - MIN_FREQUENCY_HZ) / resolution) as usize;
    let power: Vec<f64> = (0..n_lines)
        .map(|i| power(net, (MIN_FREQUENCY_HZ + i as f64 * resolution) * step_s))
        .collect();
    let around = 60;
    let mut clear: Vec<(f64, usize)> = (0..n_lines)
        .map(|i| {
            let near = &power[i.saturating_sub(around)..(i + around).min(n_lines)];
            let mean = near.iter().sum::<f64>() / near.len() as f64;
            (power[i] / mean.max(1e-12), i)
        })
        .collect();
    clear.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut lines: Vec<f64> = Vec::new();
    for hz in clear.into_iter().map(|(_, i)| MIN_FREQUENCY_HZ + i as f64 * resolution) {
        if lines.iter().all(|line| (line - hz).abs() > MIN_LINE_SPACING_HZ) {
            lines.push(hz);
        }
        if lines.len() == n {
            break;
        }
    }
    lines
}

/// Power at a frequency in cycles per sample, under a sine window.
fn power(samples: &[f32], frequency: f64) -> f64 {
    let (turn_cos, turn_sin) = ((TAU * frequency).cos(), (TAU * frequency).sin());
    let (mut c, mut s) = (1.0, 0.0);
    let (mut re, mut im) = (0.0, 0.0);
    let scale = std::f64::consts::PI / samples.len() as f64;
    let (grow_cos, grow_sin) = (scale.cos(), scale.sin());
    let (mut wc, mut ws) = (1.0, 0.0);
    for &sample in samples {
        let windowed = f64::from(sample) * ws;
        re += windowed * c;
        im += windowed * s;
        (c, s) = (c * turn_cos - s * turn_sin, c * turn_sin + s * turn_cos);
        (wc, ws) = (wc * grow_cos - ws * grow_sin, wc * grow_sin + ws * grow_cos);
    }
    re * re + im * im
}
