//! Agreement of two methods within their errors.

use super::estimate::{ClockEstimate, Method};
use evrig_core::time::{Clock, Span, Stamp};
use serde::{Deserialize, Serialize};

/// Two estimates with disjoint intervals.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(bound = "")]
pub struct Disagreement<B: Clock> {
    /// Source time of the largest disagreement.
    pub at: Stamp<B>,
    /// The method checked.
    pub method: Method,
    /// The method it is compared with.
    pub against: Method,
    /// The second minus the first there.
    pub difference: Span,
    /// Distance between their 95 % intervals there.
    pub beyond_intervals: Span,
}

/// Compares an estimate with another at the middle of each segment.
///
/// A method without its own interval counts as exact; `slack` is what such a method may differ by.
/// Returns the largest disagreement, or None.
#[must_use]
pub fn cross_check<A: Clock, B: Clock>(
    estimate: &ClockEstimate<A, B>,
    other: &ClockEstimate<A, B>,
    slack: Span,
) -> Option<Disagreement<B>> {
    let middle = |first: Stamp<B>, last: Stamp<B>| {
        Stamp::from_nanos(first.as_nanos().midpoint(last.as_nanos()))
    };
    estimate
        .segments
        .iter()
        .map(|segment| middle(segment.first, segment.last))
        .filter_map(|at| {
            let difference = other.map(at)? - estimate.map(at)?;
            let [low, high] = estimate.statistical95(at).unwrap_or([Span::ZERO; 2]);
            let [other_low, other_high] = other.statistical95(at).unwrap_or([Span::ZERO; 2]);
            let above = difference + other_low - high - slack;
            let below = low - (difference + other_high) - slack;
            let beyond_intervals = above.max(below);
            let (method, against) = (estimate.method, other.method);
            (beyond_intervals > Span::ZERO).then_some(Disagreement {
                at,
                method,
                against,
                difference,
                beyond_intervals,
            })
        })
        .max_by_key(|disagreement| disagreement.beyond_intervals)
}
