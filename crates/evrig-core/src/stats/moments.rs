//! Mean and variance in one pass, and quantiles of sorted samples.

/// Running mean and variance by Welford's recurrence (Technometrics 4, 1962).
#[derive(Debug, Clone, Copy, Default)]
pub struct Moments {
    n: u64,
    mean: f64,
    sum_of_squares: f64,
}

impl Moments {
    /// Takes in one sample.
    pub fn push(&mut self, sample: f64) {
        self.n += 1;
        let from_old_mean = sample - self.mean;
        self.mean += from_old_mean / self.n as f64;
        self.sum_of_squares += from_old_mean * (sample - self.mean);
    }

    /// Number of samples.
    #[must_use]
    pub fn count(&self) -> u64 {
        self.n
    }

    /// Mean of the samples; NaN without any.
    #[must_use]
    pub fn mean(&self) -> f64 {
        if self.n == 0 { f64::NAN } else { self.mean }
    }

    /// Unbiased variance; NaN below two samples.
    #[must_use]
    pub fn variance(&self) -> f64 {
        if self.n < 2 { f64::NAN } else { self.sum_of_squares / (self.n - 1) as f64 }
    }

    /// Square root of the unbiased variance.
    #[must_use]
    pub fn standard_deviation(&self) -> f64 {
        self.variance().sqrt()
    }

    /// Standard error of the mean for independent samples.
    #[must_use]
    pub fn standard_error(&self) -> f64 {
        (self.variance() / self.n as f64).sqrt()
    }
}

impl FromIterator<f64> for Moments {
    fn from_iter<I: IntoIterator<Item = f64>>(samples: I) -> Self {
        let mut moments = Self::default();
        samples.into_iter().for_each(|sample| moments.push(sample));
        moments
    }
}

/// Quantile `q` in 0..=1 of ascending samples, linear between neighbours
/// (definition 7 of Hyndman and Fan 1996, the default of R and NumPy). NaN without samples.
#[must_use]
pub fn quantile_sorted(sorted: &[f64], q: f64) -> f64 {
    let Some(last) = sorted.len().checked_sub(1) else { return f64::NAN };
    let position = q.clamp(0.0, 1.0) * last as f64;
    let below = position.floor() as usize;
    let above = (below + 1).min(last);
    sorted[below] + (sorted[above] - sorted[below]) * (position - below as f64)
}

/// Median of samples in any order, those that are no numbers left out; `None` without any.
#[must_use]
pub fn median(samples: impl IntoIterator<Item = f64>) -> Option<f64> {
    let mut sorted: Vec<f64> = samples.into_iter().filter(|sample| !sample.is_nan()).collect();
    sorted.sort_by(f64::total_cmp);
    (!sorted.is_empty()).then(|| quantile_sorted(&sorted, 0.5))
}

/// The upper median, which is one of the samples; they are put in another order. `None` without
/// any.
#[must_use]
pub fn upper_median(samples: &mut [f64]) -> Option<f64> {
    let middle = samples.len() / 2;
    (!samples.is_empty()).then(|| *samples.select_nth_unstable_by(middle, f64::total_cmp).1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_upper_median_is_one_of_the_samples() {
        assert_eq!(upper_median(&mut [4.0, 1.0]), Some(4.0));
        assert_eq!(upper_median(&mut [3.0, 1.0, 2.0]), Some(2.0));
        assert_eq!(upper_median(&mut []), None);
    }

    #[test]
    fn a_median_needs_no_order_and_lies_between_two_in_the_middle() {
        assert_eq!(median([3.0, 1.0, f64::NAN, 2.0]), Some(2.0));
        assert_eq!(median([4.0, 1.0]), Some(2.5));
        assert_eq!(median([f64::NAN]), None);
    }

    #[test]
    fn moments_agree_with_the_textbook_sums() {
        let moments: Moments = [2.0, 4.0, 4.0, 4.0, 5.0, 5.0, 7.0, 9.0].into_iter().collect();
        assert!((moments.mean() - 5.0).abs() < 1e-12);
        assert!((moments.variance() - 32.0 / 7.0).abs() < 1e-12);
        assert_eq!(moments.count(), 8);
    }

    #[test]
    fn quantiles_interpolate_as_numpy_does() {
        // numpy.quantile([1, 2, 3, 4], [0, 0.4, 1]) -> 1.0, 2.2, 4.0
        let samples = [1.0, 2.0, 3.0, 4.0];
        assert!((quantile_sorted(&samples, 0.4) - 2.2).abs() < 1e-12);
        assert!((quantile_sorted(&samples, 0.0) - 1.0).abs() < 1e-12);
        assert!((quantile_sorted(&samples, 1.0) - 4.0).abs() < 1e-12);
        assert!(quantile_sorted(&[], 0.5).is_nan());
    }
}
