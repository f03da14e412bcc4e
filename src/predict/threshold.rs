//! The law of a threshold: the hazard of the running maximum that approaches it.

/// Bound on the steepness of a threshold's law, so that its powers stay finite numbers.
const STEEPEST: f64 = 1_000.0;

/// How many lost events in a row are followed up.
const MAX_LOST: usize = 6;

/// One polarity's threshold during one interval: log-logistic about its median, and with lost
/// events a mixture over how many the pixel has fired unseen.
#[derive(Debug, Clone, Copy)]
pub(super) struct Threshold {
    theta: f64,
    /// Median over scale: how sharp the threshold is.
    steepness: f64,
    drop_fraction: f64,
}

/// `ln(1 + e^z)` without overflow.
pub(super) fn softplus(z: f64) -> f64 {
    z.max(0.0) + (-z.abs()).exp().ln_1p()
}

/// `1 / (1 + e^-z)`.
pub(super) fn logistic(z: f64) -> f64 {
    1.0 / (1.0 + (-z).exp())
}

impl Threshold {
    /// About the median `theta`, with scatter of the scale `noise`.
    pub(super) fn new(theta: f64, noise: f64, drop_fraction: f64) -> Self {
        Self { theta, steepness: (theta / noise).clamp(1.0, STEEPEST), drop_fraction }
    }

    /// What the running maximum has spent on its way from 0 to `maximum`: minus the logarithm of
    /// the chance that no event has come.
    pub(super) fn spent(&self, maximum: f64) -> f64 {
        if maximum <= 0.0 {
            return 0.0;
        }
        if self.drop_fraction <= 0.0 {
            return softplus(self.steepness * (maximum / self.theta).ln());
        }
        -self.with_losses(maximum).0.ln()
    }

    /// Hazard per unit of the running maximum.
    pub(super) fn hazard(&self, maximum: f64) -> f64 {
        if maximum <= 0.0 {
            return 0.0;
        }
        if self.drop_fraction <= 0.0 {
            let z = self.steepness * (maximum / self.theta).ln();
            return self.steepness / maximum * logistic(z);
        }
        let (survival, density) = self.with_losses(maximum);
        density / survival
    }

    /// Where the running maximum has spent `spent`: the inverse of [`Self::spent`]. Infinite when
    /// every event of the row is lost.
    pub(super) fn at_spent(&self, spent: f64) -> f64 {
        if self.drop_fraction <= 0.0 {
            // e^spent - 1, which overflows only far beyond any signal.
            return self.theta * spent.exp_m1().powf(1.0 / self.steepness);
        }
        let mut high = self.theta * (MAX_LOST + 2) as f64;
        if self.spent(high) < spent {
            return f64::INFINITY;
        }
        let mut low = 0.0;
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if self.spent(middle) < spent { low = middle } else { high = middle }
        }
        0.5 * (low + high)
    }

    /// Survival and density when the n-th crossing is the first that is not lost. The n-th lies at
    /// n thresholds, its scatter grown by the root of n.
    fn with_losses(&self, maximum: f64) -> (f64, f64) {
        let (mut survival, mut density) = (0.0, 0.0);
        let mut weight = 1.0 - self.drop_fraction;
        let mut rest = 1.0;
        for n in 1..=MAX_LOST {
            let n = n as f64;
            let weight_here = if n as usize == MAX_LOST { rest } else { weight };
            let steepness = self.steepness * n.sqrt();
            let z = steepness * (maximum / (n * self.theta)).ln();
            let alive = logistic(-z);
            survival += weight_here * alive;
            density += weight_here * alive * logistic(z) * steepness / maximum;
            rest -= weight;
            weight *= self.drop_fraction;
        }
        (survival.max(1e-300), density)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_hazard_is_the_slope_of_what_was_spent() {
        for drop_fraction in [0.0, 0.2] {
            let threshold = Threshold::new(0.25, 0.02, drop_fraction);
            for m in [0.1, 0.2, 0.25, 0.3, 0.45, 0.55, 0.9] {
                let step = 1e-6;
                let slope = (threshold.spent(m + step) - threshold.spent(m - step)) / (2.0 * step);
                let hazard = threshold.hazard(m);
                assert!((slope - hazard).abs() < 1e-4 * hazard.max(1.0), "{m}: {slope} {hazard}");
            }
        }
    }

    #[test]
    fn half_of_the_thresholds_lie_below_the_median_and_losses_move_mass_to_its_multiples() {
        let threshold = Threshold::new(0.25, 0.02, 0.0);
        assert!((threshold.spent(0.25) - 2.0_f64.ln()).abs() < 1e-12);
        let lossy = Threshold::new(0.25, 0.005, 0.3);
        assert!(((-lossy.spent(0.37)).exp() - 0.3).abs() < 1e-3, "three in ten get past the first");
        assert!(((-lossy.spent(0.62)).exp() - 0.09).abs() < 1e-3, "nine in a hundred past two");
    }

    #[test]
    fn what_was_spent_can_be_undone() {
        for drop_fraction in [0.0, 0.4] {
            let threshold = Threshold::new(0.25, 0.02, drop_fraction);
            for spent in [1e-3, 0.1, 0.7, 2.0] {
                let back = threshold.spent(threshold.at_spent(spent));
                assert!((back - spent).abs() < 1e-6, "{spent} came back as {back}");
            }
        }
    }
}
