//! Events of both polarities about the line of a burst, for plots.

use super::burst_shape::BurstShape;
use super::frame_fold::FrameFold;
use evrig_core::event::EventSlice;
use serde::Serialize;

/// Time about a burst, µs, and its bins: the wake of a burst takes milliseconds.
const RANGE_US: [f64; 2] = [-1_000.0, 3_000.0];
const BIN_US: f64 = 25.0;

/// Events since a burst's line.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ProfileBin {
    /// Start of the bin after the line, µs.
    pub from_us: f64,
    /// End of the bin, µs.
    pub to_us: f64,
    /// ON events.
    pub n_on: u64,
    /// OFF events.
    pub n_off: u64,
}

pub(super) fn profile(
    events: EventSlice<'_>,
    fold: &FrameFold<'_>,
    shape: &BurstShape,
) -> Vec<ProfileBin> {
    let [low, high] = RANGE_US.map(|us| us.clamp(-0.5 * fold.period_us, 0.5 * fold.period_us));
    let n = ((high - low) / BIN_US) as usize;
    let edge = |i: usize| low + i as f64 * BIN_US;
    let mut bins: Vec<ProfileBin> = (0..n)
        .map(|i| ProfileBin { from_us: edge(i), to_us: edge(i + 1), n_on: 0, n_off: 0 })
        .collect();
    let [delay, row] = [shape.delay_us.value, shape.row_us.value];
    fold.visit(events.t, |i, _, since| {
        let residual = fold.wrap(since - delay - row * f64::from(events.y[i]));
        if residual >= low
            && let Some(bin) = bins.get_mut(((residual - low) / BIN_US) as usize)
        {
            *(if events.on[i] { &mut bin.n_on } else { &mut bin.n_off }) += 1;
        }
    });
    bins
}
