//! Intervals between successive events of a pixel, counted by the polarities of both.
//!
//! Intervals are censored where a burst that follows the camera's frames ends them, and at the
//! end of the recording: a pixel that waited is at risk of an event that long.

use evrig_core::event::EventSlice;
use evrig_core::geometry::Size;

/// Lags that are counted, in steps of the stamps; longer ones only count as waiting. At one
/// microsecond they reach 65 ms, beyond the periods of published refractory settings (0.05 to
/// 20 ms).
pub(super) const N_LAGS: usize = 1 << 16;

/// What began an interval.
pub(super) const AFTER_ON: usize = 0;
pub(super) const AFTER_OFF: usize = 1;
pub(super) const AFTER_BURST: usize = 2;
const N_ORIGINS: usize = 3;

/// Quarters of the events: half of the time, half of the pixels.
const N_QUARTERS: usize = 4;

const NO_EVENT: u8 = u8::MAX;

/// Numbers of intervals by lag, by what began them and what ended them.
pub(super) struct IntervalCounts {
    /// ON, OFF, or censored, by quarter and origin.
    counts: Vec<[Vec<u32>; 3]>,
    /// Intervals longer than all lags, by quarter and origin.
    longer: Vec<u64>,
    pub(super) step_us: f64,
}

/// The intervals with one origin and one end.
pub(super) struct LagCounts {
    /// Events by lag.
    pub(super) n: Vec<u32>,
    /// Pixels that wait at each lag.
    pub(super) at_risk: Vec<f64>,
}

/// Which quarters to add up.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum EventHalf {
    All,
    /// First or second half of the time.
    Time(usize),
    /// Even or odd fields of a checkerboard.
    Checkerboard(usize),
}

impl EventHalf {
    pub(super) const HALVES: [Self; 4] =
        [Self::Time(0), Self::Time(1), Self::Checkerboard(0), Self::Checkerboard(1)];

    fn holds(self, quarter: usize) -> bool {
        match self {
            Self::All => true,
            Self::Time(half) => quarter / 2 == half,
            Self::Checkerboard(half) => quarter % 2 == half,
        }
    }
}

impl IntervalCounts {
    /// Counts the intervals of all pixels but the masked ones; `is_burst` marks events of bursts.
    pub(super) fn new(
        events: EventSlice<'_>,
        size: Size,
        hot: &[bool],
        is_burst: &[bool],
        step_us: f64,
    ) -> Self {
        let n_classes = N_QUARTERS * N_ORIGINS;
        let mut all = Self {
            counts: (0..n_classes).map(|_| std::array::from_fn(|_| vec![0; N_LAGS])).collect(),
            longer: vec![0; n_classes],
            step_us,
        };
        let [first, last] = [events.t.first(), events.t.last()].map(|t| t.copied().unwrap_or(0));
        let middle = first + (last - first) / 2;
        let mut last_t = vec![0_i64; size.n_pixels()];
        let mut origins = vec![NO_EVENT; size.n_pixels()];
        for i in 0..events.len() {
            let (t, x, y) = (events.t[i], events.x[i], events.y[i]);
            let pixel = size.index(x, y);
            if hot.get(pixel).copied().unwrap_or(false) {
                continue;
            }
            let in_burst = is_burst.get(i).copied().unwrap_or(false);
            if origins[pixel] != NO_EVENT {
                let quarter = quarter(t >= middle, x, y);
                let end = if in_burst { 2 } else { usize::from(!events.on[i]) };
                all.add(quarter, origins[pixel], end, t - last_t[pixel]);
            }
            last_t[pixel] = t;
            origins[pixel] = match (in_burst, events.on[i]) {
                (true, _) => AFTER_BURST,
                (false, true) => AFTER_ON,
                (false, false) => AFTER_OFF,
            } as u8;
        }
        for y in 0..size.height {
            for x in 0..size.width {
                let pixel = size.index(x, y);
                if origins[pixel] != NO_EVENT {
                    all.add(quarter(true, x, y), origins[pixel], 2, last - last_t[pixel]);
                }
            }
        }
        all
    }

    fn add(&mut self, quarter: usize, origin: u8, end: usize, us: i64) {
        let class = quarter * N_ORIGINS + usize::from(origin);
        let lag = (us as f64 / self.step_us).round() as usize;
        match self.counts[class][end].get_mut(lag) {
            Some(count) => *count += 1,
            None => self.longer[class] += 1,
        }
    }

    /// The intervals of an origin that end in ON or OFF.
    pub(super) fn pair(&self, origin: usize, ends_on: bool, half: EventHalf) -> LagCounts {
        let end = usize::from(!ends_on);
        let mut n = vec![0; N_LAGS];
        let mut at_risk = vec![0.0; N_LAGS];
        let mut waiting = 0.0;
        for quarter in (0..N_QUARTERS).filter(|quarter| half.holds(*quarter)) {
            let class = quarter * N_ORIGINS + origin;
            let ends = &self.counts[class];
            n.iter_mut().zip(&ends[end]).for_each(|(n, count)| *n += count);
            for (lag, risk) in at_risk.iter_mut().enumerate() {
                *risk += ends.iter().map(|ends| f64::from(ends[lag])).sum::<f64>();
            }
            waiting += self.longer[class] as f64;
        }
        for risk in at_risk.iter_mut().rev() {
            waiting += *risk;
            *risk = waiting;
        }
        LagCounts { n, at_risk }
    }
}

fn quarter(is_late: bool, x: u16, y: u16) -> usize {
    2 * usize::from(is_late) + usize::from((x ^ y) & 1)
}

impl LagCounts {
    /// Events between two lags, and the time that pixels waited there, in steps.
    pub(super) fn between(&self, from: usize, to: usize) -> (f64, f64) {
        let to = to.min(N_LAGS);
        let from = from.min(to);
        let n = self.n[from..to].iter().map(|n| f64::from(*n)).sum();
        // Lag 0 is the half of a step after an event.
        let half = if from == 0 && to > 0 { 0.5 * self.at_risk[0] } else { 0.0 };
        (n, self.at_risk[from..to].iter().sum::<f64>() - half)
    }

    /// The shortest lags, one for each event.
    pub(super) fn shortest(&self, count: usize) -> Vec<usize> {
        let lags = self.n.iter().enumerate().filter(|(_, n)| **n > 0);
        lags.flat_map(|(lag, n)| std::iter::repeat_n(lag, *n as usize)).take(count).collect()
    }

    pub(super) fn n_events(&self) -> u64 {
        self.n.iter().map(|n| u64::from(*n)).sum()
    }
}
