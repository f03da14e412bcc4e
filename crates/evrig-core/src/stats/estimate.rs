//! An estimate with its uncertainty.

use serde::{Deserialize, Serialize};

/// A value with its standard error, interval and sample size.
///
/// JSON knows no NaN: what is not known is `null` there, and [`read_back`](super::read_back())
/// reads it as NaN.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Estimate {
    /// The best value; NaN when there were no samples to form one.
    pub value: f64,
    /// Standard error of the value; NaN when it is unknown.
    pub standard_error: f64,
    /// Interval that covers the truth in 90 % of repetitions, low and high end.
    pub ci90: [f64; 2],
    /// Number of samples used.
    pub n: u64,
}

/// Half width of a 90 % interval of the normal law, in standard errors.
pub const Z90: f64 = 1.644_853_626_951_472_7;

impl Estimate {
    /// A normal estimate: the interval follows from the standard error.
    #[must_use]
    pub fn normal(value: f64, standard_error: f64, n: u64) -> Self {
        let half = Z90 * standard_error;
        Self { value, standard_error, ci90: [value - half, value + half], n }
    }

    /// A value with an interval of its own, as a bootstrap or a profile gives it.
    #[must_use]
    pub fn with_interval(value: f64, standard_error: f64, ci90: [f64; 2], n: u64) -> Self {
        Self { value, standard_error, ci90, n }
    }

    /// The estimate from no samples.
    #[must_use]
    pub fn unknown() -> Self {
        Self { value: f64::NAN, standard_error: f64::NAN, ci90: [f64::NAN; 2], n: 0 }
    }

    /// Whether the value and its error are finite numbers.
    #[must_use]
    pub fn is_known(&self) -> bool {
        self.value.is_finite() && self.standard_error.is_finite()
    }

    /// Whether the 90 % interval contains `truth`.
    #[must_use]
    pub fn covers(&self, truth: f64) -> bool {
        self.ci90[0] <= truth && truth <= self.ci90[1]
    }

    /// An estimate from replicates of the same statistic (bootstrap, jackknife blocks):
    /// their standard deviation is the error, their 5 % and 95 % quantiles the interval.
    #[must_use]
    pub fn from_replicates(value: f64, replicates: &mut [f64], n: u64) -> Self {
        let moments: super::Moments = replicates.iter().copied().collect();
        replicates.sort_by(f64::total_cmp);
        let low = super::quantile_sorted(replicates, 0.05);
        let high = super::quantile_sorted(replicates, 0.95);
        Self::with_interval(value, moments.standard_deviation(), [low, high], n)
    }
}

impl std::fmt::Display for Estimate {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let digits = f.precision().unwrap_or(3);
        if !self.value.is_finite() {
            write!(f, "unknown (n = {})", self.n)
        } else if self.standard_error.is_finite() {
            write!(f, "{:.digits$} ± {:.digits$}", self.value, self.standard_error)
        } else {
            write!(f, "{:.digits$} (error unknown)", self.value)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_normal_estimate_covers_its_own_value_and_not_a_far_one() {
        let estimate = Estimate::normal(2.0, 0.1, 100);
        assert!(estimate.covers(2.0));
        assert!(!estimate.covers(2.2));
        // qnorm(0.95) = 1.644853627 in R.
        assert!((estimate.ci90[1] - 2.164_485_362_7).abs() < 1e-9);
    }

    #[test]
    fn replicates_give_spread_and_quantiles() {
        let mut replicates: Vec<f64> = (0..=100).map(f64::from).collect();
        let estimate = Estimate::from_replicates(50.0, &mut replicates, 7);
        assert_eq!(estimate.ci90, [5.0, 95.0]);
        assert!((estimate.standard_error - 29.300_170).abs() < 1e-5);
    }

    #[test]
    fn what_is_unknown_is_null_in_json_and_reads_back() {
        let json = serde_json::to_string(&Estimate::unknown()).unwrap();
        assert_eq!(json, r#"{"value":null,"standard_error":null,"ci90":[null,null],"n":0}"#);
        let back: Estimate = super::super::read_back(&json).unwrap();
        assert!(back.value.is_nan() && back.ci90[1].is_nan() && !back.is_known());
    }

    #[test]
    fn no_samples_print_as_unknown() {
        assert_eq!(Estimate::unknown().to_string(), "unknown (n = 0)");
    }
}
