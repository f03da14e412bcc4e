//! Events as columns.

mod refractory;

pub use refractory::RefractoryFilter;

use crate::geometry::Size;

/// Events of one stream, a column each: time in µs of the stream's clock
/// (session time is Unix µs), pixel column and row, and whether brightness rose.
///
/// The columns always have equal length. Order is the stream's own; what needs
/// ascending time states and checks it with [`EventSlice::first_disorder`].
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Events {
    t: Vec<i64>,
    x: Vec<u16>,
    y: Vec<u16>,
    on: Vec<bool>,
}

/// One event.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Event {
    /// Microseconds of the stream's clock.
    pub t: i64,
    /// Pixel column, from the left.
    pub x: u16,
    /// Pixel row, from the top.
    pub y: u16,
    /// `true`: ON, brightness rose; `false`: OFF, it fell.
    pub on: bool,
}

/// Columns whose lengths differ are not events.
#[derive(Debug, thiserror::Error)]
#[error("event columns differ in length: t {t}, x {x}, y {y}, on {on}; all four must be equal")]
pub struct UnequalColumns {
    t: usize,
    x: usize,
    y: usize,
    on: usize,
}

/// A borrowed run of events.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct EventSlice<'a> {
    /// Microseconds of the stream's clock.
    pub t: &'a [i64],
    /// Pixel columns.
    pub x: &'a [u16],
    /// Pixel rows.
    pub y: &'a [u16],
    /// Whether brightness rose.
    pub on: &'a [bool],
}

impl Events {
    /// An empty stream.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// No events yet, with capacity for `n`.
    #[must_use]
    pub fn with_capacity(n: usize) -> Self {
        Self {
            t: Vec::with_capacity(n),
            x: Vec::with_capacity(n),
            y: Vec::with_capacity(n),
            on: Vec::with_capacity(n),
        }
    }

    /// Events from four columns of equal length.
    ///
    /// # Errors
    /// [`UnequalColumns`] when the lengths differ.
    pub fn from_columns(
        t: Vec<i64>,
        x: Vec<u16>,
        y: Vec<u16>,
        on: Vec<bool>,
    ) -> Result<Self, UnequalColumns> {
        if t.len() == x.len() && t.len() == y.len() && t.len() == on.len() {
            Ok(Self { t, x, y, on })
        } else {
            Err(UnequalColumns { t: t.len(), x: x.len(), y: y.len(), on: on.len() })
        }
    }

    /// The four columns, t, x, y and on, for example to use their memory again.
    #[must_use]
    pub fn into_columns(self) -> (Vec<i64>, Vec<u16>, Vec<u16>, Vec<bool>) {
        (self.t, self.x, self.y, self.on)
    }

    /// Appends one event.
    #[inline]
    pub fn push(&mut self, event: Event) {
        self.t.push(event.t);
        self.x.push(event.x);
        self.y.push(event.y);
        self.on.push(event.on);
    }

    /// Appends a run of events.
    pub fn extend_from_slice(&mut self, events: EventSlice<'_>) {
        self.t.extend_from_slice(events.t);
        self.x.extend_from_slice(events.x);
        self.y.extend_from_slice(events.y);
        self.on.extend_from_slice(events.on);
    }

    /// Appends an event for each item, one column after another: several values at a time.
    pub fn extend_by_columns<T>(
        &mut self,
        items: &[T],
        t: impl Fn(&T) -> i64,
        x: impl Fn(&T) -> u16,
        y: impl Fn(&T) -> u16,
        on: impl Fn(&T) -> bool,
    ) {
        self.t.extend(items.iter().map(t));
        self.x.extend(items.iter().map(x));
        self.y.extend(items.iter().map(y));
        self.on.extend(items.iter().map(on));
    }

    /// Removes all events and keeps the memory.
    pub fn clear(&mut self) {
        self.t.clear();
        self.x.clear();
        self.y.clear();
        self.on.clear();
    }

    /// Number of events.
    #[must_use]
    pub fn len(&self) -> usize {
        self.t.len()
    }

    /// Whether there is no event.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.t.is_empty()
    }

    /// All events, borrowed.
    #[must_use]
    pub fn as_slice(&self) -> EventSlice<'_> {
        EventSlice { t: &self.t, x: &self.x, y: &self.y, on: &self.on }
    }

    /// Adds µs to every time, up to the ends of its range.
    pub fn shift(&mut self, us: i64) {
        if us != 0 {
            self.t.iter_mut().for_each(|t| *t = t.saturating_add(us));
        }
    }

    /// Removes the events that are not to be kept, by their index and themselves.
    pub fn retain(&mut self, mut is_kept: impl FnMut(usize, Event) -> bool) {
        let mut n_kept = 0;
        for i in 0..self.len() {
            let event = self.as_slice().get(i);
            if is_kept(i, event) {
                self.t[n_kept] = event.t;
                self.x[n_kept] = event.x;
                self.y[n_kept] = event.y;
                self.on[n_kept] = event.on;
                n_kept += 1;
            }
        }
        self.t.truncate(n_kept);
        self.x.truncate(n_kept);
        self.y.truncate(n_kept);
        self.on.truncate(n_kept);
    }

    /// Sorts by time; events of one microsecond keep their order.
    pub fn sort_by_time(&mut self) {
        if self.as_slice().first_disorder().is_none() {
            return;
        }
        let mut order: Vec<u32> = (0..self.len() as u32).collect();
        order.sort_by_key(|&i| self.t[i as usize]);
        let pick = |i: &u32| *i as usize;
        self.t = order.iter().map(|i| self.t[pick(i)]).collect();
        self.x = order.iter().map(|i| self.x[pick(i)]).collect();
        self.y = order.iter().map(|i| self.y[pick(i)]).collect();
        self.on = order.iter().map(|i| self.on[pick(i)]).collect();
    }
}

impl FromIterator<Event> for Events {
    fn from_iter<I: IntoIterator<Item = Event>>(events: I) -> Self {
        let mut columns = Self::new();
        events.into_iter().for_each(|event| columns.push(event));
        columns
    }
}

impl<'a> EventSlice<'a> {
    /// Number of events.
    #[must_use]
    pub fn len(self) -> usize {
        self.t.len()
    }

    /// Whether there is no event.
    #[must_use]
    pub fn is_empty(self) -> bool {
        self.t.is_empty()
    }

    /// The event at `i`.
    ///
    /// # Panics
    /// When `i` is not below the length, as indexing does.
    #[must_use]
    #[inline]
    pub fn get(self, i: usize) -> Event {
        Event { t: self.t[i], x: self.x[i], y: self.y[i], on: self.on[i] }
    }

    /// The events from `start` up to but not including `end`.
    ///
    /// # Panics
    /// When the range is not within the events, as slicing does.
    #[must_use]
    pub fn range(self, start: usize, end: usize) -> EventSlice<'a> {
        EventSlice {
            t: &self.t[start..end],
            x: &self.x[start..end],
            y: &self.y[start..end],
            on: &self.on[start..end],
        }
    }

    /// The events with `from <= t < to`, for events in ascending time.
    #[must_use]
    pub fn between(self, from: i64, to: i64) -> EventSlice<'a> {
        let start = self.t.partition_point(|&t| t < from);
        let end = self.t.partition_point(|&t| t < to).max(start);
        self.range(start, end)
    }

    /// All events in the slice's order.
    #[inline]
    pub fn iter(self) -> impl Iterator<Item = Event> + 'a {
        (0..self.len()).map(move |i| self.get(i))
    }

    /// Index of the first event that is earlier than the one before it.
    #[must_use]
    pub fn first_disorder(self) -> Option<usize> {
        self.t.windows(2).position(|pair| pair[1] < pair[0]).map(|i| i + 1)
    }

    /// Number of events that are earlier than one before them.
    #[must_use]
    pub fn count_late(self) -> usize {
        let mut latest = i64::MIN;
        let is_late = |t: &i64| {
            let is_late = *t < latest;
            latest = latest.max(*t);
            usize::from(is_late)
        };
        self.t.iter().map(is_late).sum()
    }

    /// Number of events that are not on the grid.
    #[must_use]
    pub fn count_outside(self, size: Size) -> usize {
        let places = self.x.iter().zip(self.y);
        places.map(|(&x, &y)| usize::from(!size.contains(x, y))).sum()
    }

    /// Index of the first event that is not on the grid.
    #[must_use]
    pub fn first_outside(self, size: Size) -> Option<usize> {
        (0..self.len()).find(|&i| !size.contains(self.x[i], self.y[i]))
    }

    /// Number of ON events.
    #[must_use]
    pub fn count_on(self) -> usize {
        self.on.iter().filter(|&&on| on).count()
    }

    /// An owned copy.
    #[must_use]
    pub fn to_events(self) -> Events {
        Events { t: self.t.to_vec(), x: self.x.to_vec(), y: self.y.to_vec(), on: self.on.to_vec() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(times: &[i64]) -> Events {
        times.iter().map(|&t| Event { t, x: 1, y: 2, on: t % 2 == 0 }).collect()
    }

    #[test]
    fn a_time_window_takes_its_start_and_leaves_its_end() {
        let events = at(&[1, 2, 2, 3, 5]);
        assert_eq!(events.as_slice().between(2, 5).t, &[2, 2, 3]);
        assert!(events.as_slice().between(9, 4).is_empty());
    }

    #[test]
    fn what_is_retained_keeps_its_order_and_may_be_shifted() {
        let mut events = at(&[1, 2, 3, 4, i64::MAX]);
        events.retain(|i, event| i != 0 && event.t != 3);
        events.shift(10);
        assert_eq!(events.as_slice().t, &[12, 14, i64::MAX]);
        assert_eq!(events.as_slice().on, &[true, true, false]);
    }

    #[test]
    fn sorting_keeps_the_order_within_a_microsecond() {
        let mut events = Events::new();
        for (t, x) in [(5, 0), (3, 1), (5, 2), (3, 3)] {
            events.push(Event { t, x, y: 0, on: true });
        }
        assert_eq!(events.as_slice().first_disorder(), Some(1));
        events.sort_by_time();
        assert_eq!(events.as_slice().x, &[1, 3, 0, 2]);
        assert_eq!(events.as_slice().first_disorder(), None);
    }

    #[test]
    fn an_event_off_the_grid_is_found() {
        let events = at(&[1, 2]);
        assert_eq!(events.as_slice().first_outside(Size::new(2, 3)), None);
        assert_eq!(events.as_slice().first_outside(Size::new(1, 3)), Some(0));
    }

    #[test]
    fn unequal_columns_are_refused() {
        let error = Events::from_columns(vec![1], vec![], vec![1], vec![true]).unwrap_err();
        assert!(error.to_string().contains("x 0"));
    }
}
