//! A time in which the camera's own frames cause events.

/// A rate of additional events during a short time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct BurstWindow {
    /// Its ends, microseconds since the window's start.
    pub(crate) from_us: f64,
    pub(crate) to_us: f64,
    /// ON and OFF events of a pixel, Hz.
    pub(crate) hz: [f64; 2],
}
