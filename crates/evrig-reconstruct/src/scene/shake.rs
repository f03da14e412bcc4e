//! A head that shakes: a line in the spectrum of the path.
//!
//! The frames follow the head, so the light has the shaking in it. What the arm was told and reports
//! has not, which makes it a departure from what a session states.

use super::path::{HeadPath, PathKnot};
use nalgebra::{SMatrix, SVector};
use std::f64::consts::{PI, TAU};

/// The path without what changes slowly: standard deviation of the time smoothed over, seconds.
const SLOW_S: f64 = 0.03;

/// Below this the arm's own motion shows.
const LOWEST_HZ: f64 = 5.0;

/// Share of the frame rate up to which frames follow.
const HIGHEST: f64 = 0.45;

/// A line has to be so many times as strong as its surroundings.
const CLEAR: f64 = 40.0;

/// Lines on either side that are the surroundings, and those next to a line that are not.
const AROUND: usize = 40;
const OWN: usize = 4;

/// Swings about an instant from which its amplitude is taken.
const SWINGS: f64 = 2.0;

/// Fewest frames with which a spectrum is one.
const LEAST_KNOTS: usize = 120;

/// A swing of the head.
#[derive(Debug, Clone, Default)]
pub struct Shake {
    /// Swings a second, and the standard error.
    pub frequency_hz: [f64; 2],
    /// Amplitude while it shakes, millimetres, and the standard error.
    pub amplitude_mm: [f64; 2],
    /// The line over its surroundings, amplitudes.
    pub clearness: f64,
    /// What it adds to the place of the head at each knot.
    swings: Vec<[f64; 2]>,
}

/// What is left of a path without its slow part, and the times.
struct Fast {
    times: Vec<f64>,
    places: Vec<[f64; 2]>,
}

impl HeadPath {
    /// The shaking of the head, if a line stands out of the path's spectrum.
    #[must_use]
    pub fn shake(&self) -> Option<Shake> {
        let fast = Fast::of(&self.knots)?;
        let seconds = fast.times[fast.times.len() - 1] - fast.times[0];
        let rate = (fast.times.len() - 1) as f64 / seconds;
        let resolution = 0.25 / seconds;
        let n = ((HIGHEST * rate - LOWEST_HZ) / resolution).max(0.0) as usize;
        let hz = |i: usize| LOWEST_HZ + i as f64 * resolution;
        let powers: Vec<f64> = (0..n).map(|i| fast.power(hz(i))).collect();
        let best = (0..n).max_by(|&a, &b| powers[a].total_cmp(&powers[b]))?;
        let mut near: Vec<f64> = (best.saturating_sub(AROUND)..n.min(best + AROUND + 1))
            .filter(|i| i.abs_diff(best) > OWN * 4)
            .map(|i| powers[i])
            .collect();
        let common = evrig_core::stats::upper_median(&mut near)?;
        let clearness = (powers[best] / common.max(f64::MIN_POSITIVE)).sqrt();
        if clearness * clearness < CLEAR {
            return None;
        }
        let frequency = fast.peak(hz(best), resolution);
        let swings = fast.swings(frequency, passed(frequency));
        let mut sizes: Vec<f64> = swings.iter().map(|swing| swing.1).collect();
        sizes.sort_by(f64::total_cmp);
        // While the head stands it does not shake: the upper half is of its motion.
        let amplitude = sizes[sizes.len() * 3 / 4];
        let spread = sizes[sizes.len() * 7 / 8] - sizes[sizes.len() * 5 / 8];
        Some(Shake {
            frequency_hz: [frequency, 0.25 / (seconds * clearness.min(30.0))],
            amplitude_mm: [amplitude, (0.5 * spread).max(0.02 * amplitude)],
            clearness,
            swings: swings.into_iter().map(|swing| swing.0).collect(),
        })
    }

    /// The same path without a shaking that was found in it.
    #[must_use]
    pub fn without(&self, shake: &Shake) -> Self {
        let mut knots = self.knots.clone();
        for (knot, swing) in knots.iter_mut().zip(&shake.swings) {
            knot.pose[0] -= swing[0];
            knot.pose[1] -= swing[1];
        }
        Self::new(self.zero, knots, self.max_gap)
    }
}

/// Share of a swing that is left when the slow part of a path is taken off.
fn passed(hz: f64) -> f64 {
    1.0 - (-2.0 * (PI * SLOW_S * hz).powi(2)).exp()
}

impl Fast {
    fn of(knots: &[PathKnot]) -> Option<Self> {
        if knots.len() < LEAST_KNOTS {
            return None;
        }
        let times: Vec<f64> = knots.iter().map(|knot| knot.time_s).collect();
        let reach = 4.0 * SLOW_S;
        let place = |at: usize| {
            let first = times.partition_point(|t| *t < times[at] - reach);
            let around = times[first..].iter().take_while(|t| **t <= times[at] + reach);
            let (mut sum, mut mean) = (0.0, [0.0; 2]);
            for (knot, t) in knots[first..].iter().zip(around) {
                let weight = (-0.5 * ((t - times[at]) / SLOW_S).powi(2)).exp();
                sum += weight;
                mean = [0, 1].map(|axis| mean[axis] + weight * knot.pose[axis]);
            }
            [0, 1].map(|axis| knots[at].pose[axis] - mean[axis] / sum)
        };
        // At either end the mean is of one side.
        let margin = times.partition_point(|t| *t < times[0] + reach);
        let mut places: Vec<[f64; 2]> = (0..times.len()).map(place).collect();
        let n = places.len();
        places[..margin.min(n)].fill([0.0; 2]);
        places[n - margin.min(n)..].fill([0.0; 2]);
        Some(Self { times, places })
    }

    /// Power at a frequency, under a window that falls to nothing at both ends.
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

    /// The frequency of the greatest power beside `hz`.
    fn peak(&self, hz: f64, step: f64) -> f64 {
        let [left, here, right] = [hz - step, hz, hz + step].map(|f| self.power(f));
        let bend = left - 2.0 * here + right;
        if bend < 0.0 { hz + 0.5 * step * (left - right) / bend } else { hz }
    }

    /// The swing at each knot and its amplitude, from those around it; `passed` is what the slow part
    /// left of it.
    fn swings(&self, hz: f64, passed: f64) -> Vec<([f64; 2], f64)> {
        let reach = SWINGS / hz;
        let swing = |at: usize| {
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
            let of = right.map(|right| solver.solve(&right) / passed);
            let square: f64 = of.iter().map(|of| of[3].powi(2) + of[4].powi(2)).sum();
            (of.map(|of| of[3]), square.sqrt())
        };
        (0..self.times.len()).map(swing).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use evrig_core::time::{Span, Stamp};

    /// Two turns of a circle between two rests, with a swing while it moves.
    fn path(swing_mm: f64, hz: f64, noise_mm: f64) -> HeadPath {
        let mut random = evrig_core::stats::SplitMix::new(4, 4);
        let knots = (0..600).map(|i| {
            let t = f64::from(i) / 120.0;
            let phase = PI * (t - 0.5).clamp(0.0, 4.0);
            let moves = f64::from(u8::from((0.5..4.5).contains(&t)));
            let swing = moves * swing_mm * (TAU * hz * t).sin();
            let noise = [0, 1].map(|_| noise_mm * 3.5 * (random.uniform() - 0.5));
            let pose = [
                30.0 * phase.cos() + 0.8 * swing + noise[0],
                30.0 * phase.sin() + 0.6 * swing + noise[1],
                225.0,
                0.0,
            ];
            PathKnot { time_s: t, pose, pose_error: [0.0; 4], ln_gain: 0.0, misfit: 1.0 }
        });
        HeadPath::new(Stamp::from_nanos(0), knots.collect(), Span::from_micros(50_000))
    }

    #[test]
    fn a_swing_is_found_and_taken_off_and_a_plain_circle_has_none() {
        assert!(path(0.0, 12.0, 0.003).shake().is_none());
        for (mm, hz) in [(0.06, 12.0), (0.2, 23.0), (0.1, 40.0)] {
            let shaking = path(mm, hz, 0.003);
            let shake = shaking.shake().unwrap();
            assert!((shake.frequency_hz[0] - hz).abs() < 0.05, "{shake:?}");
            assert!((shake.amplitude_mm[0] / mm - 1.0).abs() < 0.08, "{shake:?}");
            let calm = shaking.without(&shake);
            let plain = path(0.0, hz, 0.003);
            let worst = |i: usize| (calm.knots[i].pose[0] - plain.knots[i].pose[0]).abs();
            let left = (120..480).map(worst).fold(0.0, f64::max);
            assert!(left < 0.25 * mm, "{left} of {mm} mm at {hz} Hz");
        }
    }
}
