//! The distribution of a threshold: the hazard of the running maximum that approaches it.

use super::softplus::{logistic, softplus};

/// Bound on the shape parameter, so that its powers stay finite.
const MAX_SHAPE: f64 = 1_000.0;
/// Odds of having fired below which a lost event is not considered.
const ONSET_ODDS: f64 = 0.02;

/// One polarity's threshold during one interval: log-logistic about its median. Its event is lost with
/// probability `drop_fraction`; the threshold has then fired without a recorded event.
#[derive(Debug, Clone, Copy)]
pub(super) struct Threshold {
    theta: f64,
    /// Median over scale.
    shape: f64,
    drop_fraction: f64,
    /// Maximum below which the threshold has hardly fired.
    onset: f64,
}

impl Threshold {
    /// With median `theta` and a scatter of scale `noise`.
    pub(super) fn new(theta: f64, noise: f64, drop_fraction: f64) -> Self {
        let shape = (theta / noise).clamp(1.0, MAX_SHAPE);
        let onset =
            if drop_fraction > 0.0 { theta * ONSET_ODDS.powf(shape.recip()) } else { theta };
        Self { theta, shape, drop_fraction, onset }
    }

    /// Minus the log-probability that the pixel has not fired by a running maximum.
    pub(super) fn cumulative_hazard(&self, maximum: f64) -> f64 {
        if maximum <= 0.0 {
            return 0.0;
        }
        softplus(self.shape * (maximum / self.theta).ln())
    }

    /// The running maximum at a cumulative hazard: the inverse of [`Self::cumulative_hazard`].
    pub(super) fn maximum_at(&self, hazard: f64) -> f64 {
        self.theta * hazard.exp_m1().powf(1.0 / self.shape)
    }

    /// Minus the log-probability that no event was recorded while the running maximum rose from
    /// `begin`, where the pixel had not fired, to `maximum`.
    pub(super) fn compensator(&self, begin: f64, maximum: f64) -> f64 {
        let fired = self.cumulative_hazard(maximum) - self.cumulative_hazard(begin);
        if self.drop_fraction <= 0.0 {
            return fired;
        }
        -(self.drop_fraction + (1.0 - self.drop_fraction) * (-fired).exp()).ln()
    }

    /// Hazard of a recorded event per unit of the running maximum, given no recorded event before.
    pub(super) fn hazard(&self, begin: f64, maximum: f64) -> f64 {
        if maximum <= 0.0 {
            return 0.0;
        }
        let z = self.shape * (maximum / self.theta).ln();
        let fires = self.shape / maximum * logistic(z);
        if self.drop_fraction <= 0.0 {
            return fires;
        }
        fires * (1.0 - self.drop_fraction) * (1.0 - self.lost_probability(begin, maximum))
    }

    /// Probability, given no recorded event, that the pixel has fired and its event was lost.
    pub(super) fn lost_probability(&self, begin: f64, maximum: f64) -> f64 {
        let fires = -(self.cumulative_hazard(begin) - self.cumulative_hazard(maximum)).exp_m1();
        let lost = self.drop_fraction * fires;
        lost / (lost + 1.0 - fires)
    }

    /// Whether the pixel may have fired by this maximum.
    pub(super) fn may_have_fired(&self, maximum: f64) -> bool {
        maximum >= self.onset
    }

    pub(super) fn theta(&self) -> f64 {
        self.theta
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_hazard_is_the_slope_of_the_compensator() {
        for drop_fraction in [0.0, 0.2] {
            let threshold = Threshold::new(0.25, 0.02, drop_fraction);
            for (begin, m) in [(0.0, 0.1), (0.1, 0.2), (0.0, 0.25), (0.2, 0.3), (0.0, 0.45)] {
                let step = 1e-6;
                let compensator = |m: f64| threshold.compensator(begin, m);
                let slope = (compensator(m + step) - compensator(m - step)) / (2.0 * step);
                let hazard = threshold.hazard(begin, m);
                assert!((slope - hazard).abs() < 1e-4 * hazard.max(1.0), "{m}: {slope} {hazard}");
            }
        }
    }

    #[test]
    fn half_of_the_thresholds_lie_below_the_median_and_some_events_are_lost() {
        let threshold = Threshold::new(0.25, 0.02, 0.0);
        assert!((threshold.compensator(0.0, 0.25) - 2.0_f64.ln()).abs() < 1e-12);
        let lossy = Threshold::new(0.25, 0.005, 0.3);
        assert!(
            ((-lossy.compensator(0.0, 0.37)).exp() - 0.3).abs() < 1e-3,
            "three in ten get past"
        );
        let fired = lossy.lost_probability(0.0, 0.25);
        assert!((fired - 0.15 / 0.65).abs() < 1e-9, "of 0.65 that are silent 0.15 have fired");
        assert!(lossy.may_have_fired(0.24) && !lossy.may_have_fired(0.22));
    }

    #[test]
    fn the_cumulative_hazard_is_inverted() {
        let threshold = Threshold::new(0.25, 0.02, 0.4);
        for spent in [1e-3, 0.1, 0.7, 2.0] {
            let back = threshold.cumulative_hazard(threshold.maximum_at(spent));
            assert!((back - spent).abs() < 1e-6, "{spent} came back as {back}");
        }
    }
}
