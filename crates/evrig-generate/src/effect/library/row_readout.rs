//! Row readout: the pending events of a row are read together and share a stamp.
//!
//! The arbiter grants a row, all its requests are read in one go, then the next row that waits
//! longest; a row takes `row_us` (as in column-parallel DAVIS readout; Joubert et al., IEBCS,
//! 2021). Signature: events of one row with one stamp, far more than chance.

use crate::effect::model::{EffectModel, ReadoutContext};
use evrig_core::event::{Event, Events};
use std::collections::VecDeque;

effect! {
    /// Rows are read one after another.
    RowReadout, Readout, "t_out = start of the row's turn + T_row, the same for all its requests" {
        /// Time to read a row, µs.
        row_us: 0.0 to 1e5,
    }
}

impl EffectModel for RowReadout {
    fn apply_to_events(&self, camera: &ReadoutContext<'_>, events: &mut Events) {
        let n_rows = usize::from(camera.size.height);
        camera.change(events, |requests| read_rows(&requests, n_rows, self.row_us));
    }
}

/// Requests in ascending time become events stamped at the end of their row's turn.
fn read_rows(requests: &[Event], n_rows: usize, row_us: f64) -> Vec<Event> {
    let mut waiting: Vec<Vec<Event>> = vec![Vec::new(); n_rows];
    let mut turns = VecDeque::new();
    let mut read = Vec::with_capacity(requests.len());
    let mut requests = requests.iter().copied().peekable();
    let mut free_us = f64::MIN;
    loop {
        if turns.is_empty() {
            let Some(next) = requests.peek() else { return read };
            free_us = free_us.max(next.t as f64);
        }
        while let Some(request) = requests.next_if(|request| request.t as f64 <= free_us) {
            let row = &mut waiting[usize::from(request.y)];
            if row.is_empty() {
                turns.push_back(request.y);
            }
            // A pixel that waits does not ask again.
            if row.iter().all(|other| other.x != request.x) {
                row.push(request);
            }
        }
        if let Some(y) = turns.pop_front() {
            free_us += row_us;
            let t = free_us.floor() as i64;
            read.extend(waiting[usize::from(y)].drain(..).map(|event| Event { t, ..event }));
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::test_support::*;
    use evrig_core::event::Event;
    use std::collections::BTreeMap;

    #[test]
    fn events_of_a_row_share_stamps_and_rows_keep_their_distance() {
        let flash = synthetic(|[x, y], t| if t < 0.1 + 1e-5 * (x + 3.0 * y) { -3.0 } else { -2.5 });
        let plain = events(&flash, 0.3, &[]);
        let read = events(&flash, 0.3, &["row_readout:row_us=40"]);
        let mut stamps = BTreeMap::<i64, Vec<Event>>::new();
        read.iter().for_each(|e| stamps.entry(e.t).or_default().push(*e));
        assert!(stamps.values().all(|events| events.iter().all(|e| e.y == events[0].y)));
        let times: Vec<i64> = stamps.keys().copied().collect();
        assert!(times.windows(2).all(|pair| pair[1] - pair[0] >= 39));
        let mean = read.len() as f64 / stamps.len() as f64;
        assert!(mean > 5.0, "{mean} events a stamp");
        assert!(read.len() <= plain.len() && read.len() > plain.len() / 3);
    }
}
