//! Lower endpoint of a distribution below its smallest sample.
//!
//! Near its lower endpoint `theta` almost any latency distribution is `F(x) = c (x - theta)^k`
//! (Hall, Annals of Statistics 10, 1982). Given the (m+1)-th smallest sample `u`, the m below it
//! are independent with distribution `((x - theta) / (u - theta))^k`; the likelihood of `theta`,
//! profiled over `k`, gives the interval. The smallest sample is the point estimate: its variance
//! is smaller than that of the profile's maximum.

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct LowerEndpoint {
    /// Width of the 95 % interval below the smallest sample.
    pub(super) below95: f64,
    /// The same for 90 %.
    pub(super) below90: f64,
    /// Exponent k of greatest profile likelihood.
    pub(super) tail_index: f64,
}

/// Log-likelihood drop of the 95 % interval, calibrated by simulation. The regular value of 1.92
/// does not hold at an endpoint: it covers 72 to 95 %.
const LIKELIHOOD_DROP95: f64 = 3.5;
/// The same for 90 %, in the ratio of the chi-squared quantiles.
const LIKELIHOOD_DROP90: f64 = 3.5 * 2.706 / 3.841;
/// Range of tail exponents.
const TAIL_INDEX_RANGE: std::ops::RangeInclusive<f64> = 1.0..=12.0;
/// Grid points in ln(distance).
const GRID_POINTS: usize = 240;

/// Profile likelihood of the lower endpoint of `samples`; None below eight samples.
pub(super) fn lower_endpoint(samples: &[f64]) -> Option<LowerEndpoint> {
    let n = samples.len();
    if n < 8 {
        return None;
    }
    let m = ((n as f64).sqrt() as usize).clamp(12, 60).min(n - 1);
    let mut tail = samples.to_vec();
    let (below, &mut beyond, _) = tail.select_nth_unstable_by(m, f64::total_cmp);
    let smallest = below.iter().copied().fold(f64::INFINITY, f64::min);
    let scale = beyond - smallest;
    let above: Vec<f64> = below.iter().map(|sample| sample - smallest).collect();
    if scale.partial_cmp(&0.0) != Some(std::cmp::Ordering::Greater) {
        // All ties: the error is the resolution of the samples.
        return Some(LowerEndpoint {
            below95: 0.0,
            below90: 0.0,
            tail_index: *TAIL_INDEX_RANGE.start(),
        });
    }
    // From a ten-thousandth to a hundred times the width of the tail.
    let distance = |step: usize| {
        scale * (1e-4_f64.ln() + 1e6_f64.ln() * step as f64 / GRID_POINTS as f64).exp()
    };
    let profile: Vec<(f64, f64, f64)> = (0..=GRID_POINTS)
        .map(|step| {
            let (likelihood, k) = log_likelihood(&above, scale, distance(step));
            (distance(step), likelihood, k)
        })
        .collect();
    let best = profile.iter().copied().max_by(|a, b| a.1.total_cmp(&b.1))?;
    let farthest = |drop: f64| {
        profile.iter().rev().find(|(_, likelihood, _)| *likelihood >= best.1 - drop).map(|at| at.0)
    };
    Some(LowerEndpoint {
        below95: farthest(LIKELIHOOD_DROP95)?,
        below90: farthest(LIKELIHOOD_DROP90)?,
        tail_index: best.2,
    })
}

/// Log-likelihood of an endpoint `distance` below the smallest sample, and the exponent that
/// maximises it.
fn log_likelihood(above: &[f64], scale: f64, distance: f64) -> (f64, f64) {
    let m = above.len() as f64;
    let logs: f64 = above.iter().map(|sample| (sample + distance).ln()).sum();
    let log_scale = (scale + distance).ln();
    let k = (m / (m * log_scale - logs)).clamp(*TAIL_INDEX_RANGE.start(), *TAIL_INDEX_RANGE.end());
    (m * k.ln() + (k - 1.0) * logs - m * k * log_scale, k)
}
