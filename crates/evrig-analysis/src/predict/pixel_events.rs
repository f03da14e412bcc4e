//! The events of a recording, grouped by pixel.

use evrig_core::event::{Event, EventSlice};
use evrig_core::geometry::Size;
use std::sync::Arc;

/// One event of a known pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Spike {
    /// Microseconds since the start of the window.
    pub t_us: i64,
    /// `true`: ON (brightness rose).
    pub on: bool,
}

/// The events of a time window, sorted by pixel and then by time; clones share them.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct EventsByPixel {
    size: Size,
    window_us: [i64; 2],
    /// First event of each pixel, and the number of events at the end.
    starts: Vec<u32>,
    spikes: Arc<Vec<Spike>>,
}

impl EventsByPixel {
    /// The events of `window_us` (end excluded) that lie on the grid; all others are left out.
    /// Events of one pixel keep their order in time, those of one microsecond that of the slice.
    #[must_use]
    pub fn new(events: EventSlice<'_>, size: Size, window_us: [i64; 2]) -> Self {
        let [start, end] = window_us;
        let taken = |e: &Event| (start..end).contains(&e.t) && size.contains(e.x, e.y);
        let mut starts = vec![0_u32; size.n_pixels() + 1];
        for event in events.iter().filter(taken) {
            starts[size.index(event.x, event.y) + 1] += 1;
        }
        for pixel in 1..starts.len() {
            starts[pixel] += starts[pixel - 1];
        }
        let mut next = starts.clone();
        let n = starts.last().copied().unwrap_or(0) as usize;
        let mut spikes = vec![Spike { t_us: 0, on: false }; n];
        for event in events.iter().filter(taken) {
            let at = &mut next[size.index(event.x, event.y)];
            spikes[*at as usize] = Spike { t_us: event.t - start, on: event.on };
            *at += 1;
        }
        for pixel in 0..size.n_pixels() {
            let own = &mut spikes[starts[pixel] as usize..starts[pixel + 1] as usize];
            if own.windows(2).any(|pair| pair[1].t_us < pair[0].t_us) {
                own.sort_by_key(|spike| spike.t_us);
            }
        }
        Self { size, window_us, starts, spikes: Arc::new(spikes) }
    }

    /// The pixel grid.
    #[must_use]
    pub const fn size(&self) -> Size {
        self.size
    }

    /// Start and end of the window, microseconds of the events' clock.
    #[must_use]
    pub const fn window_us(&self) -> [i64; 2] {
        self.window_us
    }

    /// Length of the window, microseconds.
    #[must_use]
    pub const fn length_us(&self) -> i64 {
        self.window_us[1] - self.window_us[0]
    }

    /// Number of events in all.
    #[must_use]
    pub fn len(&self) -> usize {
        self.spikes.len()
    }

    /// Whether there is no event.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.spikes.is_empty()
    }

    /// Upper estimate of a background rate common to all pixels, Hz: that at which as many pixels stay
    /// silent as did; infinite where none was silent.
    #[must_use]
    pub fn max_background_hz(&self) -> f64 {
        let n_silent = self.starts.windows(2).filter(|own| own[0] == own[1]).count();
        let seconds = self.length_us() as f64 * 1e-6;
        (self.size.n_pixels() as f64 / n_silent as f64).ln() / seconds
    }

    /// The events of a pixel in ascending time; none off the grid.
    #[must_use]
    pub fn of(&self, x: u16, y: u16) -> &[Spike] {
        if !self.size.contains(x, y) {
            return &[];
        }
        let pixel = self.size.index(x, y);
        &self.spikes[self.starts[pixel] as usize..self.starts[pixel + 1] as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use evrig_core::event::Events;

    #[test]
    fn events_are_found_again_by_pixel_and_counted_from_the_windows_start() {
        let size = Size::new(3, 2);
        let list = [(5, 2, 1, true), (12, 0, 0, false), (10, 2, 1, false), (99, 2, 1, true)];
        let events: Events = list.iter().map(|&(t, x, y, on)| Event { t, x, y, on }).collect();
        let by_pixel = EventsByPixel::new(events.as_slice(), size, [4, 99]);
        let spike = |t_us, on| Spike { t_us, on };
        assert_eq!(by_pixel.of(2, 1), &[spike(1, true), spike(6, false)]);
        assert_eq!(by_pixel.of(0, 0), &[spike(8, false)]);
        assert!(by_pixel.of(1, 1).is_empty() && by_pixel.of(7, 7).is_empty());
        assert_eq!((by_pixel.len(), by_pixel.length_us()), (3, 95));
    }

    #[test]
    fn disorder_within_a_pixel_is_put_right() {
        let events: Events = [7, 3, 5].iter().map(|&t| Event { t, x: 0, y: 0, on: true }).collect();
        let by_pixel = EventsByPixel::new(events.as_slice(), Size::new(1, 1), [0, 10]);
        let times: Vec<i64> = by_pixel.of(0, 0).iter().map(|s| s.t_us).collect();
        assert_eq!(times, [3, 5, 7]);
    }
}
