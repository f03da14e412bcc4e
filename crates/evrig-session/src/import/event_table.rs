//! Events from tables: npy, npz, text, HDF5 and Parquet.
//!
//! Which column is which, the unit of time and the convention of polarity are stated by the file or
//! the user, or are the only ones that fit the data; each is entered as a decision.

mod column_facts;
mod column_values;
mod columns;
mod floor;
mod polarity;
mod stored;
mod time_unit;

pub use columns::ColumnOrder;
use floor::check_area;
pub(super) use floor::{check_overlap, check_stamps};
pub use polarity::PolarityRule;
pub use time_unit::TimeUnit;
pub(super) use time_unit::{TIME_UNITS, seconds, stated_in, to_micros};

use super::typed_events::{ImportedEvents, TypedEvents};
use crate::epochs::{EpochChoice, Epochs};
use crate::{DataLoss, SessionError};
use evrig_core::event::Events;
use evrig_core::geometry::Size;
use evrig_format::StoredTable;
use evrig_format::npy::Column;
use floor::Coordinates;
use std::path::Path;
use time_unit::{StampResolution, TimeEvidence};

/// What the user states about a table of events.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct EventTableOptions {
    /// The unit of time.
    pub time_unit: Option<TimeUnit>,
    /// The order of the columns.
    pub columns: Option<ColumnOrder>,
    /// The values of the polarity.
    pub polarity: Option<PolarityRule>,
    /// The table of a file that has several.
    pub table: Option<String>,
    /// Which run of a restarted clock to take.
    pub epoch: EpochChoice,
    /// Time of the first event on the frames' clock, µs.
    pub begin_us: Option<i64>,
}

/// The grid and the time that events are expected in.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct EventSetting {
    /// The frames' grid, or that of `--size`.
    pub(super) size: Option<Size>,
    /// First and last frame, µs.
    pub(super) frames_us: Option<[i64; 2]>,
}

impl ImportedEvents {
    /// Refuses events that share no time with the frames.
    ///
    /// # Errors
    /// With both spans.
    pub(super) fn check_overlap(&self, setting: EventSetting) -> Result<(), String> {
        let t = self.events.as_slice().t;
        match (t.first(), t.last(), setting.frames_us) {
            (Some(&begin), Some(&end), Some(frames)) => check_overlap([begin, end], frames),
            _ => Ok(()),
        }
    }
}

/// Endings of tables.
pub(super) const TABLE_ENDINGS: [&str; 10] =
    ["npy", "npz", "csv", "txt", "tsv", "zip", "h5", "hdf5", "hdf", "parquet"];

/// Reads the events of a table.
pub(super) fn read(
    path: &Path,
    stream: &str,
    options: &EventTableOptions,
    setting: EventSetting,
) -> Result<ImportedEvents, SessionError> {
    let table = stored::read(path, options.table.as_deref())?;
    interpret(table, stream, options, setting).map_err(|what| SessionError::import(path, what))
}

/// Decides what the columns of a table are and makes events of them.
fn interpret(
    table: StoredTable,
    stream: &str,
    options: &EventTableOptions,
    setting: EventSetting,
) -> Result<ImportedEvents, String> {
    if table.n_rows() == 0 {
        return Err(table.damage.unwrap_or_else(|| "holds no events".into()));
    }
    let assignment = columns::assign(&table, options.columns.as_ref(), setting.size)?;
    let damage = table.damage.clone();
    let notes = table.notes;
    let mut taken: Vec<Option<Column>> =
        table.columns.into_iter().map(|(_, column)| Some(column)).collect();
    let [t, x, y, p] = assignment.columns.map(|i| taken[i].take().unwrap_or_default());
    let lengths = [t.len(), x.len(), y.len(), p.len()];
    if lengths.iter().any(|n| *n != lengths[0]) {
        return Err(format!("columns t, x, y, p have {lengths:?} values; expected equal numbers"));
    }
    let (x, y) = rayon::join(|| Coordinates::new("x", x), || Coordinates::new("y", y));
    let (x, y) = (x?, y?);
    let mut decisions = vec![assignment.decision];
    let size = match setting.size {
        Some(size) => size,
        None => grid(&x, &y, &notes, &mut decisions)?,
    };
    let stated = options.time_unit.map(|unit| (unit, "--time-unit".to_owned()));
    let stated = stated.or(assignment.unit).or_else(|| {
        let note = |note: &String| stated_in(note).map(|unit| (unit, format!("`{note}`")));
        notes.iter().find_map(note)
    });
    let unit = decide_unit(&t, stated, size, setting, table.t_offset_us, options)?;
    let mut t_us =
        to_micros(t, unit.0).map_err(|i| format!("event {i}: its time is beyond 64 bits of us"))?;
    decisions.push(unit.1.clone());
    let (on, decision) = polarity::decide(p, options.polarity)?;
    decisions.push(decision);
    shift(&mut t_us, table.t_offset_us, options.begin_us, &mut decisions)?;
    let rows = EventRows { t_us, x, y, on };
    let found = rows.assemble(stream, size, options.epoch, setting);
    let mut found = found.map_err(|what| format!("{what} ({})", unit.1))?;
    decisions.append(&mut found.decisions);
    found.decisions = decisions;
    let loss = |what| DataLoss { stream: stream.to_owned(), what, count: 0 };
    found.losses.extend(damage.map(loss));
    Ok(found)
}

fn decide_unit(
    t: &Column,
    stated: Option<(TimeUnit, String)>,
    size: Size,
    setting: EventSetting,
    offset_us: i64,
    options: &EventTableOptions,
) -> Result<(TimeUnit, String), String> {
    let resolution = match t {
        Column::Float(values) => resolution(values),
        Column::Short(_) | Column::Int(_) => StampResolution::Whole,
    };
    // Events that are shifted are not where the frames are.
    let is_shifted = options.begin_us.is_some() || offset_us != 0;
    let frames_us = setting.frames_us.filter(|[first, last]| last > first && !is_shifted);
    let evidence = TimeEvidence {
        n: t.len(),
        range: range(t),
        resolution,
        n_pixels: size.n_pixels() as f64,
        frames_us,
    };
    evidence.decide(stated)
}

/// Range of the middle eight tenths of the times, which a few stray stamps do not change; of all
/// where they are few. Many are sampled at equal steps.
fn range(t: &Column) -> [f64; 2] {
    let step = t.len().div_ceil(MAX_SAMPLED_TIMES).max(1);
    let mut times: Vec<f64> = (0..t.len()).step_by(step).map(|i| t.get(i)).collect();
    let n_outer = if t.len() < MIN_EVENTS_FOR_TENTHS { 0 } else { times.len() / 10 };
    let last = times.len().saturating_sub(1);
    let mut nth = |i: usize| {
        let (_, value, _) = times.select_nth_unstable_by(i, f64::total_cmp);
        *value
    };
    [nth(n_outer), nth(last - n_outer)]
}

/// Times whose tenths are sought: their standard error is 0.1 % of the events.
const MAX_SAMPLED_TIMES: usize = 1 << 16;

/// Fewer events have no tenths.
const MIN_EVENTS_FOR_TENTHS: usize = 20;

fn resolution(values: &[f64]) -> StampResolution {
    let is_near_whole = |value: f64| (value - value.round()).abs() < 1e-6 * value.abs().max(1.0);
    if values.iter().all(|value| value.fract() == 0.0) {
        StampResolution::Whole
    } else if values.iter().all(|value| is_near_whole(value * 1e3)) && values[0].abs() < 1e6 {
        StampResolution::Thousandths
    } else {
        StampResolution::Finer
    }
}

/// The grid that a note states, or the smallest that holds the events.
fn grid(
    x: &Coordinates,
    y: &Coordinates,
    notes: &[String],
    decisions: &mut Vec<String>,
) -> Result<Size, String> {
    let stated = notes.iter().find_map(|note| {
        let (width, height) = note.strip_prefix("sensor size ")?.split_once(" x ")?;
        Some((width.parse::<u16>().ok()?, height.parse::<u16>().ok()?))
    });
    if let Some((width, height)) = stated.filter(|(width, height)| *width > 0 && *height > 0) {
        let size = Size::new(width, height);
        decisions.push(format!("the sensor has {size} pixels (first line)"));
        return Ok(size);
    }
    let side = |most: i64, name: &str| {
        let side = most.checked_add(1).and_then(|side| u16::try_from(side).ok());
        let side = side.filter(|side| *side > 0);
        side.ok_or_else(|| format!("{name} is up to {most}; expected 0 to 65534"))
    };
    let size = Size::new(side(x.bounds[1], "x")?, side(y.bounds[1], "y")?);
    decisions.push(format!("the sensor has {size} pixels, by its outermost events; see --size"));
    Ok(size)
}

/// Adds the offset of the file, or moves the first event to where the user wants it.
fn shift(
    t_us: &mut [i64],
    offset_us: i64,
    begin_us: Option<i64>,
    decisions: &mut Vec<String>,
) -> Result<(), String> {
    let by = match begin_us {
        Some(begin) => {
            let first = t_us.iter().copied().min().unwrap_or(0);
            decisions.push(format!("the first event is moved from {first} to {begin} us"));
            begin.checked_sub(first)
        }
        None if offset_us == 0 => return Ok(()),
        None => {
            decisions.push(format!("the file's t_offset of {offset_us} us is added to the times"));
            Some(offset_us)
        }
    };
    let add = |t: &mut i64| by.and_then(|by| t.checked_add(by)).map(|moved| *t = moved);
    match t_us.iter_mut().all(|t| add(t).is_some()) {
        true => Ok(()),
        false => Err("the times are beyond 64 bits of us".into()),
    }
}

/// Columns that are understood.
struct EventRows {
    t_us: Vec<i64>,
    x: Coordinates,
    y: Coordinates,
    on: Vec<bool>,
}

impl EventRows {
    fn assemble(
        self,
        stream: &str,
        size: Size,
        choice: EpochChoice,
        setting: EventSetting,
    ) -> Result<ImportedEvents, String> {
        let Self { t_us, mut x, mut y, on } = self;
        let mut decisions = Vec::new();
        if x.is_one_based(size.width) && y.is_one_based(size.height) && setting.size.is_some() {
            decisions.push("x and y count from 1; they are stored from 0".into());
            x.values.iter_mut().chain(&mut y.values).for_each(|v| *v -= 1);
        }
        let epochs = Epochs::of_stamps(&t_us);
        let is_by_polarity = epochs.all.len() > 1 && are_of_one_polarity(&epochs, &on);
        let choice = if is_by_polarity { EpochChoice::All } else { choice };
        if is_by_polarity {
            decisions.push("events of each polarity are in order of time; all were sorted".into());
        }
        let [x_values, y_values] = [&mut x, &mut y].map(|c| std::mem::take(&mut c.values));
        let events = Events::from_columns(t_us, x_values, y_values, on);
        let events = events.map_err(|error| error.to_string())?;
        let found =
            TypedEvents { events, size }.keep(stream, &epochs, choice, |n, n_outside| {
                floor::check_grid([&x, &y], n, n_outside, size)
            })?;
        check_stamps(found.events.as_slice().t)?;
        check_area(found.events.as_slice(), size)?;
        found.check_overlap(setting)?;
        Ok(ImportedEvents { decisions, ..found })
    }
}

/// Whether every epoch holds events of one polarity: then the table was sorted by polarity.
fn are_of_one_polarity(epochs: &Epochs, on: &[bool]) -> bool {
    let mut found: Vec<Option<bool>> = vec![None; epochs.all.len()];
    on.iter().enumerate().all(|(i, on)| {
        let of_epoch = &mut found[epochs.epoch_of(i as u64)];
        *of_epoch.get_or_insert(*on) == *on
    })
}

#[cfg(test)]
mod tests;
