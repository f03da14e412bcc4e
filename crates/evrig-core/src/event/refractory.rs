//! A dead time behind the pixels.

use crate::geometry::Size;

/// Lets an event of a pixel through when it comes at least a dead time behind the last one of that pixel,
/// of either polarity, that was let through.
#[derive(Debug, Clone)]
pub struct RefractoryFilter {
    /// The first time at which a pixel may fire again.
    ready: Vec<i64>,
    us: i64,
}

impl RefractoryFilter {
    /// Of pixels that have not fired yet; 0 µs lets everything through.
    #[must_use]
    pub fn new(size: Size, us: i64) -> Self {
        Self { ready: vec![i64::MIN; size.n_pixels()], us }
    }

    /// Whether an event at `t` (µs) passes; a pixel's events come in the order of time. `pixel` is its
    /// place by [`Size::index`].
    pub fn lets_through(&mut self, t: i64, pixel: usize) -> bool {
        let ready = &mut self.ready[pixel];
        let is_kept = t >= *ready;
        *ready = if is_kept { t.saturating_add(self.us) } else { *ready };
        is_kept
    }
}
