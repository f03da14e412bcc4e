//! A refractory period applied to a stream of events.

use crate::geometry::Size;

/// Passes an event that comes at least the refractory period after the last passed event of its
/// pixel, of either polarity.
#[derive(Debug, Clone)]
pub struct RefractoryFilter {
    /// The first time at which a pixel may fire again.
    ready: Vec<i64>,
    us: i64,
}

impl RefractoryFilter {
    /// A filter before the first event; 0 µs passes everything.
    #[must_use]
    pub fn new(size: Size, us: i64) -> Self {
        Self { ready: vec![i64::MIN; size.n_pixels()], us }
    }

    /// Whether an event at `t` (µs) passes; a pixel's events come in the order of time. `pixel` is
    /// its place by [`Size::index`].
    pub fn passes(&mut self, t: i64, pixel: usize) -> bool {
        let ready = &mut self.ready[pixel];
        let is_kept = t >= *ready;
        *ready = if is_kept { t.saturating_add(self.us) } else { *ready };
        is_kept
    }
}
