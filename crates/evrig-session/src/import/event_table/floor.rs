//! What no event stream can be: checks before events are imported from a table.

use evrig_core::event::EventSlice;
use evrig_core::geometry::Size;
use evrig_format::npy::Column;

use super::time_unit::seconds;

/// Fewer events show nothing.
const MIN_EVENTS: usize = 20;

/// Refuses stamps of which one is shared by nine tenths of the events: a coarser unit was read.
///
/// # Errors
/// With the shared stamp.
pub(crate) fn check_stamps(t_us: &[i64]) -> Result<(), String> {
    let n = t_us.len();
    if n < MIN_EVENTS {
        return Ok(());
    }
    let mut sorted = t_us.to_vec();
    sorted.sort_unstable();
    // A stamp of nine tenths of the events is the median.
    let median = sorted[n / 2];
    let n_shared = t_us.iter().filter(|t| **t == median).count();
    if 10 * n_shared < 9 * n {
        return Ok(());
    }
    Err(format!(
        "{n_shared} of {n} events are at {median} us: the unit or the column of time is wrong; \
         state them with --time-unit and --columns"
    ))
}

/// The whole numbers of a column of coordinates.
///
/// # Errors
/// When one has a fraction.
pub(super) fn whole_coordinates(name: &str, column: Column) -> Result<Vec<i64>, String> {
    if let Column::Float(values) = &column
        && let Some(i) = values.iter().position(|value| value.fract() != 0.0)
    {
        return Err(format!(
            "event {i} has {name} = {}; expected whole pixels: these are undistorted or scaled \
             coordinates, or another column; give the events as the camera recorded them",
            values[i]
        ));
    }
    column.into_integers().map_err(|i| format!("event {i} has no {name}"))
}

/// Refuses events that all lie on one line of a grid with two sides.
///
/// # Errors
/// With the line.
pub(crate) fn check_area(events: EventSlice<'_>, size: Size) -> Result<(), String> {
    let pairs = || events.x.iter().zip(events.y).map(|(x, y)| [i32::from(*x), i32::from(*y)]);
    let Some([x0, y0]) = pairs().next() else { return Ok(()) };
    if events.x.len() < MIN_EVENTS || size.width < 2 || size.height < 2 {
        return Ok(());
    }
    let line = if pairs().all(|[x, _]| x == x0) {
        format!("x = {x0}")
    } else if pairs().all(|[_, y]| y == y0) {
        format!("y = {y0}")
    } else if pairs().all(|[x, y]| x - y == x0 - y0) {
        format!("y = x + {}", y0 - x0)
    } else {
        return Ok(());
    };
    Err(format!(
        "all {} events lie on the line {line} of the {size} grid: x or y was read from another \
         column; state the order with --columns",
        events.x.len()
    ))
}

/// Refuses a grid that holds less than half of the events.
///
/// # Errors
/// With the largest coordinates.
pub(super) fn check_grid(x: &[i64], y: &[i64], n_outside: u64, size: Size) -> Result<(), String> {
    let fits = |values: &[i64], side: u16| values.iter().all(|v| (0..side.into()).contains(v));
    let is_turned = 100 * n_outside > x.len() as u64 && fits(x, size.height) && fits(y, size.width);
    if 2 * n_outside <= x.len() as u64 && !is_turned {
        return Ok(());
    }
    let most = |values: &[i64]| values.iter().copied().max().unwrap_or(0);
    Err(format!(
        "{n_outside} of {} events are off the {size} grid (x up to {}, y up to {}): the events are \
         of another sensor size, or x and y are in another order; see --columns",
        x.len(),
        most(x),
        most(y)
    ))
}

/// Refuses events and frames that share no time.
///
/// # Errors
/// With both spans.
pub(crate) fn check_overlap(events_us: [i64; 2], frames_us: [i64; 2]) -> Result<(), String> {
    let [[begin, end], [first, last]] = [events_us, frames_us];
    if begin <= last && first <= end {
        return Ok(());
    }
    let apart = if begin > last { begin.saturating_sub(last) } else { first.saturating_sub(end) };
    Err(format!(
        "the events ({begin} to {end} us) and the frames ({first} to {last} us) do not overlap: \
         they are {} apart; give both on one clock, or the first event's time on the frames' \
         clock with --events-begin",
        seconds(apart as f64)
    ))
}
