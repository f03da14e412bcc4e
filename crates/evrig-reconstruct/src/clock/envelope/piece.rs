//! Piece of an envelope.

use crate::clock::estimate::ClockSegment;
use crate::clock::trace::OffsetLine;
use evrig_core::time::Clock;
use std::ops::Range;

/// A segment of the estimate with the frames and the line behind it.
pub(in crate::clock) struct EnvelopePiece<A: Clock, B: Clock> {
    pub(in crate::clock) segment: ClockSegment<A, B>,
    pub(in crate::clock) frames: Range<usize>,
    pub(in crate::clock) line: OffsetLine,
    pub(in crate::clock) tail_index: Option<f64>,
}
