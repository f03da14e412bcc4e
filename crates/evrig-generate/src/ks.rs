//! The Kolmogorov–Smirnov test, for the tests of the generators.
//!
//! Every test runs on a fixed seed, so it passes always or never. The critical value is
//! that of a false alarm in 10,000 ([`FALSE_ALARM`]): with about a hundred such tests in
//! the module, one of a hundred choices of all seeds would fail without a fault.

/// Share of correct samplers that a single test would refuse.
pub(super) const FALSE_ALARM: f64 = 1e-4;

/// Largest distance of the sample's distribution from `cdf`, and the sample's size.
pub(super) fn distance(
    sample: impl IntoIterator<Item = f64>,
    cdf: impl Fn(f64) -> f64,
) -> (f64, f64) {
    let mut sorted: Vec<f64> = sample.into_iter().collect();
    sorted.sort_by(f64::total_cmp);
    let n = sorted.len() as f64;
    let apart = sorted.iter().enumerate().map(|(i, &value)| {
        let exact = cdf(value);
        (exact - i as f64 / n).abs().max((exact - (i + 1) as f64 / n).abs())
    });
    (apart.fold(0.0, f64::max), n)
}

/// The distance at which a right sample of effective size `n` is refused with probability
/// [`FALSE_ALARM`]: Kolmogorov's limit law 2 exp(-2 n d²), Stephens' correction for finite n.
pub(super) fn critical(n: f64) -> f64 {
    let limit = (-0.5 * (0.5 * FALSE_ALARM).ln()).sqrt();
    limit / (n.sqrt() + 0.12 + 0.11 / n.sqrt())
}

/// Refuses a sample that does not follow `cdf`.
#[track_caller]
pub(super) fn assert_law(sample: impl IntoIterator<Item = f64>, cdf: impl Fn(f64) -> f64) {
    let (apart, n) = distance(sample, cdf);
    let limit = critical(n);
    assert!(n > 100.0, "only {n} samples");
    assert!(apart < limit, "distance {apart:.5} of {n} samples; the limit is {limit:.5}");
}

/// Refuses two samples that do not follow one law.
#[track_caller]
pub(super) fn assert_same_law(a: &[f64], b: &[f64]) {
    let sorted = |sample: &[f64]| {
        let mut sample = sample.to_vec();
        sample.sort_by(f64::total_cmp);
        sample
    };
    let (a, b) = (sorted(a), sorted(b));
    let share = |sample: &[f64], x: f64| {
        sample.partition_point(|&value| value <= x) as f64 / sample.len() as f64
    };
    let apart =
        a.iter().chain(&b).map(|&x| (share(&a, x) - share(&b, x)).abs()).fold(0.0, f64::max);
    let (n_a, n_b) = (a.len() as f64, b.len() as f64);
    let limit = critical(n_a * n_b / (n_a + n_b));
    assert!(n_a.min(n_b) > 100.0, "only {n_a} and {n_b} samples");
    assert!(apart < limit, "distance {apart:.5} of {n_a} and {n_b}; the limit is {limit:.5}");
}

/// Refuses a count of `hits` in `n` trials that is too far from `probability`:
/// normal limit, at the same false-alarm rate.
#[track_caller]
pub(super) fn assert_share(hits: usize, n: usize, probability: f64) {
    // Two-sided normal quantile of FALSE_ALARM: scipy.stats.norm.isf(5e-5) = 3.8906.
    let error = (probability * (1.0 - probability) / n as f64).sqrt();
    let apart = (hits as f64 / n as f64 - probability).abs();
    assert!(
        apart <= 3.8906 * error + 1.0 / n as f64,
        "share {} of {n}; expected {probability} ± {error}",
        hits as f64 / n as f64
    );
}
