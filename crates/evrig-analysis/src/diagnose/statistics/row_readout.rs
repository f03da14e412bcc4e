//! Row readout: all waiting events of a row get one time stamp.

use super::Departure;
use super::bus_saturation::{ServiceGap, shortest_gap};
use crate::diagnose::evidence::stamp_grid::is_row_readout;
use evrig_core::effect_id::EffectId;
use evrig_core::event::EventSlice;

/// Share and number of events with the stamp of the one before.
const MIN_TIE_SHARE: f64 = 0.005;

const MIN_TIES: usize = 200;

/// Share of row readouts that follow each other without a pause.
const MIN_BACK_TO_BACK_SHARE: f64 = 0.02;

/// Row readout, if the events show it, and whether it is saturated. `events` are in ascending
/// time.
pub(super) fn readout(events: EventSlice<'_>) -> Option<(Departure, bool)> {
    let turn = turn(&turns(events)?)?;
    let departure = Departure {
        id: EffectId::RowReadout,
        parameters: vec![("row_us", [turn.us, turn.error_us])],
        description: format!(
            "waiting events of a row are read together with one time stamp, a row every {:.1} us \
             at most",
            turn.us
        ),
        z: turn.us / turn.error_us,
        without: None,
    };
    Some((departure, turn.is_busy()))
}

/// Readout times, if equal stamps lie in one row.
fn turns(events: EventSlice<'_>) -> Option<Vec<i64>> {
    let together = || (1..events.len()).filter(|i| events.t[i - 1] == events.t[*i]);
    let (n, n_of_one) =
        (together().count(), together().filter(|i| events.y[i - 1] == events.y[*i]).count());
    let is_significant = n >= MIN_TIES && n as f64 >= MIN_TIE_SHARE * events.len() as f64;
    if !is_significant || !is_row_readout(n_of_one, n) {
        return None;
    }
    let mut turns: Vec<i64> = events.t.to_vec();
    turns.dedup();
    Some(turns)
}

/// Readout time of a row, if enough rows follow without a pause.
fn turn(turns: &[i64]) -> Option<ServiceGap> {
    let gap = shortest_gap(turns).filter(|gap| gap.share >= MIN_BACK_TO_BACK_SHARE)?;
    // Stamps are whole microseconds.
    Some(ServiceGap { error_us: gap.error_us.clamp(0.1, 0.5), ..gap })
}

#[cfg(test)]
mod tests {
    use super::*;
    use evrig_core::event::{Event, Events};
    use evrig_core::stats::SplitMix;

    /// Random requests, 60 000 per second in 100 rows, and the same read row by row in 17.4 us.
    fn requests() -> [Vec<(i64, u16)>; 2] {
        let mut random = SplitMix::new(5, 1);
        let mut t = 0.0;
        let asked: Vec<(f64, u16)> = (0..30_000)
            .map(|_| {
                t += 1e6 / 60_000.0 * random.exponential();
                (t, random.below(100) as u16)
            })
            .collect();
        let free = asked.iter().map(|(t, y)| (*t as i64, *y)).collect();
        let mut waiting: Vec<(f64, u16)> = Vec::new();
        let (mut read, mut at, mut next) = (Vec::new(), 0.0_f64, 0);
        while next < asked.len() || !waiting.is_empty() {
            let oldest = waiting.first().map_or_else(|| asked[next].0, |first| first.0);
            at = at.max(oldest);
            while next < asked.len() && asked[next].0 <= at {
                waiting.push(asked[next]);
                next += 1;
            }
            let row = waiting[0].1;
            let turn = waiting.iter().filter(|request| request.1 == row);
            read.extend(turn.map(|request| (at.round() as i64, request.1)));
            waiting.retain(|request| request.1 != row);
            at += 17.4;
        }
        [free, read]
    }

    #[test]
    fn row_readout_is_found_with_its_time() {
        let [free, read] = requests().map(|all| -> Events {
            all.into_iter().map(|(t, y)| Event { t, x: 0, y, on: true }).collect()
        });
        assert!(turns(free.as_slice()).is_none());
        let turn = turn(&turns(read.as_slice()).unwrap()).unwrap();
        assert!((turn.us - 17.4).abs() < 2.0 * turn.error_us, "{} +- {}", turn.us, turn.error_us);
    }
}
