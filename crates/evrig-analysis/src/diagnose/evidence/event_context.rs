//! Other events around an event: neighbours, row, own frames.

use crate::predict::{EventsByPixel, Spike};
use evrig_core::event::{Event, Events};
use evrig_core::geometry::Size;

/// Longest time that is distinguished from never.
const MAX_LAG_US: i64 = 1_000_000;

/// All events of a recording, indexed by place and time.
#[derive(Debug)]
pub(crate) struct EventContext {
    recording: EventsByPixel,
    /// Times of all events of each row, ascending, microseconds since the window's start.
    rows: Vec<Vec<i64>>,
    /// Exposure starts of the camera's own frames, microseconds since the window's start.
    aps_us: Vec<i64>,
}

impl EventContext {
    pub(crate) fn new(recording: EventsByPixel, aps_us: &[i64]) -> Self {
        let size = recording.size();
        let rows = (0..size.height)
            .map(|y| {
                let own = (0..size.width).flat_map(|x| recording.of(x, y)).map(|s| s.t_us);
                let mut times: Vec<i64> = own.collect();
                times.sort_unstable();
                times
            })
            .collect();
        let start = recording.window_us()[0];
        let aps_us = aps_us.iter().map(|t| t - start).collect();
        Self { recording, rows, aps_us }
    }

    pub(crate) fn recording(&self) -> &EventsByPixel {
        &self.recording
    }

    /// All events in ascending time, microseconds since the window's start.
    pub(crate) fn in_order(&self) -> Events {
        let Size { width, height } = self.recording.size();
        let places = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        let of_pixel = |(x, y)| {
            let own = self.recording.of(x, y).iter();
            own.map(move |spike| (spike.t_us, y, x, spike.on))
        };
        let mut all: Vec<(i64, u16, u16, bool)> = places.flat_map(of_pixel).collect();
        all.sort_unstable();
        all.into_iter().map(|(t, y, x, on)| Event { t, x, y, on }).collect()
    }

    /// Exposure starts of the camera's own frames, microseconds since the window's start.
    pub(crate) fn frames_us(&self) -> &[i64] {
        &self.aps_us
    }

    /// Time since the last event of the eight neighbours before `t_us` (at most a second), and
    /// their number of events in the `within_us` before.
    pub(crate) fn neighbours(
        &self,
        x: u16,
        y: u16,
        t_us: i64,
        statement_bound_us: i64,
    ) -> (f64, f64) {
        let (mut since, mut count) = (MAX_LAG_US, 0);
        for spikes in self.eight(x, y) {
            let end = spikes.partition_point(|s| s.t_us < t_us);
            if let Some(last) = end.checked_sub(1) {
                since = since.min(t_us - spikes[last].t_us);
            }
            let before = spikes[..end].iter().rev();
            count += before.take_while(|s| t_us - s.t_us <= statement_bound_us).count();
        }
        (since as f64, count as f64)
    }

    /// Time since the last and until the next event of the eight neighbours, at most a second;
    /// zero for an event with the same stamp.
    pub(crate) fn gaps_us(&self, x: u16, y: u16, t_us: i64) -> (i64, i64) {
        let one = |(since, until): (i64, i64), spikes: &[Spike]| {
            let first = spikes.partition_point(|s| s.t_us < t_us);
            match spikes.get(first) {
                Some(spike) if spike.t_us == t_us => (0, 0),
                next => {
                    let before = first.checked_sub(1).map_or(MAX_LAG_US, |i| t_us - spikes[i].t_us);
                    let behind = next.map_or(MAX_LAG_US, |spike| spike.t_us - t_us);
                    (since.min(before), until.min(behind))
                }
            }
        };
        self.eight(x, y).fold((MAX_LAG_US, MAX_LAG_US), one)
    }

    /// Time until the next event of the eight neighbours, at most a second.
    pub(crate) fn next_us(&self, x: u16, y: u16, t_us: i64) -> f64 {
        let later = self.eight(x, y).filter_map(|spikes| {
            let at = spikes.partition_point(|s| s.t_us <= t_us);
            spikes.get(at).map(|spike| spike.t_us - t_us)
        });
        later.fold(MAX_LAG_US, i64::min) as f64
    }

    /// Events of each of the eight neighbours, fewer at the border.
    pub(crate) fn eight(&self, x: u16, y: u16) -> impl Iterator<Item = &[Spike]> {
        self.within(x, y, 1)
    }

    /// Events of each other pixel within `reach` columns and rows.
    pub(crate) fn within(&self, x: u16, y: u16, reach: u16) -> impl Iterator<Item = &[Spike]> {
        let about = move |at: u16, end: u16| {
            at.saturating_sub(reach)..end.min(at.saturating_add(reach + 1))
        };
        let Size { width, height } = self.recording.size();
        let all = about(y, height).flat_map(move |ny| about(x, width).map(move |nx| (nx, ny)));
        all.filter(move |other| *other != (x, y)).map(|(nx, ny)| self.recording.of(nx, ny))
    }

    /// Time to the nearest event of the row from another pixel, microseconds.
    pub(crate) fn row_us(&self, x: u16, y: u16, t_us: i64) -> f64 {
        let Some(times) = self.rows.get(usize::from(y)) else { return f64::NAN };
        let own = self.recording.of(x, y);
        let is_own = |t: i64| own.binary_search_by_key(&t, |s| s.t_us).is_ok();
        let at = times.partition_point(|t| *t < t_us);
        let later = times[at..].iter().take(8).copied().find(|t| *t != t_us || !is_own(*t));
        let earlier = times[..at].iter().rev().take(8).copied().find(|t| !is_own(*t));
        let gap = |t: Option<i64>| t.map_or(MAX_LAG_US, |t| (t - t_us).abs().min(MAX_LAG_US));
        gap(later).min(gap(earlier)) as f64
    }

    /// Time since the last exposure start of the camera's own frames, microseconds; NaN without
    /// one.
    pub(crate) fn since_frame_us(&self, t_us: i64) -> f64 {
        let at = self.aps_us.partition_point(|t| *t <= t_us);
        at.checked_sub(1).map_or(f64::NAN, |last| (t_us - self.aps_us[last]) as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbours_rows_and_frames_are_found_at_an_instant() {
        let list = [(100, 1, 1), (140, 2, 1), (150, 0, 0), (400, 9, 1), (500, 1, 1)];
        let events: Events = list.iter().map(|&(t, x, y)| Event { t, x, y, on: true }).collect();
        let by_pixel = EventsByPixel::new(events.as_slice(), Size::new(10, 3), [0, 1_000]);
        let around = EventContext::new(by_pixel, &[120, 420]);
        assert_eq!(around.neighbours(1, 1, 500, 360), (350.0, 2.0));
        assert_eq!(around.neighbours(1, 1, 500, 355), (350.0, 1.0));
        assert_eq!(around.neighbours(5, 1, 500, 355), (MAX_LAG_US as f64, 0.0));
        assert_eq!(around.gaps_us(1, 1, 100), (MAX_LAG_US, 40));
        assert_eq!(around.gaps_us(1, 1, 150), (0, 0), "what has its stamp was together with it");
        assert_eq!(around.row_us(1, 1, 500), 100.0, "its own events are not counted");
        assert_eq!(around.row_us(3, 1, 400), 0.0);
        assert_eq!(around.since_frame_us(500), 80.0);
        assert!(around.since_frame_us(90).is_nan());
    }
}
