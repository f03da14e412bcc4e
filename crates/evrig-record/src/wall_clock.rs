//! Detects that the host's wall clock was set during a recording.

use evrig_core::time::Span;
use evrig_session::HostTime;

/// A disciplined clock moves by less than this between two readings; one that is set moves by more.
const MAX_DISCIPLINED_STEP: Span = Span::from_micros(5_000);
/// A thread that is put aside between its readings of two clocks sees a step that was none; it is
/// not put aside so many times in a row.
const N_READINGS: usize = 5;

/// The wall clock against the clock that never steps.
#[derive(Debug, Default)]
pub(super) struct WallClock {
    /// Nanoseconds of the one minus those of the other.
    offset_ns: Option<i64>,
}

impl WallClock {
    /// By how much the wall clock was set since the last call, if it was.
    pub(super) fn look(&mut self, read: impl Fn() -> HostTime) -> Option<Span> {
        let offset = |now: HostTime| now.unix.as_nanos().wrapping_sub(now.monotonic.as_nanos());
        let Some(known) = self.offset_ns else {
            self.offset_ns = Some(offset(read()));
            return None;
        };
        let mut moved: Option<i64> = None;
        for _ in 0..N_READINGS {
            let now = offset(read()).wrapping_sub(known);
            if now.unsigned_abs() <= MAX_DISCIPLINED_STEP.as_nanos().unsigned_abs() {
                // What steering moves is followed, so that it does not add up.
                self.offset_ns = Some(known.wrapping_add(now));
                return None;
            }
            moved = moved.filter(|least| least.unsigned_abs() <= now.unsigned_abs()).or(Some(now));
        }
        let by = moved?;
        self.offset_ns = Some(known.wrapping_add(by));
        Some(Span::from_nanos(by))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use evrig_core::time::Stamp;
    use std::cell::RefCell;

    fn at(monotonic_us: i64, ahead_us: i64) -> HostTime {
        let (monotonic, unix) = (monotonic_us, 1_000_000_000 + monotonic_us + ahead_us);
        HostTime { monotonic: Stamp::from_micros(monotonic), unix: Stamp::from_micros(unix) }
    }

    #[test]
    fn a_clock_set_by_hours_is_reported_once_and_one_that_is_steered_never() {
        let mut clock = WallClock::default();
        let hour = 3_600_000_000;
        let looks = [(0, 0), (20_000, 10), (40_000, 20), (60_000, -hour), (80_000, -hour + 5)];
        let steps: Vec<_> = looks.map(|(t, ahead)| clock.look(|| at(t, ahead))).to_vec();
        assert_eq!(steps[..3], [None; 3]);
        assert_eq!(steps[3], Some(Span::from_micros(-hour - 20)));
        assert_eq!(steps[4], None);
    }

    #[test]
    fn steering_does_not_add_up_to_a_step() {
        let mut clock = WallClock::default();
        // 500 ppm, a look every second, for an hour: 1.8 s in all.
        assert!((0..3_600).all(|s| clock.look(|| at(s * 1_000_000, s * 500)).is_none()));
    }

    #[test]
    fn a_reading_that_took_long_is_no_step() {
        let mut clock = WallClock::default();
        assert_eq!(clock.look(|| at(0, 0)), None);
        let readings = RefCell::new(vec![at(3_000, 0), at(2_000, 40_000), at(1_000, 90_000)]);
        assert_eq!(clock.look(|| readings.borrow_mut().pop().unwrap()), None);
    }
}
