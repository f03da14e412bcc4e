//! Events with equal stamps: how many, and in which order rows and columns are read.

use super::SectionResult;
use super::chance::binomial_tail;
use evrig_core::event::EventSlice;
use evrig_core::stats::Estimate;
use serde::Serialize;

/// Fewest pairs of equal stamps in which an order is significant at the level of a report.
const MIN_PAIRS: u64 = 20;

/// Share of pairs in one direction, above which the order is called so.
const ORDERED_SHARE: f64 = 0.9;

/// Probability by chance below which a share differs from a half.
const ORDER_LEVEL: f64 = 1e-3;

/// Neighbouring events with equal stamps.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StampTies {
    /// Share of the events that have the stamp of the event before.
    pub share: Estimate,
    /// The share that independent events of the same rate would have.
    pub share_by_chance: f64,
    /// Share of these pairs in one row.
    pub same_row_share: Estimate,
    /// Order of different rows.
    pub row_order: ReadoutOrder,
    /// Order of different columns in one row.
    pub column_order: ReadoutOrder,
}

/// Order of rows or columns among events with equal stamps.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ReadoutOrder {
    /// Nearly always upwards in number.
    Ascending,
    /// Nearly always downwards in number.
    Descending,
    /// More often one way than the other.
    Mixed,
    /// As chance has it.
    Random,
    /// Too few pairs.
    Unknown,
}

/// `step_us` is the step of the stamps.
pub(super) fn ties(events: EventSlice<'_>, step_us: f64) -> SectionResult<StampTies> {
    let n = events.len();
    if n < 2 {
        return SectionResult::not_measured(
            "too few events for equal stamps: 1, at least 2 are needed",
        );
    }
    let (mut n_ties, mut n_same_row) = (0, 0);
    let (mut rows, mut columns) = ([0_u64; 2], [0_u64; 2]);
    for i in 1..n {
        if events.t[i] != events.t[i - 1] {
            continue;
        }
        n_ties += 1;
        let [y0, y1, x0, x1] = [events.y[i - 1], events.y[i], events.x[i - 1], events.x[i]];
        if y0 == y1 {
            n_same_row += 1;
            if x0 != x1 {
                columns[usize::from(x1 < x0)] += 1;
            }
        } else {
            rows[usize::from(y1 < y0)] += 1;
        }
    }
    let share = |k: u64, n: u64| {
        let share = k as f64 / n.max(1) as f64;
        Estimate::normal(share, (share * (1.0 - share) / n.max(1) as f64).sqrt(), n)
    };
    let duration = (events.t[n - 1] - events.t[0]) as f64 + step_us;
    let mean = n as f64 * step_us / duration;
    SectionResult::Known(StampTies {
        share: share(n_ties, n as u64 - 1),
        // Of a Poisson number of events in a step, all but the first repeat its stamp.
        share_by_chance: 1.0 - (-(-mean).exp_m1()) / mean,
        same_row_share: if n_ties == 0 { Estimate::unknown() } else { share(n_same_row, n_ties) },
        row_order: order(rows),
        column_order: order(columns),
    })
}

fn order([up, down]: [u64; 2]) -> ReadoutOrder {
    let n = up + down;
    if n < MIN_PAIRS {
        return ReadoutOrder::Unknown;
    }
    if 2.0 * binomial_tail(up.max(down), n, 0.5) > ORDER_LEVEL {
        return ReadoutOrder::Random;
    }
    match up as f64 / n as f64 {
        share if share >= ORDERED_SHARE => ReadoutOrder::Ascending,
        share if share <= 1.0 - ORDERED_SHARE => ReadoutOrder::Descending,
        _ => ReadoutOrder::Mixed,
    }
}
