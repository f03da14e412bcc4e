//! Events from tables: npy, npz, text, HDF5 and Parquet.
//!
//! Which column is which, the unit of time and the convention of polarity are stated by the file or
//! the user, or are the only ones that fit the data; each is entered as a decision.

mod column_facts;
mod columns;
mod floor;
mod polarity;
mod stored;
mod time_unit;

pub use columns::ColumnOrder;
pub(super) use floor::{check_area, check_overlap, check_stamps};
pub use polarity::PolarityRule;
pub use time_unit::TimeUnit;
pub(super) use time_unit::{TIME_UNITS, seconds, stated_in, to_micros};

use crate::epochs::{EpochChoice, Epochs};
use crate::{DataLoss, SessionError};
use evrig_core::event::{Event, Events};
use evrig_core::geometry::Size;
use evrig_format::StoredTable;
use evrig_format::npy::Column;
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

/// Events read from a file, what of them could not be taken, and what was decided about them.
#[derive(Debug)]
pub(super) struct ImportedEvents {
    pub(super) events: Events,
    pub(super) size: Size,
    pub(super) losses: Vec<DataLoss>,
    pub(super) decisions: Vec<String>,
}

/// The loss of order, the only one that changes no event.
pub(super) const SORTED_BY_TIME: &str = "events out of order were sorted by time";

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
        return Err("holds no events".into());
    }
    let assignment = columns::assign(&table, options.columns.as_ref(), setting.size)?;
    let damage = table.damage.clone();
    let notes = table.notes;
    let mut taken: Vec<Option<Column>> =
        table.columns.into_iter().map(|(_, column)| Some(column)).collect();
    let mut take = |i: usize| taken[assignment.columns[i]].take().unwrap_or(Column::Int(vec![]));
    let [t, x, y, p] = [take(0), take(1), take(2), take(3)];
    let lengths = [t.len(), x.len(), y.len(), p.len()];
    if lengths.iter().any(|n| *n != lengths[0]) {
        return Err(format!("columns t, x, y, p have {lengths:?} values; expected equal numbers"));
    }
    let x = floor::whole_coordinates("x", x)?;
    let y = floor::whole_coordinates("y", y)?;
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
    let mut t_us = to_micros(&t, unit.0)
        .map_err(|i| format!("event {i}: its time is beyond 64 bits of us"))?;
    decisions.push(unit.1.clone());
    let (on, decision) = polarity::decide(p, options.polarity)?;
    decisions.push(decision);
    shift(&mut t_us, table.t_offset_us, options.begin_us, &mut decisions)?;
    check_stamps(&t_us)?;
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
    let (range, resolution) = match t {
        Column::Int(values) => {
            (range(values.iter().map(|t| *t as f64).collect()), StampResolution::Whole)
        }
        Column::Float(values) => (range(values.clone()), resolution(values)),
    };
    // Events that are shifted are not where the frames are.
    let is_shifted = options.begin_us.is_some() || offset_us != 0;
    let frames_us = setting.frames_us.filter(|[first, last]| last > first && !is_shifted);
    let evidence =
        TimeEvidence { n: t.len(), range, resolution, n_pixels: size.n_pixels() as f64, frames_us };
    evidence.decide(stated)
}

/// Range of the middle eight tenths of the times, which a few stray stamps do not change; of all
/// where they are few.
fn range(mut t: Vec<f64>) -> [f64; 2] {
    let n_outer = if t.len() < MIN_EVENTS_FOR_TENTHS { 0 } else { t.len() / 10 };
    let last = t.len().saturating_sub(1);
    let mut nth = |i: usize| {
        let (_, value, _) = t.select_nth_unstable_by(i, f64::total_cmp);
        *value
    };
    [nth(n_outer), nth(last - n_outer)]
}

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
    x: &[i64],
    y: &[i64],
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
    let side = |values: &[i64], name: &str| {
        let most = values.iter().copied().max().unwrap_or(0);
        let side = u16::try_from(most + 1).ok().filter(|side| *side > 0);
        side.ok_or_else(|| format!("{name} is up to {most}; expected 0 to 65534"))
    };
    let size = Size::new(side(x, "x")?, side(y, "y")?);
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
    let first = t_us.iter().copied().min().unwrap_or(0);
    let by = match begin_us {
        Some(begin) => {
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
    x: Vec<i64>,
    y: Vec<i64>,
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
        if is_one_based(&x, size.width) && is_one_based(&y, size.height) && setting.size.is_some() {
            decisions.push("x and y count from 1; they are stored from 0".into());
            x.iter_mut().chain(&mut y).for_each(|v| *v -= 1);
        }
        let epochs = Epochs::of_stamps(&t_us);
        let is_by_polarity = epochs.all.len() > 1 && are_of_one_polarity(&epochs, &on);
        let choice = if is_by_polarity { EpochChoice::All } else { choice };
        if is_by_polarity {
            decisions.push("events of each polarity are in order of time; all were sorted".into());
        }
        let mut losses = epochs.losses(stream, "events", choice)?;
        let mut events = Events::with_capacity(t_us.len());
        let (mut n_outside, mut n_disordered, mut last) = (0, 0, i64::MIN);
        for (i, &t) in t_us.iter().enumerate() {
            let (Ok(column), Ok(row)) = (u16::try_from(x[i]), u16::try_from(y[i])) else {
                n_outside += 1;
                continue;
            };
            if !size.contains(column, row) {
                n_outside += 1;
            } else if epochs.is_chosen(i, choice) {
                n_disordered += u64::from(t < last);
                last = last.max(t);
                events.push(Event { t, x: column, y: row, on: on[i] });
            }
        }
        floor::check_grid(&x, &y, n_outside, size)?;
        events.sort_by_time();
        check_area(events.as_slice(), size)?;
        let span = [events.as_slice().t.first(), events.as_slice().t.last()];
        if let ([Some(&begin), Some(&end)], Some(frames)) = (span, setting.frames_us) {
            check_overlap([begin, end], frames)?;
        }
        let loss = |count, what: String| DataLoss { stream: stream.to_owned(), what, count };
        if n_outside > 0 {
            losses.push(loss(n_outside, format!("events off the {size} grid were left out")));
        }
        if n_disordered > 0 {
            losses.push(loss(n_disordered, SORTED_BY_TIME.into()));
        }
        Ok(ImportedEvents { events, size, losses, decisions })
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

/// Whether coordinates run from 1 to the side, as MATLAB counts.
fn is_one_based(values: &[i64], side: u16) -> bool {
    let bounds =
        values.iter().fold([i64::MAX, i64::MIN], |[min, max], v| [min.min(*v), max.max(*v)]);
    side > 1 && bounds == [1, i64::from(side)]
}

#[cfg(test)]
mod tests;
