//! Confidence interval of a proportion.

/// Wilson's 95 % confidence interval of a proportion with `hits` of `n` (Wilson, JASA 22 (1927)
/// 209); `[0, 1]` for `n` of 0.
#[must_use]
pub fn wilson95(hits: u64, n: u64) -> [f64; 2] {
    if n == 0 {
        return [0.0, 1.0];
    }
    const Z: f64 = 1.959_963_984_540_054;
    let (n, share) = (n as f64, hits as f64 / n as f64);
    let middle = share + Z * Z / (2.0 * n);
    let half = Z * (share * (1.0 - share) / n + Z * Z / (4.0 * n * n)).sqrt();
    let scale = 1.0 + Z * Z / n;
    [((middle - half) / scale).max(0.0), ((middle + half) / scale).min(1.0)]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `statsmodels.stats.proportion.proportion_confint(k, n, method="wilson")`.
    #[test]
    fn it_is_the_interval_that_statsmodels_gives() {
        for (hits, n, low, high) in
            [(0, 20, 0.0, 0.161_125), (5, 20, 0.111_862, 0.468_702), (20, 20, 0.838_875, 1.0)]
        {
            let [found_low, found_high] = wilson95(hits, n);
            assert!((found_low - low).abs() < 1e-5, "{hits} of {n}: {found_low}");
            assert!((found_high - high).abs() < 1e-5, "{hits} of {n}: {found_high}");
        }
        assert_eq!(wilson95(0, 0), [0.0, 1.0]);
    }
}
