//! A constant with its errors.

use evrig_core::stats::Estimate;
use serde::{Deserialize, Serialize};
use statrs::distribution::{ContinuousCDF, StudentsT};

/// A fitted constant with the intervals that cover the truth in 90 % and 95 % of repetitions.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Constant {
    /// Value, standard error, 90 % interval, number of passages behind it.
    #[serde(flatten)]
    pub estimate: Estimate,
    /// Low and high end of the 95 % interval.
    pub ci95: [f64; 2],
}

impl Constant {
    /// From a standard error with `freedom` degrees of freedom (Student's t).
    #[must_use]
    pub fn new(value: f64, standard_error: f64, freedom: f64, n: u64) -> Self {
        let half = |quantile: f64| {
            let law = StudentsT::new(0.0, 1.0, freedom.max(1.0));
            law.map_or(f64::NAN, |law| law.inverse_cdf(quantile)) * standard_error
        };
        let ends = |half: f64| [value - half, value + half];
        let estimate = Estimate::with_interval(value, standard_error, ends(half(0.95)), n);
        Self { estimate, ci95: ends(half(0.975)) }
    }

    /// Whether the 95 % interval contains `truth`.
    #[must_use]
    pub fn covers(&self, truth: f64) -> bool {
        self.ci95[0] <= truth && truth <= self.ci95[1]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_tiles_widen_the_interval_as_student_t_requires() {
        // qt(0.975, 5) = 2.570582 in R.
        let constant = Constant::new(1.0, 0.1, 5.0, 7);
        assert!((constant.ci95[1] - 1.257_058_2).abs() < 1e-6);
        assert!(constant.covers(1.25) && !constant.covers(1.26));
    }
}
