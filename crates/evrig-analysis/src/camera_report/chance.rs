//! Tail probabilities and intervals of counts.

use evrig_core::stats::Estimate;
use statrs::function::beta::beta_reg;
use statrs::function::erf::erfc;
use statrs::function::gamma::gamma_lr;

/// Family-wise level at which a finding is reported.
pub(super) const LEVEL: f64 = 0.01;

/// Level, in standard errors, of a check on half of the events. The place is fixed by then, so
/// that nothing is searched: one such check in 740 fails or passes by chance.
pub(super) const HALF_LEVEL_Z: f64 = 3.0;

/// Probability that a standard normal variable exceeds `z`.
pub(super) fn normal_tail(z: f64) -> f64 {
    0.5 * erfc(z / std::f64::consts::SQRT_2)
}

/// Probability that a Student variable with `dof` degrees of freedom exceeds `t`.
pub(super) fn student_tail(t: f64, dof: f64) -> f64 {
    if !t.is_finite() || dof <= 0.0 {
        return 1.0;
    }
    let tail = 0.5 * beta_reg(0.5 * dof, 0.5, dof / (dof + t * t));
    if t >= 0.0 { tail } else { 1.0 - tail }
}

/// Probability of `n` or more events of a Poisson law of mean `mean`.
pub(super) fn poisson_tail(n: u64, mean: f64) -> f64 {
    match (n, mean > 0.0) {
        (0, _) => 1.0,
        (_, false) => 0.0,
        (n, true) => gamma_lr(n as f64, mean),
    }
}

/// Probability of `k` or more hits of `n` with the probability `q` each.
pub(super) fn binomial_tail(k: u64, n: u64, q: f64) -> f64 {
    if k == 0 {
        return 1.0;
    }
    if k > n || q <= 0.0 {
        return 0.0;
    }
    beta_reg(k as f64, (n - k + 1) as f64, q.min(1.0))
}

/// Excess of `inside` over what `outside` predicts, in standard errors: the signed root of the
/// likelihood ratio of two Poisson counts whose exposures have the ratio `ratio` (Li and Ma, ApJ
/// 272 (1983) 317, equation 17).
pub(super) fn excess_z(inside: f64, outside: f64, ratio: f64) -> f64 {
    let all = inside + outside;
    if all <= 0.0 || ratio <= 0.0 {
        return 0.0;
    }
    let term = |n: f64, expected: f64| if n > 0.0 { n * (n / expected).ln() } else { 0.0 };
    let [expected_in, expected_out] = [all * ratio / (1.0 + ratio), all / (1.0 + ratio)];
    let deviance = 2.0 * (term(inside, expected_in) + term(outside, expected_out));
    deviance.max(0.0).sqrt().copysign(inside - expected_in)
}

/// Number of findings that Holm's procedure keeps at a family-wise level, of `n_tests` tests whose
/// smallest probabilities are given in ascending order.
pub(super) fn holm(ascending: &[f64], n_tests: usize, level: f64) -> usize {
    let passes = |(i, p): &(usize, &f64)| **p <= level / (n_tests.saturating_sub(*i)).max(1) as f64;
    ascending.iter().enumerate().take_while(passes).count()
}

/// A rate of `n` Poisson events in an exposure, with the exact 90 % interval (Garwood, Biometrika
/// 28 (1936) 437).
pub(super) fn poisson_rate(n: u64, exposure: f64) -> Estimate {
    if exposure <= 0.0 {
        return Estimate::unknown();
    }
    let low = if n == 0 { 0.0 } else { mean_with_tail(n, 0.05) };
    let high = mean_with_tail(n + 1, 0.95);
    let [value, error] = [n as f64 / exposure, (n as f64).sqrt() / exposure];
    Estimate::with_interval(value, error, [low / exposure, high / exposure], n)
}

/// The mean of the Poisson law by which `n` or more events have the probability `p`.
fn mean_with_tail(n: u64, p: f64) -> f64 {
    let (mut low, mut high) = (0.0, 2.0 * n as f64 + 20.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        let ends = if poisson_tail(n, middle) < p { (middle, high) } else { (low, middle) };
        (low, high) = ends;
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tails_agree_with_tables() {
        // `scipy.stats`: norm.sf(3), t.sf(2.5, 9), poisson.sf(9, 4.0), binom.sf(6, 20, 0.2).
        for (ours, scipy) in [
            (normal_tail(3.0), 1.349_898e-3),
            (student_tail(2.5, 9.0), 1.693_0e-2),
            (poisson_tail(10, 4.0), 8.132_2e-3),
            (binomial_tail(7, 20, 0.2), 8.669_3e-2),
        ] {
            assert!((ours / scipy - 1.0).abs() < 1e-3, "{ours} {scipy}");
        }
    }

    #[test]
    fn a_poisson_interval_is_garwoods() {
        // `scipy.stats.chi2.ppf([0.05], 20) / 2` and `chi2.ppf([0.95], 22) / 2`.
        let ten = poisson_rate(10, 1.0);
        assert!((ten.ci90[0] - 5.425_4).abs() < 1e-3 && (ten.ci90[1] - 16.962_2).abs() < 1e-3);
        assert!((poisson_rate(0, 1.0).ci90[1] - 2.995_7).abs() < 1e-3);
    }

    #[test]
    fn holm_stops_at_the_first_probability_that_is_too_large() {
        assert_eq!(holm(&[1e-6, 1e-4, 2e-3, 3e-3], 10, 0.01), 2);
        assert_eq!(holm(&[], 10, 0.01), 0);
    }

    #[test]
    fn an_excess_in_standard_errors_is_that_of_li_and_ma() {
        let z = excess_z(150.0, 1000.0, 0.1);
        assert!((z - 4.45).abs() < 0.1, "{z}");
        assert!(excess_z(50.0, 1000.0, 0.1) < -4.0);
    }
}
