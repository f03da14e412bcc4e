//! Crossings by the noise's own movement.
//!
//! A noisy signal crosses a level at the density of the noise there times the mean of its upward
//! speed (Rice, Bell Syst. Tech. J. 24, 1945). The signal's own upward speed is booked to the
//! running maximum; what is left is the part by which noise makes the mean upward speed greater.

use super::PixelLaw;
use super::softplus::{logistic, softplus};

/// Where the signal is too far below the threshold to count, in scales of the noise: there the
/// density is below a twenty thousandth of its greatest.
const OUT_OF_REACH: f64 = 10.0;

/// Over a passage this narrow, in scales of the noise, the middle's value stands for the mean of the
/// logistic function: it is off by less than a ten thousandth of it, and no digits cancel.
const NARROW: f64 = 0.1;

/// Where one straight passage ends and the next begins.
#[derive(Debug, Clone, Copy)]
pub(super) struct Corner {
    /// Change of the signal.
    change: f64,
    /// Integral of the logistic function up to there, On and Off, where a passage needed it.
    risen: [Option<f64>; 2],
}

impl Corner {
    pub(super) fn at(change: f64) -> Self {
        Self { change, risen: [None; 2] }
    }
}

/// The noise of one pixel during one interval.
#[derive(Debug, Clone, Copy)]
pub(super) struct Movement {
    noise: f64,
    /// Speed of the noise, log intensity a second.
    own: f64,
    theta: [f64; 2],
}

impl Movement {
    /// Of a pixel whose threshold scatters by `noise`; `None` where the noise does not move.
    pub(super) fn new(law: &PixelLaw, noise: f64) -> Option<Self> {
        let own = law.noise_speed_per_s * noise / law.noise_at_white;
        (own > 0.0).then_some(Self { noise, own, theta: [law.theta_on, law.theta_off] })
    }

    /// Whether changes this far, towards On and towards Off, come near enough to a threshold to count.
    pub(super) fn is_within_reach(&self, [up, down]: [f64; 2]) -> bool {
        let far = self.noise * OUT_OF_REACH;
        up > self.theta[0] - far || down > self.theta[1] - far
    }

    /// Hazard, a second, where the change towards the threshold is `y` and moves at `speed`.
    pub(super) fn hazard(&self, y: f64, speed: f64, on: bool) -> f64 {
        let z = (y - self.theta[usize::from(!on)]) / self.noise;
        if z < -OUT_OF_REACH {
            return 0.0;
        }
        self.excess(speed) * logistic(z) / self.noise
    }

    /// Adds what a straight passage to `change` spends, On and Off, and gives where it ends.
    pub(super) fn pass(
        &self,
        from: Corner,
        change: f64,
        seconds: f64,
        spent: &mut [f64; 2],
    ) -> Corner {
        let mut to = Corner::at(change);
        if seconds <= 0.0 {
            return to;
        }
        let speed = (change - from.change) / seconds;
        for (side, spent) in spent.iter_mut().enumerate() {
            let towards = if side == 0 { 1.0 } else { -1.0 };
            let z = |change: f64| (towards * change - self.theta[side]) / self.noise;
            let (begin, end) = (z(from.change), z(change));
            if begin.max(end) > -OUT_OF_REACH {
                let width = end - begin;
                let mean = if width.abs() < NARROW {
                    logistic(0.5 * (begin + end))
                } else {
                    let risen = softplus(end);
                    to.risen[side] = Some(risen);
                    (risen - from.risen[side].unwrap_or_else(|| softplus(begin))) / width
                };
                *spent += self.excess(speed) * seconds / self.noise * mean;
            }
        }
        to
    }

    /// By how much the noise raises the mean upward speed of a signal that moves at `speed`.
    fn excess(&self, speed: f64) -> f64 {
        0.5 * ((speed * speed + self.own * self.own).sqrt() - speed.abs())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_straight_passage_spends_what_its_parts_spend() {
        let law = PixelLaw { noise_at_white: 0.03, noise_speed_per_s: 0.6, ..PixelLaw::default() };
        let movement = Movement::new(&law, 0.03).unwrap();
        for [before, after] in [[0.0, 0.3], [0.2, -0.4], [0.22, 0.221], [0.1, 0.1]] {
            let (mut whole, mut parts) = ([0.0; 2], [0.0; 2]);
            movement.pass(Corner::at(before), after, 0.4, &mut whole);
            let at = |i: i32| before + (after - before) * f64::from(i) / 1000.0;
            let mut corner = Corner::at(before);
            for i in 0..1000 {
                corner = movement.pass(corner, at(i + 1), 0.4e-3, &mut parts);
            }
            for (whole, parts) in whole.iter().zip(parts) {
                assert!((whole - parts).abs() < 2e-4 * parts + 2e-5, "{whole} {parts}");
            }
        }
    }
}
