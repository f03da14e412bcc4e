//! Events from tables: npy, npz, csv, HDF5; columns t (µs), x, y, p.

use crate::{DataLoss, SessionError};
use evrig_core::event::{Event, Events};
use evrig_core::geometry::Size;
use evrig_format::aedat4::{Content, Reader};
use evrig_format::hdf5;
use evrig_format::npy::{Array, ArrayReader, Column, Npz};
use std::path::Path;

/// Events read from a file, and what of them could not be taken.
pub(super) struct ImportedEvents {
    pub(super) events: Events,
    pub(super) losses: Vec<DataLoss>,
}

/// The four columns as whole numbers, of equal length.
struct IntegerColumns {
    t: Vec<i64>,
    x: Vec<i64>,
    y: Vec<i64>,
    p: Vec<i64>,
}

/// Reads events of the pixel grid `size` from a file, by its extension.
pub(super) fn read(path: &Path, stream: &str, size: Size) -> Result<ImportedEvents, SessionError> {
    let ending = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    match ending.as_str() {
        "npy" => {
            let array = ArrayReader::open(path)?.read_all()?;
            assemble(path, stream, size, from_array(path, array)?)
        }
        "npz" => assemble(path, stream, size, from_npz(path)?),
        "csv" | "txt" => assemble(path, stream, size, from_csv(path)?),
        "h5" | "hdf5" => assemble(path, stream, size, from_hdf5(path)?),
        "aedat4" => from_aedat4(path, stream, size),
        _ => Err(SessionError::import(
            path,
            format!(
                "events are read from .npz, .npy, .csv, .txt, .h5, .hdf5 or .aedat4, not `.{ending}`"
            ),
        )),
    }
}

fn from_aedat4(path: &Path, stream: &str, size: Size) -> Result<ImportedEvents, SessionError> {
    let mut columns = IntegerColumns { t: vec![], x: vec![], y: vec![], p: vec![] };
    let mut damage = None;
    for packet in Reader::open(path)? {
        match packet {
            Ok(packet) => {
                let Content::Events(events) = packet.content else { continue };
                for event in events.as_slice().iter() {
                    columns.t.push(event.t);
                    columns.x.push(event.x.into());
                    columns.y.push(event.y.into());
                    columns.p.push(event.on.into());
                }
            }
            Err(error) => damage = Some(error.to_string()),
        }
    }
    let mut table = assemble(path, stream, size, columns)?;
    let loss = |what| DataLoss { stream: stream.to_owned(), what, count: 0 };
    table.losses.extend(damage.map(loss));
    Ok(table)
}

fn from_hdf5(path: &Path) -> Result<IntegerColumns, SessionError> {
    let table = hdf5::read_events(path)?;
    let mut columns = columns_from(path, table.columns.into())?;
    columns.t.iter_mut().for_each(|t| *t = t.saturating_add(table.t_offset_us));
    Ok(columns)
}

fn from_npz(path: &Path) -> Result<IntegerColumns, SessionError> {
    let mut npz = Npz::open(path)?;
    let names = npz.names();
    let wrong = |what: String| SessionError::import(path, what);
    let columns_by_name: Option<Vec<String>> = [["t", "t_us"], ["x", "x"], ["y", "y"], ["p", "on"]]
        .iter()
        .map(|known| known.iter().find(|n| names.iter().any(|m| m == *n)).map(|n| n.to_string()))
        .collect();
    if let Some(found) = columns_by_name {
        let mut fields = Vec::new();
        for name in found {
            let column = npz.array(&name)?.fields.pop();
            fields.push(column.ok_or_else(|| wrong(format!("array `{name}` is empty")))?.1);
        }
        return columns_from(path, fields);
    }
    let table = ["events", "arr_0"].into_iter().find(|name| names.iter().any(|n| n == name));
    match (table, names.as_slice()) {
        (Some(name), _) => from_array(path, npz.array(name)?),
        (None, [only]) => from_array(path, npz.array(only)?),
        (None, _) => Err(wrong(format!(
            "holds {names:?}; expected arrays t, x, y, p, or one array `events` of shape (N, 4)"
        ))),
    }
}

/// A structured array with fields t, x, y, p, or a plain one of shape (N, 4).
fn from_array(path: &Path, array: Array) -> Result<IntegerColumns, SessionError> {
    let wrong = |what: String| SessionError::import(path, what);
    if array.fields.len() > 1 {
        let names: Vec<String> = array.fields.iter().map(|(name, _)| name.clone()).collect();
        let mut fields = array.fields;
        let mut take = |known: &[&str]| {
            let at = fields.iter().position(|(name, _)| known.contains(&name.as_str()))?;
            Some(fields.swap_remove(at).1)
        };
        let found = [
            take(&["t", "t_us", "ts", "timestamp"]),
            take(&["x"]),
            take(&["y"]),
            take(&["p", "on", "polarity"]),
        ];
        let found: Option<Vec<Column>> = found.into_iter().collect();
        let found =
            found.ok_or_else(|| wrong(format!("has fields {names:?}; expected t, x, y and p")))?;
        return columns_from(path, found);
    }
    let plain = array.fields.into_iter().next();
    match (array.shape.as_slice(), plain) {
        ([_, 4], Some((_, column))) => {
            let values = whole(path, "the array", column)?;
            let pick = |i: usize| values.iter().skip(i).step_by(4).copied().collect();
            Ok(IntegerColumns { t: pick(0), x: pick(1), y: pick(2), p: pick(3) })
        }
        (shape, _) => Err(wrong(format!(
            "has shape {shape:?}; expected (N, 4) with columns t in us, x, y, p"
        ))),
    }
}

fn columns_from(path: &Path, fields: Vec<Column>) -> Result<IntegerColumns, SessionError> {
    let lengths: Vec<usize> = fields.iter().map(Column::len).collect();
    if lengths.iter().any(|n| *n != lengths[0]) {
        let what = format!("columns t, x, y, p have {lengths:?} values; expected as many in each");
        return Err(SessionError::import(path, what));
    }
    let names = ["column t", "column x", "column y", "column p"];
    let mut columns = names.into_iter().zip(fields).map(|(name, field)| whole(path, name, field));
    let mut next = || columns.next().unwrap_or_else(|| Ok(Vec::new()));
    Ok(IntegerColumns { t: next()?, x: next()?, y: next()?, p: next()? })
}

fn whole(path: &Path, name: &str, column: Column) -> Result<Vec<i64>, SessionError> {
    column.into_integers().map_err(|i| {
        SessionError::import(path, format!("{name} holds a value at index {i} that is no number"))
    })
}

/// Text with one event a line, `t,x,y,p`; a heading may name the columns in another order,
/// and blanks may replace the commas.
fn from_csv(path: &Path) -> Result<IntegerColumns, SessionError> {
    let text = std::fs::read_to_string(path).map_err(SessionError::io(path))?;
    let delimiter = if text.lines().take(3).any(|line| line.contains(',')) { b',' } else { b' ' };
    let mut reader = csv::ReaderBuilder::new()
        .has_headers(false)
        .delimiter(delimiter)
        .trim(csv::Trim::All)
        .comment(Some(b'#'))
        .flexible(true)
        .from_reader(text.as_bytes());
    let mut order = [0, 1, 2, 3];
    let mut columns = IntegerColumns { t: vec![], x: vec![], y: vec![], p: vec![] };
    for (number, record) in reader.records().enumerate() {
        let record = record.map_err(|e| SessionError::import(path, e.to_string()))?;
        let line = record.position().map_or(number as u64 + 1, csv::Position::line);
        let cells: Vec<&str> = record.iter().filter(|cell| !cell.is_empty()).collect();
        let is_heading = cells.iter().any(|cell| cell.parse::<f64>().is_err());
        if number == 0 && is_heading {
            order = heading(path, &cells)?;
            continue;
        }
        let cell = |i: usize| {
            let cell = cells.get(order[i]).copied().unwrap_or("");
            let number = cell.parse::<i64>().ok().or_else(|| {
                cell.parse::<f64>().ok().filter(|v| v.is_finite()).map(|v| v.round() as i64)
            });
            number.ok_or_else(|| {
                let what = format!("line {line}: expected t,x,y,p as numbers, found `{cell}`");
                SessionError::import(path, what)
            })
        };
        columns.t.push(cell(0)?);
        columns.x.push(cell(1)?);
        columns.y.push(cell(2)?);
        columns.p.push(cell(3)?);
    }
    Ok(columns)
}

fn heading(path: &Path, cells: &[&str]) -> Result<[usize; 4], SessionError> {
    let find = |known: &[&str]| {
        let position = cells.iter().position(|c| known.contains(&c.to_lowercase().as_str()));
        position.ok_or_else(|| {
            let what = format!("heading {cells:?} names no column `{}`", known[0]);
            SessionError::import(path, what)
        })
    };
    Ok([
        find(&["t", "t_us", "ts", "timestamp", "timestamp_us"])?,
        find(&["x"])?,
        find(&["y"])?,
        find(&["p", "on", "polarity"])?,
    ])
}

fn assemble(
    path: &Path,
    stream: &str,
    size: Size,
    columns: IntegerColumns,
) -> Result<ImportedEvents, SessionError> {
    let mut events = Events::with_capacity(columns.t.len());
    let (mut n_outside, mut n_disordered, mut last) = (0, 0, i64::MIN);
    let xy = columns.x.iter().zip(&columns.y);
    for (i, ((&t, (&x, &y)), &p)) in columns.t.iter().zip(xy).zip(&columns.p).enumerate() {
        if !(-1..=1).contains(&p) {
            let what = format!("event {i} has polarity {p}; expected 1 for On, 0 or -1 for Off");
            return Err(SessionError::import(path, what));
        }
        let on_grid = (u16::try_from(x), u16::try_from(y));
        match on_grid {
            (Ok(x), Ok(y)) if size.contains(x, y) => {
                n_disordered += u64::from(t < last);
                last = last.max(t);
                events.push(Event { t, x, y, on: p > 0 });
            }
            _ => n_outside += 1,
        }
    }
    events.sort_by_time();
    let loss = |count, what: String| DataLoss { stream: stream.to_owned(), what, count };
    let mut losses = Vec::new();
    if n_outside > 0 {
        losses.push(loss(n_outside, format!("events off the {size} grid were left out")));
    }
    if n_disordered > 0 {
        losses.push(loss(n_disordered, "events out of order were sorted by time".into()));
    }
    Ok(ImportedEvents { events, losses })
}
