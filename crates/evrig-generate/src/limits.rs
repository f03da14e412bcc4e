//! Limits that several pixel models share.

/// White of an 8-bit frame, DN.
pub(super) const FULL_SCALE_8_BIT_DN: f64 = 255.0;

/// Smallest threshold that a draw may give, log units.
pub(super) const MIN_THRESHOLD: f64 = 0.01;

/// The longest interval between two frames, µs (35 minutes): event times within it fit 31 bits.
pub(super) const MAX_SPAN_US: i64 = (1 << 31) - 1;
