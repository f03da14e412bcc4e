//! Threshold crossings caused by noise.
//!
//! A noisy signal crosses a level at the noise density there times the mean upward speed (Rice, Bell
//! Syst. Tech. J. 24, 1945). For threshold scatter, the signal's own upward speed is already accounted
//! for by its running maximum, so only the increase of the mean upward speed by noise counts here.
//! Signal noise is accounted for here as a whole.

use super::normal;
use super::pixel_law::PixelLaw;
use super::softplus::{logistic, softplus};

/// Change over a segment, in noise scales, below which the hazard at its middle stands for the mean:
/// the relative error is below 1e-4, and no digits cancel.
const NARROW: f64 = 0.1;

/// End of a linear segment.
#[derive(Debug, Clone, Copy)]
pub(super) struct SegmentEnd {
    change: f64,
    /// Cumulative hazard there, ON and OFF; NaN where it was not needed.
    hazard: [f64; 2],
}

impl SegmentEnd {
    pub(super) fn at(change: f64) -> Self {
        Self { change, hazard: [f64::NAN; 2] }
    }
}

#[derive(Debug, Clone, Copy)]
enum NoiseKind {
    /// Scatter of the thresholds, which drift slowly.
    Threshold,
    /// Noise of the signal: normal and fast, so that it approaches a level again and again.
    Signal,
}

impl NoiseKind {
    /// Distance below the threshold, in noise scales, beyond which the hazard is negligible: less than
    /// 1/20 000 of that at the threshold.
    fn cutoff(self) -> f64 {
        match self {
            Self::Threshold => 10.0,
            Self::Signal => 5.0,
        }
    }

    fn hazard(self, z: f64) -> f64 {
        match self {
            Self::Threshold => logistic(z),
            Self::Signal => normal::hazard(z),
        }
    }

    fn cumulative_hazard(self, z: f64) -> f64 {
        match self {
            Self::Threshold => softplus(z),
            Self::Signal => normal::cumulative_hazard(z),
        }
    }

    /// Mean upward speed that counts here, of a signal of slope `speed` with noise of rms speed
    /// `noise_speed`, of which `share` is active.
    fn upward_speed(self, speed: f64, noise_speed: f64, share: f64) -> f64 {
        match self {
            Self::Threshold => {
                share * 0.5 * ((speed * speed + noise_speed * noise_speed).sqrt() - speed.abs())
            }
            Self::Signal => {
                let all = noise_speed * normal::linear_loss(speed / noise_speed);
                let rise = speed.max(0.0);
                rise + share * (all - rise)
            }
        }
    }
}

/// The noise of one pixel during one interval between events.
#[derive(Debug, Clone, Copy)]
pub(super) struct NoiseCrossing {
    kind: NoiseKind,
    /// Reciprocal of the noise scale, per log intensity.
    per_noise: f64,
    /// Rms speed of the noise, log intensity per second.
    noise_speed: f64,
    theta: [f64; 2],
}

impl NoiseCrossing {
    /// For a threshold scatter of scale `noise`; `None` for noise without speed.
    pub(super) fn new(law: &PixelLaw, noise: f64) -> Option<Self> {
        let theta = [law.theta_on, law.theta_off];
        // The noise's speed is proportional to its scale.
        let growth = noise / law.noise_at_white;
        let (kind, noise, noise_speed) = if law.shot_at_white > 0.0 {
            (NoiseKind::Signal, law.shot(noise), law.shot_speed_per_s * growth)
        } else {
            (NoiseKind::Threshold, noise, law.noise_speed_per_s * growth)
        };
        (noise_speed > 0.0).then_some(Self { kind, per_noise: noise.recip(), noise_speed, theta })
    }

    /// Whether changes towards ON and OFF come near enough to a threshold to count.
    pub(super) fn is_within_reach(&self, [up, down]: [f64; 2]) -> bool {
        let far = -self.kind.cutoff();
        (up - self.theta[0]) * self.per_noise > far || (down - self.theta[1]) * self.per_noise > far
    }

    /// Hazard per second at a change `y` towards the threshold and a slope `speed` of the signal, of
    /// which noise `share` is active.
    pub(super) fn hazard(&self, y: f64, speed: f64, on: bool, share: f64) -> f64 {
        let z = (y - self.theta[usize::from(!on)]) * self.per_noise;
        if z < -self.kind.cutoff() {
            return 0.0;
        }
        let speed = if on { speed } else { -speed };
        self.kind.upward_speed(speed, self.noise_speed, share)
            * self.kind.hazard(z)
            * self.per_noise
    }

    /// Adds the compensator of a linear segment to `change`, ON and OFF, and returns its end. The
    /// segment is given by its seconds and the active share of the noise.
    #[inline]
    pub(super) fn integrate(
        &self,
        from: SegmentEnd,
        change: f64,
        segment: [f64; 2],
        compensator: &mut [f64; 2],
    ) -> SegmentEnd {
        let extremes = [from.change.max(change), -from.change.min(change)];
        // Most of a silence is too far from either threshold.
        if segment[0] > 0.0 && self.is_within_reach(extremes) {
            self.integrate_near(from, change, segment, compensator)
        } else {
            SegmentEnd::at(change)
        }
    }

    fn integrate_near(
        &self,
        from: SegmentEnd,
        change: f64,
        [seconds, share]: [f64; 2],
        compensator: &mut [f64; 2],
    ) -> SegmentEnd {
        let mut to = SegmentEnd::at(change);
        let kind = self.kind;
        let speed = (change - from.change) / seconds;
        for (side, compensator) in compensator.iter_mut().enumerate() {
            let sign = if side == 0 { 1.0 } else { -1.0 };
            let z = |change: f64| (sign * change - self.theta[side]) * self.per_noise;
            let (begin, end) = (z(from.change), z(change));
            if begin.max(end) > -kind.cutoff() {
                let width = end - begin;
                let mean = if width.abs() < NARROW {
                    kind.hazard(0.5 * (begin + end))
                } else {
                    let at_end = kind.cumulative_hazard(end);
                    to.hazard[side] = at_end;
                    let known = from.hazard[side];
                    let at_begin =
                        if known.is_nan() { kind.cumulative_hazard(begin) } else { known };
                    (at_end - at_begin) / width
                };
                let upward = kind.upward_speed(sign * speed, self.noise_speed, share);
                *compensator += upward * seconds * self.per_noise * mean;
            }
        }
        to
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_compensator_of_a_segment_is_the_sum_of_its_parts() {
        let plain =
            PixelLaw { noise_at_white: 0.03, noise_speed_per_s: 0.6, ..PixelLaw::default() };
        let shot = PixelLaw { shot_at_white: 0.07, shot_speed_per_s: 40.0, ..plain };
        for law in [plain, shot] {
            let noise = NoiseCrossing::new(&law, 0.03).unwrap();
            for [before, after] in [[0.0, 0.3], [0.2, -0.4], [0.22, 0.221], [0.1, 0.1]] {
                let (mut whole, mut parts) = ([0.0; 2], [0.0; 2]);
                noise.integrate(SegmentEnd::at(before), after, [0.4, 1.0], &mut whole);
                let at = |i: i32| before + (after - before) * f64::from(i) / 1000.0;
                let mut end = SegmentEnd::at(before);
                for i in 0..1000 {
                    end = noise.integrate(end, at(i + 1), [0.4e-3, 1.0], &mut parts);
                }
                for (whole, parts) in whole.iter().zip(parts) {
                    assert!((whole - parts).abs() < 3e-4 * parts + 2e-5, "{whole} {parts}");
                }
            }
        }
    }

    /// Noise behind two low passes against one threshold.
    #[test]
    fn the_crossing_rate_agrees_with_a_simulation() {
        let (rms, tau) = (0.3_f64, 1e-3_f64);
        let (dt, follower) = (1e-5, 3.0);
        // Variance of the second state, and that of its slope, with poles at 1 and 3 over tau.
        let second = follower / (1.0 + follower);
        let mut random = evrig_core::stats::SplitMix::new(5, 5);
        for (change, speed) in [(0.0, 0.0), (0.25, 0.0), (-0.4, 60.0)] {
            let (n_runs, seconds) = (4_000, 0.02);
            let mut silent = 0;
            for _ in 0..n_runs {
                let kept = (-dt / tau).exp();
                let fresh = (1.0 - kept * kept).sqrt();
                let mut state = [random.normal(), 0.0];
                for _ in 0..1_000 {
                    state[0] = kept * state[0] + fresh * random.normal();
                    state[1] += (state[0] - state[1]) * follower * dt / tau;
                }
                let n_steps = (seconds / dt) as usize;
                let is_silent = (0..n_steps).all(|i| {
                    state[0] = kept * state[0] + fresh * random.normal();
                    state[1] += (state[0] - state[1]) * follower * dt / tau;
                    let signal = change + speed * dt * i as f64;
                    signal + rms * state[1] / second.sqrt() < 1.0
                });
                silent += usize::from(is_silent);
            }
            let law = PixelLaw {
                theta_on: 1.0,
                theta_off: 9.0,
                shot_at_white: rms,
                shot_speed_per_s: rms * follower.sqrt() / tau,
                ..PixelLaw::default()
            };
            let noise = NoiseCrossing::new(&law, law.noise_at_white).unwrap();
            let mut compensator = [0.0; 2];
            noise.integrate(
                SegmentEnd::at(change),
                change + speed * seconds,
                [seconds, 1.0],
                &mut compensator,
            );
            let share = f64::from(silent as u32) / f64::from(n_runs);
            let expected = (-compensator[0]).exp();
            // Rice's rate counts clustered crossings separately, which lowers the silence probability.
            assert!((share - expected).abs() < 0.06, "{change} {speed}: {share} {expected}");
        }
    }
}
