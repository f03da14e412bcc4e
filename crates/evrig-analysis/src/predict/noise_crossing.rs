//! Crossings by the noise's own movement.
//!
//! A noisy signal crosses a level at the density of the noise there times the mean of its upward
//! speed (Rice, Bell Syst. Tech. J. 24, 1945). Of a threshold's scatter the signal's own upward speed is
//! booked to the running maximum; what is left is the part by which noise makes the mean upward speed
//! greater. Noise of the signal itself is booked here as a whole.

use super::softplus::{logistic, softplus};
use super::{PixelLaw, normal};

/// Over a passage this narrow, in scales of the noise, the middle's value stands for the mean of the
/// hazard: it is off by less than a ten thousandth of it, and no digits cancel.
const NARROW: f64 = 0.1;

/// Where one straight passage ends and the next begins.
#[derive(Debug, Clone, Copy)]
pub(super) struct Corner {
    /// Change of the signal.
    change: f64,
    /// Integral of the law's hazard up to there, On and Off; not a number where no passage needed it.
    risen: [f64; 2],
}

impl Corner {
    pub(super) fn at(change: f64) -> Self {
        Self { change, risen: [f64::NAN; 2] }
    }
}

/// The law of the noise: how often it is beyond a level, and how fast it comes there.
#[derive(Debug, Clone, Copy)]
enum Tail {
    /// Of thresholds, which scatter by a logistic law, and move a little. What the light's own rise brings
    /// to them is booked to its running maximum.
    Logistic,
    /// Of the signal: normal and fast, so that it comes to a level anew and anew, also with the light's
    /// rise.
    Normal,
}

impl Tail {
    /// Where the signal is too far below the threshold to count, in scales of the noise: there the
    /// hazard is below a twenty thousandth of that at the threshold.
    fn out_of_reach(self) -> f64 {
        match self {
            Self::Logistic => 10.0,
            Self::Normal => 5.0,
        }
    }

    fn hazard(self, z: f64) -> f64 {
        match self {
            Self::Logistic => logistic(z),
            Self::Normal => normal::hazard(z),
        }
    }

    /// Integral of the hazard up to `z`.
    fn spent(self, z: f64) -> f64 {
        match self {
            Self::Logistic => softplus(z),
            Self::Normal => normal::spent(z),
        }
    }

    /// Mean upward speed of a signal that rises by `speed` with noise that moves by `own` and does `share`
    /// of what it can, as far as it is booked here.
    fn upward(self, speed: f64, own: f64, share: f64) -> f64 {
        match self {
            Self::Logistic => share * 0.5 * ((speed * speed + own * own).sqrt() - speed.abs()),
            Self::Normal => {
                let all = own * normal::loss(speed / own);
                // The light rises whatever the noise does.
                let rise = speed.max(0.0);
                rise + share * (all - rise)
            }
        }
    }
}

/// The noise of one pixel during one interval.
#[derive(Debug, Clone, Copy)]
pub(super) struct Movement {
    tail: Tail,
    /// Scales of the noise for each unit of log intensity.
    per_noise: f64,
    /// Speed of the noise, log intensity a second.
    own: f64,
    theta: [f64; 2],
}

impl Movement {
    /// Of a pixel whose threshold scatters by `noise`; `None` where the noise does not move.
    pub(super) fn new(law: &PixelLaw, noise: f64) -> Option<Self> {
        let theta = [law.theta_on, law.theta_off];
        // The noise's speed grows as its size does.
        let grown = noise / law.noise_at_white;
        if law.shot_at_white > 0.0 {
            let (noise, own) = (law.shot(noise), law.shot_speed_per_s * grown);
            return (own > 0.0).then_some(Self::of(Tail::Normal, noise, own, theta));
        }
        let own = law.noise_speed_per_s * grown;
        (own > 0.0).then_some(Self::of(Tail::Logistic, noise, own, theta))
    }

    fn of(tail: Tail, noise: f64, own: f64, theta: [f64; 2]) -> Self {
        Self { tail, per_noise: noise.recip(), own, theta }
    }

    /// Whether changes this far, towards On and towards Off, come near enough to a threshold to count.
    pub(super) fn is_within_reach(&self, [up, down]: [f64; 2]) -> bool {
        let far = -self.tail.out_of_reach();
        (up - self.theta[0]) * self.per_noise > far || (down - self.theta[1]) * self.per_noise > far
    }

    /// Hazard, a second, where the change towards the threshold is `y` and moves at `speed`, the noise
    /// doing `share` of what it can.
    pub(super) fn hazard(&self, y: f64, speed: f64, on: bool, share: f64) -> f64 {
        let z = (y - self.theta[usize::from(!on)]) * self.per_noise;
        if z < -self.tail.out_of_reach() {
            return 0.0;
        }
        let speed = if on { speed } else { -speed };
        self.tail.upward(speed, self.own, share) * self.tail.hazard(z) * self.per_noise
    }

    /// Adds what a straight passage to `change` spends, On and Off, while the noise does `share` of what
    /// it can, and gives where it ends.
    #[inline]
    pub(super) fn pass(
        &self,
        from: Corner,
        change: f64,
        passage: [f64; 2],
        spent: &mut [f64; 2],
    ) -> Corner {
        let furthest = [from.change.max(change), -from.change.min(change)];
        // Most of a silence is too far from either threshold.
        if passage[0] > 0.0 && self.is_within_reach(furthest) {
            self.pass_near(from, change, passage, spent)
        } else {
            Corner::at(change)
        }
    }

    fn pass_near(
        &self,
        from: Corner,
        change: f64,
        [seconds, share]: [f64; 2],
        spent: &mut [f64; 2],
    ) -> Corner {
        let mut to = Corner::at(change);
        let tail = self.tail;
        let speed = (change - from.change) / seconds;
        for (side, spent) in spent.iter_mut().enumerate() {
            let towards = if side == 0 { 1.0 } else { -1.0 };
            let z = |change: f64| (towards * change - self.theta[side]) * self.per_noise;
            let (begin, end) = (z(from.change), z(change));
            if begin.max(end) > -tail.out_of_reach() {
                let width = end - begin;
                let mean = if width.abs() < NARROW {
                    tail.hazard(0.5 * (begin + end))
                } else {
                    let risen = tail.spent(end);
                    to.risen[side] = risen;
                    let known = from.risen[side];
                    (risen - if known.is_nan() { tail.spent(begin) } else { known }) / width
                };
                let upward = tail.upward(towards * speed, self.own, share);
                *spent += upward * seconds * self.per_noise * mean;
            }
        }
        to
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_straight_passage_spends_what_its_parts_spend() {
        let plain =
            PixelLaw { noise_at_white: 0.03, noise_speed_per_s: 0.6, ..PixelLaw::default() };
        let shot = PixelLaw { shot_at_white: 0.07, shot_speed_per_s: 40.0, ..plain };
        for law in [plain, shot] {
            let movement = Movement::new(&law, 0.03).unwrap();
            for [before, after] in [[0.0, 0.3], [0.2, -0.4], [0.22, 0.221], [0.1, 0.1]] {
                let (mut whole, mut parts) = ([0.0; 2], [0.0; 2]);
                movement.pass(Corner::at(before), after, [0.4, 1.0], &mut whole);
                let at = |i: i32| before + (after - before) * f64::from(i) / 1000.0;
                let mut corner = Corner::at(before);
                for i in 0..1000 {
                    corner = movement.pass(corner, at(i + 1), [0.4e-3, 1.0], &mut parts);
                }
                for (whole, parts) in whole.iter().zip(parts) {
                    assert!((whole - parts).abs() < 3e-4 * parts + 2e-5, "{whole} {parts}");
                }
            }
        }
    }

    /// Noise behind two low passes, at the threshold of a pixel that goes back to nothing at each event.
    #[test]
    fn noise_crosses_as_often_as_a_simulation_of_it_does() {
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
            let movement = Movement::new(&law, law.noise_at_white).unwrap();
            let mut spent = [0.0; 2];
            movement.pass(Corner::at(change), change + speed * seconds, [seconds, 1.0], &mut spent);
            let share = f64::from(silent as u32) / f64::from(n_runs);
            let expected = (-spent[0]).exp();
            // What is beyond the threshold at the begin does not count here, and crossings that come in
            // groups count one by one, which makes silence some hundredths less likely than it is.
            assert!((share - expected).abs() < 0.06, "{change} {speed}: {share} {expected}");
        }
    }
}
