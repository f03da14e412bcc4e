//! What no event stream can be: checks before events are imported from a table.

use evrig_core::event::EventSlice;
use evrig_core::geometry::Size;
use evrig_format::npy::Column;

use super::column_values::bounds;
use super::time_unit::seconds;

/// Fewer events show nothing.
const MIN_EVENTS: usize = 20;

/// Refuses ascending stamps of which one is shared by nine tenths of the events: a coarser unit was
/// read.
///
/// # Errors
/// With the shared stamp.
pub(crate) fn check_stamps(t_us: &[i64]) -> Result<(), String> {
    let n = t_us.len();
    if n < MIN_EVENTS {
        return Ok(());
    }
    // A stamp of more than half of the events is that of the middle one.
    let shared = t_us[n / 2];
    let n_before = t_us.partition_point(|t| *t < shared);
    let n_shared = t_us.partition_point(|t| *t <= shared) - n_before;
    if 10 * n_shared < 9 * n {
        return Ok(());
    }
    Err(format!(
        "{n_shared} of {n} events are at {shared} us: the unit or the column of time is wrong; \
         state them with --time-unit and --columns"
    ))
}

/// A column of coordinates.
pub(super) struct Coordinates {
    /// 65535, which is on no grid, where a value does not fit.
    pub(super) values: Vec<u16>,
    /// Smallest and largest as stored.
    pub(super) bounds: [i64; 2],
}

impl Coordinates {
    /// # Errors
    /// When a value has a fraction or is not finite.
    pub(super) fn new(name: &str, column: Column) -> Result<Self, String> {
        if let Column::Float(values) = &column
            && let Some(i) = values.iter().position(|value| value.fract() != 0.0)
        {
            return Err(format!(
                "event {i} has {name} = {}; expected whole pixels: these are undistorted or scaled \
                 coordinates, or another column; give the events as the camera recorded them",
                values[i]
            ));
        }
        let (bounds, values) = match column {
            Column::Short(values) => (bounds(&values).map(|b| b.map(i64::from)), pixels(values)),
            wide => {
                let wide = wide.into_integers().map_err(|i| format!("event {i} has no {name}"))?;
                (bounds(&wide), pixels(wide))
            }
        };
        let bounds = bounds.unwrap_or([i64::MAX, i64::MIN]);
        Ok(Self { values, bounds })
    }

    /// Whether they run from 1 to the side, as MATLAB counts.
    pub(super) fn is_one_based(&self, side: u16) -> bool {
        side > 1 && self.bounds == [1, i64::from(side)]
    }

    /// Whether they are all on a grid of that side.
    fn fit(&self, side: u16) -> bool {
        self.bounds[0] >= 0 && self.bounds[1] < side.into()
    }
}

/// Values as pixels, 65535 where one does not fit.
fn pixels<T>(values: Vec<T>) -> Vec<u16>
where
    u16: TryFrom<T>,
{
    values.into_iter().map(|value| u16::try_from(value).unwrap_or(u16::MAX)).collect()
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
pub(super) fn check_grid(
    [x, y]: [&Coordinates; 2],
    n: usize,
    n_outside: u64,
    size: Size,
) -> Result<(), String> {
    let is_turned = 100 * n_outside > n as u64 && x.fit(size.height) && y.fit(size.width);
    if 2 * n_outside <= n as u64 && !is_turned {
        return Ok(());
    }
    Err(format!(
        "{n_outside} of {n} events are off the {size} grid (x up to {}, y up to {}): the events are \
         of another sensor size, or x and y are in another order; see --columns",
        x.bounds[1], y.bounds[1]
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
