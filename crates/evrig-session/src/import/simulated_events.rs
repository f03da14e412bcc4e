//! Events that a simulator made of frames: all of them on the frames' grid and in their time.

use super::event_table::{EventSetting, EventTableOptions};
use super::imported_events;
use super::typed_events::SORTED_BY_TIME;
use crate::SessionError;
use crate::epochs::EpochChoice;
use evrig_core::event::{Event, Events};
use evrig_core::geometry::Size;
use std::path::Path;

/// Reads the events of a simulator from a file of any kind that is read.
///
/// Times are microseconds since the first frame, 0 to `last_us`; events in another order are sorted.
/// [`EventTableOptions::epoch`] has no effect: a simulator's clock does not restart.
///
/// # Errors
/// When the file cannot be read, or an event is off the frames' grid or outside their time.
pub fn read_simulated_events(
    path: &Path,
    size: Size,
    last_us: i64,
    options: &EventTableOptions,
) -> Result<Events, SessionError> {
    let setting = EventSetting { size: Some(size), frames_us: Some([0, last_us]) };
    let options = EventTableOptions { epoch: EpochChoice::All, ..options.clone() };
    let found = imported_events::read(path, "simulated", &options, setting)?;
    let wrong = |what: String| Err(SessionError::import(path, what));
    if let Some(loss) = found.losses.iter().find(|loss| loss.what != SORTED_BY_TIME) {
        let n = if loss.count > 0 { format!("{} ", loss.count) } else { String::new() };
        return wrong(format!("{n}{}; expected every event on the frames' grid", loss.what));
    }
    // Seconds that were rounded differ by one microsecond at most.
    let is_inside = |t: i64| (-1..=last_us + 1).contains(&t);
    let events = found.events.as_slice();
    if let Some(&t_us) = events.t.iter().find(|t| !is_inside(**t)) {
        let n = events.t.iter().filter(|t| !is_inside(**t)).count();
        return wrong(format!(
            "{n} of {} events are outside the time of the frames, the first at {t_us} us; expected \
             0 to {last_us} us since the first frame",
            events.len()
        ));
    }
    Ok(events.iter().map(|event| Event { t: event.t.clamp(0, last_us), ..event }).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: Size = Size { width: 8, height: 6 };

    /// Reads rows of t in seconds, x, y, p.
    fn read(rows: &[(f64, u16, u16, u8)]) -> Result<Events, String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("out.csv");
        let lines = rows.iter().map(|(t, x, y, p)| format!("{t:.6},{x},{y},{p}\n"));
        std::fs::write(&path, "t,x,y,p\n".to_owned() + &lines.collect::<String>()).unwrap();
        let found = read_simulated_events(&path, SIZE, 1_000_000, &EventTableOptions::default());
        found.map_err(|error| error.to_string())
    }

    fn rows() -> Vec<(f64, u16, u16, u8)> {
        (0..100)
            .map(|i| (0.01 * f64::from(i) + 0.003_217, i % 8, i / 8 % 6, (i % 2) as u8))
            .collect()
    }

    #[test]
    fn events_in_any_order_are_read_in_order_of_time() {
        let mut shuffled = rows();
        shuffled.sort_by_key(|row| (row.1, row.2));
        let events = read(&shuffled).unwrap();
        assert_eq!(events, read(&rows()).unwrap());
        assert_eq!((events.len(), events.as_slice().get(1).t), (100, 13_217));
    }

    #[test]
    fn an_event_off_the_grid_or_after_the_last_frame_is_an_error() {
        let mut off = rows();
        off[50].1 = 8;
        let message = read(&off).unwrap_err();
        assert!(message.contains("1 events off the 8 x 6 grid"), "{message}");
        let mut late = rows();
        late[99].0 = 1.25;
        let message = read(&late).unwrap_err();
        assert!(message.contains("1 of 100") && message.contains("1250000 us"), "{message}");
    }
}
