//! Crossings by the noise's own movement.
//!
//! A noisy signal crosses a level at the density of the noise there times the mean of its upward
//! speed (Rice, Bell Syst. Tech. J. 24, 1945). The signal's own upward speed is booked to the
//! running maximum; what is left is the part by which noise makes the mean upward speed greater.

use super::PixelLaw;
use super::threshold::logistic;

/// Where the signal is too far below the threshold to count, in scales of the noise: there the
/// density is below a twenty thousandth of its greatest.
const OUT_OF_REACH: f64 = 10.0;

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
        let excess = 0.5 * ((speed * speed + self.own * self.own).sqrt() - speed.abs());
        excess * logistic(z) / self.noise
    }

    /// Adds what a straight passage from `before` to `after` spends, On and Off.
    pub(super) fn pass(&self, [before, after]: [f64; 2], seconds: f64, spent: &mut [f64; 2]) {
        let middle = 0.5 * (before + after);
        let far = self.noise * OUT_OF_REACH;
        let near = [middle > self.theta[0] - far, -middle > self.theta[1] - far];
        if seconds > 0.0 && (near[0] || near[1]) {
            let speed = (after - before) / seconds;
            if near[0] {
                spent[0] += seconds * self.hazard(middle, speed, true);
            }
            if near[1] {
                spent[1] += seconds * self.hazard(-middle, speed, false);
            }
        }
    }
}
