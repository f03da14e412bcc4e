//! A pixel's comparator: it fires when the signal has left the reference by a threshold, and takes
//! the signal as its new reference.

/// Constants of one pixel's comparator.
#[derive(Debug, Clone, Copy)]
pub(super) struct Comparator {
    pub(super) on: f64,
    pub(super) off: f64,
    /// Refractory period, seconds.
    pub(super) refractory: f64,
    /// Rise of both thresholds an event, in shares, and time constant of the recovery.
    pub(super) fatigue: Option<(f64, f64)>,
}

/// What a comparator remembers. Times are seconds of world time.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct ComparatorState {
    /// The signal, leaks included, from which the thresholds count.
    pub(super) reference: f64,
    pub(super) blind_until: f64,
    is_blind: bool,
    tired: f64,
    tired_at: f64,
}

/// A straight piece of the signal, leaks included.
#[derive(Debug, Clone, Copy)]
pub(super) struct ComparatorSegment {
    pub(super) from_s: f64,
    pub(super) to_s: f64,
    pub(super) from: f64,
    pub(super) to: f64,
}

/// More events than any pixel fires within a piece of a signal.
const MAX_EVENTS: usize = 10_000;

impl ComparatorSegment {
    fn at(&self, time: f64) -> f64 {
        let length = self.to_s - self.from_s;
        if length <= 0.0 {
            return self.to;
        }
        self.from + (self.to - self.from) * ((time - self.from_s) / length).clamp(0.0, 1.0)
    }
}

impl Comparator {
    /// Runs along a piece; `forced` are events that come by themselves (time, ON), in order and
    /// within the piece. Each event is handed to `fire`.
    pub(super) fn run(
        &self,
        held: &mut ComparatorState,
        piece: ComparatorSegment,
        forced: &[(f64, bool)],
        mut fire: impl FnMut(f64, bool),
    ) {
        if forced.is_empty()
            && self.keeps_still(held, piece.from)
            && self.keeps_still(held, piece.to)
        {
            return;
        }
        let mut now = piece.from_s;
        let mut forced = forced.iter().copied().peekable();
        for _ in 0..MAX_EVENTS {
            if held.is_blind {
                if held.blind_until > piece.to_s {
                    return;
                }
                now = now.max(held.blind_until);
                held.reference = piece.at(now);
                held.is_blind = false;
            }
            while forced.peek().is_some_and(|(time, _)| *time < now) {
                forced.next();
            }
            let crossing = self.next_crossing(held, &piece, now);
            match (crossing, forced.peek().copied()) {
                (Some((time, on)), next) if next.is_none_or(|(forced, _)| time <= forced) => {
                    let reference = piece.at(time);
                    self.reset(held, time, reference);
                    fire(time, on);
                    now = time;
                }
                (_, Some((time, on))) => {
                    forced.next();
                    self.reset(held, time, piece.at(time));
                    fire(time, on);
                    now = time;
                }
                _ => return,
            }
        }
    }

    /// Whether a straight signal that begins or ends at `signal` fires nothing there; a no may be
    /// hasty.
    #[inline]
    pub(super) fn keeps_still(&self, held: &ComparatorState, signal: f64) -> bool {
        let away = signal - held.reference;
        // Tired thresholds are higher than these.
        !held.is_blind && away < self.on && away > -self.off
    }

    fn reset(&self, held: &mut ComparatorState, time: f64, reference: f64) {
        held.reference = reference;
        if self.refractory > 0.0 {
            held.is_blind = true;
            held.blind_until = time + self.refractory;
        }
        if let Some((rise, recovery)) = self.fatigue {
            let rest = held.tired * (-(time - held.tired_at).max(0.0) / recovery).exp();
            held.tired = rest + rise;
            held.tired_at = time;
        }
    }

    /// The first time from `now` on at which the signal is a threshold away from the reference.
    fn next_crossing(
        &self,
        held: &ComparatorState,
        piece: &ComparatorSegment,
        now: f64,
    ) -> Option<(f64, bool)> {
        // Tired thresholds recover slowly against a piece's length: taken at its middle.
        let tired = self.fatigue.map_or(1.0, |(_, recovery)| {
            let middle = 0.5 * (now + piece.to_s);
            1.0 + held.tired * (-(middle - held.tired_at).max(0.0) / recovery).exp()
        });
        let (on, off) = (self.on * tired, self.off * tired);
        let (start, end) = (piece.at(now) - held.reference, piece.to - held.reference);
        if start >= on {
            return Some((now, true));
        }
        if start <= -off {
            return Some((now, false));
        }
        let (barrier, is_on) = if end >= on {
            (on, true)
        } else if end <= -off {
            (-off, false)
        } else {
            return None;
        };
        let part = (barrier - start) / (end - start);
        Some((now + part * (piece.to_s - now), is_on))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLAIN: Comparator = Comparator { on: 0.2, off: 0.25, refractory: 0.0, fatigue: None };

    fn run(
        comparator: Comparator,
        piece: ComparatorSegment,
        forced: &[(f64, bool)],
    ) -> Vec<(f64, bool)> {
        let mut events = Vec::new();
        comparator
            .run(&mut ComparatorState::default(), piece, forced, |t, on| events.push((t, on)));
        events
    }

    #[test]
    fn a_ramp_fires_at_every_threshold() {
        let piece = ComparatorSegment { from_s: 1.0, to_s: 2.0, from: 0.0, to: 1.01 };
        let events = run(PLAIN, piece, &[]);
        assert_eq!(events.len(), 5);
        for (i, (time, on)) in events.iter().enumerate() {
            assert!(*on && (time - (1.0 + 0.2 * (i + 1) as f64 / 1.01)).abs() < 1e-12);
        }
        let falling = run(PLAIN, ComparatorSegment { to: -1.01, ..piece }, &[]);
        assert!(falling.len() == 4 && falling.iter().all(|(_, on)| !on));
    }

    #[test]
    fn a_blind_pixel_loses_what_passes_and_starts_from_where_it_wakes() {
        let comparator = Comparator { refractory: 0.1, ..PLAIN };
        let piece = ComparatorSegment { from_s: 0.0, to_s: 1.0, from: 0.0, to: 1.0 };
        let times: Vec<f64> = run(comparator, piece, &[]).iter().map(|(t, _)| *t).collect();
        for (got, expected) in times.iter().zip([0.2, 0.5, 0.8]) {
            assert!((got - expected).abs() < 1e-12, "{times:?}");
        }
        assert_eq!(times.len(), 3);
    }

    #[test]
    fn an_event_that_comes_by_itself_resets_the_pixel() {
        let piece = ComparatorSegment { from_s: 0.0, to_s: 1.0, from: 0.0, to: 0.3 };
        let events = run(PLAIN, piece, &[(0.5, false)]);
        assert_eq!(events.len(), 1, "half of the ramp was lost: {events:?}");
        assert_eq!(events[0], (0.5, false));
    }

    #[test]
    fn a_tired_pixel_fires_less() {
        let comparator = Comparator { fatigue: Some((0.5, 1.0)), ..PLAIN };
        let piece = ComparatorSegment { from_s: 0.0, to_s: 0.1, from: 0.0, to: 2.01 };
        assert!(run(comparator, piece, &[]).len() < run(PLAIN, piece, &[]).len());
    }
}
