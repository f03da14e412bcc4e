//! Vibration of the camera head: a line in the spectrum of the path.
//!
//! The frames follow the head, so the signal includes the vibration. The arm's own pose log does
//! not, which makes it a departure from the session's description.

use super::path::{HeadPath, PathKnot};
use nalgebra::{SMatrix, SVector};
use std::f64::consts::{PI, TAU};

/// Standard deviation of the Gaussian high-pass filter, seconds.
const HIGH_PASS_SIGMA_S: f64 = 0.03;
/// Below this the arm's own motion dominates.
const MIN_HZ: f64 = 5.0;
/// Highest frequency, as a share of the frame rate.
const MAX_RATE_SHARE: f64 = 0.45;
/// Least power of a line over its background.
const MIN_POWER_RATIO: f64 = 40.0;
/// Spectral lines on either side that form the background, and those next to the peak that do not.
const BACKGROUND_LINES: usize = 40;
const PEAK_LINES: usize = 4;
/// Cycles about an instant from which the amplitude is fitted.
const FIT_CYCLES: f64 = 2.0;
/// Fewest frames for a spectrum.
const MIN_KNOTS: usize = 120;

/// A vibration of the head.
#[derive(Debug, Clone, Default)]
pub struct HeadVibration {
    /// Frequency and its standard error.
    pub frequency_hz: [f64; 2],
    /// Amplitude during motion and its standard error.
    pub amplitude_mm: [f64; 2],
    /// Amplitude of the line over its background.
    pub peak_ratio: f64,
    /// Displacement of the head at each knot.
    displacements: Vec<[f64; 2]>,
}

struct HighPassPath {
    times: Vec<f64>,
    places: Vec<[f64; 2]>,
}

impl HeadPath {
    /// The vibration of the head, if the path's spectrum has a significant line.
    #[must_use]
    pub fn vibration(&self) -> Option<HeadVibration> {
        let fast = HighPassPath::of(&self.knots)?;
        let seconds = fast.times[fast.times.len() - 1] - fast.times[0];
        let rate = (fast.times.len() - 1) as f64 / seconds;
        let resolution = 0.25 / seconds;
        let n = ((MAX_RATE_SHARE * rate - MIN_HZ) / resolution).max(0.0) as usize;
        let hz = |i: usize| MIN_HZ + i as f64 * resolution;
        let powers: Vec<f64> = (0..n).map(|i| fast.power(hz(i))).collect();
        let best = (0..n).max_by(|&a, &b| powers[a].total_cmp(&powers[b]))?;
        let mut near: Vec<f64> = (best.saturating_sub(BACKGROUND_LINES)
            ..n.min(best + BACKGROUND_LINES + 1))
            .filter(|i| i.abs_diff(best) > PEAK_LINES * 4)
            .map(|i| powers[i])
            .collect();
        let common = evrig_core::stats::upper_median(&mut near)?;
        let peak_ratio = (powers[best] / common.max(f64::MIN_POSITIVE)).sqrt();
        if peak_ratio * peak_ratio < MIN_POWER_RATIO {
            return None;
        }
        let frequency = fast.peak(hz(best), resolution);
        let displacements = fast.displacements(frequency, filter_gain(frequency));
        let mut sizes: Vec<f64> = displacements.iter().map(|displacement| displacement.1).collect();
        sizes.sort_by(f64::total_cmp);
        // The head vibrates while it moves: the median of the upper half.
        let amplitude = sizes[sizes.len() * 3 / 4];
        let spread = sizes[sizes.len() * 7 / 8] - sizes[sizes.len() * 5 / 8];
        Some(HeadVibration {
            frequency_hz: [frequency, 0.25 / (seconds * peak_ratio.min(30.0))],
            amplitude_mm: [amplitude, (0.5 * spread).max(0.02 * amplitude)],
            peak_ratio,
            displacements: displacements.into_iter().map(|displacement| displacement.0).collect(),
        })
    }

    /// The path with a vibration removed.
    #[must_use]
    pub fn without_vibration(&self, vibration: &HeadVibration) -> Self {
        let mut knots = self.knots.clone();
        for (knot, displacement) in knots.iter_mut().zip(&vibration.displacements) {
            knot.pose[0] -= displacement[0];
            knot.pose[1] -= displacement[1];
        }
        Self::new(self.zero, knots, self.max_gap)
    }
}

/// Gain of the high-pass filter at a frequency.
fn filter_gain(hz: f64) -> f64 {
    1.0 - (-2.0 * (PI * HIGH_PASS_SIGMA_S * hz).powi(2)).exp()
}

impl HighPassPath {
    fn of(knots: &[PathKnot]) -> Option<Self> {
        if knots.len() < MIN_KNOTS {
            return None;
        }
        let times: Vec<f64> = knots.iter().map(|knot| knot.time_s).collect();
        let reach = 4.0 * HIGH_PASS_SIGMA_S;
        let place = |at: usize| {
            let first = times.partition_point(|t| *t < times[at] - reach);
            let around = times[first..].iter().take_while(|t| **t <= times[at] + reach);
            let (mut sum, mut mean) = (0.0, [0.0; 2]);
            for (knot, t) in knots[first..].iter().zip(around) {
                let weight = (-0.5 * ((t - times[at]) / HIGH_PASS_SIGMA_S).powi(2)).exp();
                sum += weight;
                mean = [0, 1].map(|axis| mean[axis] + weight * knot.pose[axis]);
            }
            [0, 1].map(|axis| knots[at].pose[axis] - mean[axis] / sum)
        };
        // Near both ends the filter is one-sided.
        let margin = times.partition_point(|t| *t < times[0] + reach);
        let mut places: Vec<[f64; 2]> = (0..times.len()).map(place).collect();
        let n = places.len();
        places[..margin.min(n)].fill([0.0; 2]);
        places[n - margin.min(n)..].fill([0.0; 2]);
        Some(Self { times, places })
    }

    /// Power at a frequency under a Hann window.
    fn power(&self, hz: f64) -> f64 {
        let (from, to) = (self.times[0], self.times[self.times.len() - 1]);
        let mut sums = [0.0; 4];
        for (t, place) in self.times.iter().zip(&self.places) {
            let window = (PI * (t - from) / (to - from)).sin().powi(2);
            let (sin, cos) = (TAU * hz * t).sin_cos();
            for axis in 0..2 {
                sums[2 * axis] += window * place[axis] * cos;
                sums[2 * axis + 1] += window * place[axis] * sin;
            }
        }
        sums.iter().map(|sum| sum * sum).sum()
    }

    /// Parabolic interpolation of the peak.
    fn peak(&self, hz: f64, step: f64) -> f64 {
        let [left, here, right] = [hz - step, hz, hz + step].map(|f| self.power(f));
        let bend = left - 2.0 * here + right;
        if bend < 0.0 { hz + 0.5 * step * (left - right) / bend } else { hz }
    }

    /// Displacement and amplitude at each knot from a local sinusoid fit; `passed` is the filter's
    /// gain.
    fn displacements(&self, hz: f64, filter_gain: f64) -> Vec<([f64; 2], f64)> {
        let reach = FIT_CYCLES / hz;
        let displacement = |at: usize| {
            let now = self.times[at];
            let first = self.times.partition_point(|t| *t < now - reach);
            let mut normal = SMatrix::<f64, 5, 5>::zeros();
            let mut right = [SVector::<f64, 5>::zeros(); 2];
            for (t, place) in self.times[first..].iter().zip(&self.places[first..]) {
                if *t > now + reach {
                    break;
                }
                let by = (t - now) / reach;
                let (sin, cos) = (TAU * hz * (t - now)).sin_cos();
                let row = SVector::<f64, 5>::from([1.0, by, by * by, cos, sin]);
                normal += row * row.transpose();
                for axis in 0..2 {
                    right[axis] += row * place[axis];
                }
            }
            let Some(solver) = normal.cholesky() else { return ([0.0; 2], 0.0) };
            let of = right.map(|right| solver.solve(&right) / filter_gain);
            let square: f64 = of.iter().map(|of| of[3].powi(2) + of[4].powi(2)).sum();
            (of.map(|of| of[3]), square.sqrt())
        };
        (0..self.times.len()).map(displacement).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use evrig_core::time::{Span, Stamp};

    /// Two turns of a circle between two rests, with a vibration during the motion.
    fn path(swing_mm: f64, hz: f64, noise_mm: f64) -> HeadPath {
        let mut random = evrig_core::stats::SplitMix::new(4, 4);
        let knots = (0..600).map(|i| {
            let t = f64::from(i) / 120.0;
            let phase = PI * (t - 0.5).clamp(0.0, 4.0);
            let moves = f64::from(u8::from((0.5..4.5).contains(&t)));
            let displacement = moves * swing_mm * (TAU * hz * t).sin();
            let noise = [0, 1].map(|_| noise_mm * 3.5 * (random.uniform() - 0.5));
            let pose = [
                30.0 * phase.cos() + 0.8 * displacement + noise[0],
                30.0 * phase.sin() + 0.6 * displacement + noise[1],
                225.0,
                0.0,
            ];
            PathKnot { time_s: t, pose, pose_error: [0.0; 4], ln_gain: 0.0, misfit: 1.0 }
        });
        HeadPath::new(Stamp::from_nanos(0), knots.collect(), Span::from_micros(50_000))
    }

    #[test]
    fn a_swing_is_found_and_taken_off_and_a_plain_circle_has_none() {
        assert!(path(0.0, 12.0, 0.003).vibration().is_none());
        for (mm, hz) in [(0.06, 12.0), (0.2, 23.0), (0.1, 40.0)] {
            let shaking = path(mm, hz, 0.003);
            let vibration = shaking.vibration().unwrap();
            assert!((vibration.frequency_hz[0] - hz).abs() < 0.05, "{vibration:?}");
            assert!((vibration.amplitude_mm[0] / mm - 1.0).abs() < 0.08, "{vibration:?}");
            let calm = shaking.without_vibration(&vibration);
            let plain = path(0.0, hz, 0.003);
            let worst = |i: usize| (calm.knots[i].pose[0] - plain.knots[i].pose[0]).abs();
            let left = (120..480).map(worst).fold(0.0, f64::max);
            assert!(left < 0.25 * mm, "{left} of {mm} mm at {hz} Hz");
        }
    }
}
