//! The law of a threshold: the hazard of the running maximum that approaches it.

use super::softplus::{logistic, softplus};

/// Bound on the steepness of a threshold's law, so that its powers stay finite numbers.
const STEEPEST: f64 = 1_000.0;

/// Odds of having fired at which a threshold begins to.
const BEGINS: f64 = 0.02;

/// One polarity's threshold during one interval: log-logistic about its median. What it sets off is lost
/// with some chance; then nothing is seen, and it is spent.
#[derive(Debug, Clone, Copy)]
pub(super) struct Threshold {
    theta: f64,
    /// Median over scale: how sharp the threshold is.
    steepness: f64,
    drop_fraction: f64,
    /// Below this maximum it has hardly fired.
    begins: f64,
}

impl Threshold {
    /// About the median `theta`, with scatter of the scale `noise`.
    pub(super) fn new(theta: f64, noise: f64, drop_fraction: f64) -> Self {
        let steepness = (theta / noise).clamp(1.0, STEEPEST);
        // Where no event is lost nobody asks.
        let begins =
            if drop_fraction > 0.0 { theta * BEGINS.powf(steepness.recip()) } else { theta };
        Self { theta, steepness, drop_fraction, begins }
    }

    /// Minus the logarithm of the chance that the pixel has not fired while the running maximum came from
    /// 0 to `maximum`.
    pub(super) fn spent(&self, maximum: f64) -> f64 {
        if maximum <= 0.0 {
            return 0.0;
        }
        softplus(self.steepness * (maximum / self.theta).ln())
    }

    /// Where the running maximum has spent `spent`: the inverse of [`Self::spent`].
    pub(super) fn at_spent(&self, spent: f64) -> f64 {
        // e^spent - 1, which overflows only far beyond any signal.
        self.theta * spent.exp_m1().powf(1.0 / self.steepness)
    }

    /// Minus the logarithm of the chance that no event was seen while the running maximum came from
    /// `begin`, where the pixel had not fired, to `maximum`.
    pub(super) fn silence(&self, begin: f64, maximum: f64) -> f64 {
        let fired = self.spent(maximum) - self.spent(begin);
        if self.drop_fraction <= 0.0 {
            return fired;
        }
        -(self.drop_fraction + (1.0 - self.drop_fraction) * (-fired).exp()).ln()
    }

    /// Hazard of an event that is seen, per unit of the running maximum, behind such a silence.
    pub(super) fn hazard(&self, begin: f64, maximum: f64) -> f64 {
        if maximum <= 0.0 {
            return 0.0;
        }
        let z = self.steepness * (maximum / self.theta).ln();
        let fires = self.steepness / maximum * logistic(z);
        if self.drop_fraction <= 0.0 {
            return fires;
        }
        fires * (1.0 - self.drop_fraction) * (1.0 - self.fired_unseen(begin, maximum))
    }

    /// Chance behind such a silence that the pixel has fired and its event was lost.
    pub(super) fn fired_unseen(&self, begin: f64, maximum: f64) -> f64 {
        let fires = -(self.spent(begin) - self.spent(maximum)).exp_m1();
        let lost = self.drop_fraction * fires;
        lost / (lost + 1.0 - fires)
    }

    /// Whether the pixel may have fired by this maximum.
    pub(super) fn may_have_fired(&self, maximum: f64) -> bool {
        maximum >= self.begins
    }

    /// The median.
    pub(super) fn theta(&self) -> f64 {
        self.theta
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_hazard_is_the_slope_of_what_a_silence_has_spent() {
        for drop_fraction in [0.0, 0.2] {
            let threshold = Threshold::new(0.25, 0.02, drop_fraction);
            for (begin, m) in [(0.0, 0.1), (0.1, 0.2), (0.0, 0.25), (0.2, 0.3), (0.0, 0.45)] {
                let step = 1e-6;
                let silence = |m: f64| threshold.silence(begin, m);
                let slope = (silence(m + step) - silence(m - step)) / (2.0 * step);
                let hazard = threshold.hazard(begin, m);
                assert!((slope - hazard).abs() < 1e-4 * hazard.max(1.0), "{m}: {slope} {hazard}");
            }
        }
    }

    #[test]
    fn half_of_the_thresholds_lie_below_the_median_and_some_events_are_not_seen() {
        let threshold = Threshold::new(0.25, 0.02, 0.0);
        assert!((threshold.silence(0.0, 0.25) - 2.0_f64.ln()).abs() < 1e-12);
        let lossy = Threshold::new(0.25, 0.005, 0.3);
        assert!(((-lossy.silence(0.0, 0.37)).exp() - 0.3).abs() < 1e-3, "three in ten get past");
        let fired = lossy.fired_unseen(0.0, 0.25);
        assert!((fired - 0.15 / 0.65).abs() < 1e-9, "of 0.65 that are silent 0.15 have fired");
        assert!(lossy.may_have_fired(0.24) && !lossy.may_have_fired(0.22));
    }

    #[test]
    fn what_was_spent_can_be_undone() {
        let threshold = Threshold::new(0.25, 0.02, 0.4);
        for spent in [1e-3, 0.1, 0.7, 2.0] {
            let back = threshold.spent(threshold.at_spent(spent));
            assert!((back - spent).abs() < 1e-6, "{spent} came back as {back}");
        }
    }
}
