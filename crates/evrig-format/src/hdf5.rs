//! HDF5 event tables, as DSEC, M3ED, MVSEC, v2e, Metavision and many converters write them.
//!
//! The crate `hdf5-pure` reads them without the C library: contiguous and chunked data, plain
//! or with gzip, shuffle or LZF. Chunks of Blosc and Zstandard, which DSEC uses, are
//! decompressed here.

mod blosc;
mod dsec;
mod stored;
mod v2e;

pub use dsec::{SideColumn, SideGroup, write_dsec};
pub use v2e::write_v2e;

use crate::StoredTable;
use crate::column::NumberCell;
use hdf5_pure::{AttrValue, Dataset, Datatype, File, Group};
use std::path::{Path, PathBuf};
use stored::StoredColumns;

/// Why a file gives no events, or cannot be written.
#[derive(Debug, thiserror::Error)]
#[error("{path}: {what}", path = path.display())]
pub struct Hdf5Error {
    path: PathBuf,
    what: String,
}

/// Names under which the four columns are kept.
const COLUMN_NAMES: [&[&str]; 4] = [
    &["t", "ts", "timestamp", "timestamps", "t_us"],
    &["x", "xs"],
    &["y", "ys"],
    &["p", "ps", "polarity", "pol"],
];

/// Groups in groups that are searched.
const MAX_DEPTH: usize = 5;

/// A file open for reading.
struct Hdf5EventFile<'a> {
    path: &'a Path,
    file: File,
}

/// Reads the event table of an HDF5 file: columns in a group, one dataset of records, or one of
/// N x 4. `table` is its name where the file has several.
///
/// # Errors
/// When the file cannot be read, is no HDF5 file, or holds no event table or several.
pub fn read_events(path: &Path, table: Option<&str>) -> Result<StoredTable, Hdf5Error> {
    let wrong = |what: String| Hdf5Error { path: path.to_owned(), what };
    let file = File::open_streaming(path).map_err(|e| wrong(format!("cannot be read: {e}")))?;
    let file = Hdf5EventFile { path, file };
    let mut names = Vec::new();
    file.search(&file.file.root(), "", 0, &mut names);
    let name = match (table, names.as_slice()) {
        (Some(table), _) => {
            let table = table.trim_matches('/');
            let known = names.iter().find(|name| *name == table);
            known.ok_or_else(|| {
                wrong(format!("has no event table `{table}`; it has: {}", names.join(", ")))
            })?
        }
        (None, [only]) => only,
        (None, []) => {
            return Err(wrong(
                "holds no event table; expected columns t, x, y, p in a group, records of them, \
                 or one dataset `events` of N x 4"
                    .into(),
            ));
        }
        (None, several) => {
            return Err(wrong(format!(
                "holds several event tables; choose one with --table: {}",
                several.join(", ")
            )));
        }
    };
    file.read(name).map_err(wrong)
}

impl Hdf5EventFile<'_> {
    /// Names of all event tables below a group.
    fn search(&self, group: &Group, name: &str, depth: usize, found: &mut Vec<String>) {
        if depth > MAX_DEPTH {
            return;
        }
        let below = |child: &str| match name {
            "" => child.to_owned(),
            _ => format!("{name}/{child}"),
        };
        if self.columns_of(name).is_some() {
            found.push(name.to_owned());
        }
        for child in group.datasets().unwrap_or_default() {
            let is_named = child.to_lowercase().contains("event") && !name.contains("image");
            if let Ok(dataset) = group.dataset(&child)
                && is_table(&dataset, is_named)
            {
                found.push(below(&child));
            }
        }
        for child in group.groups().unwrap_or_default() {
            if let Ok(group) = group.group(&child) {
                self.search(&group, &below(&child), depth + 1, found);
            }
        }
    }

    /// The four columns in a group, with their names.
    fn columns_of(&self, group: &str) -> Option<Vec<(&'static str, Dataset)>> {
        let find = |names: &&[&'static str]| {
            let mut found = names.iter().filter_map(|name| {
                let path =
                    if group.is_empty() { (*name).into() } else { format!("{group}/{name}") };
                Some((names[0], self.file.dataset(&path).ok()?))
            });
            found.next()
        };
        COLUMN_NAMES.iter().map(find).collect()
    }

    fn read(&self, name: &str) -> Result<StoredTable, String> {
        let in_file = |what: String| format!("`{name}` {what}");
        let mut table = match self.columns_of(name) {
            Some(columns) => self.read_group(columns)?,
            None => self.read_dataset(name).map_err(in_file)?,
        };
        table.t_offset_us = self.t_offset(name)?;
        table.notes = self.notes(name);
        Ok(table)
    }

    /// Columns of a dataset each, as far as all of them can be read.
    fn read_group(&self, datasets: Vec<(&str, Dataset)>) -> Result<StoredTable, String> {
        let mut table = StoredTable::default();
        for (name, dataset) in datasets {
            let text = |what| format!("dataset `{name}` {what}");
            let StoredColumns { columns, damage } = self.read_column(&dataset).map_err(text)?;
            table.columns.extend(columns.into_iter().map(|column| (name.to_owned(), column)));
            table.damage = table.damage.or(damage.map(text));
        }
        if table.damage.is_some() {
            let n = table.columns.iter().map(|(_, column)| column.len()).min().unwrap_or(0);
            table.columns.iter_mut().for_each(|(_, column)| column.truncate(n));
        }
        Ok(table)
    }

    fn read_column(&self, dataset: &Dataset) -> Result<StoredColumns, String> {
        let text = |error: hdf5_pure::Error| error.to_string();
        let size = dataset.element_size().map_err(text)? as usize;
        let cell = stored::number_cell(&dataset.datatype().map_err(text)?, 0, size);
        let cell = cell.ok_or("is not of numbers")?;
        let shape = dataset.shape().map_err(text)?;
        if shape.iter().skip(1).any(|side| *side != 1) {
            return Err(format!("has shape {shape:?}; expected one number an event"));
        }
        stored::read_columns(self.path, dataset, &[cell])
    }

    fn read_dataset(&self, name: &str) -> Result<StoredTable, String> {
        let text = |error: hdf5_pure::Error| error.to_string();
        let dataset = self.file.dataset(name).map_err(text)?;
        let datatype = dataset.datatype().map_err(text)?;
        let size = dataset.element_size().map_err(text)? as usize;
        let fields: Vec<(String, NumberCell)> = match &datatype {
            Datatype::Compound { members, .. } => {
                let field = |member: &hdf5_pure::CompoundMember| {
                    let offset = member.byte_offset as usize;
                    let cell = stored::number_cell(&member.datatype, offset, size)?;
                    Some((member.name.clone(), cell))
                };
                members.iter().filter_map(field).collect()
            }
            number => {
                let cell = |i| stored::number_cell(number, i * size, 4 * size);
                let cells: Option<Vec<_>> = (0..4).map(cell).collect();
                let cells = cells.ok_or("is not of numbers")?;
                cells.into_iter().map(|cell| (String::new(), cell)).collect()
            }
        };
        let (names, cells): (Vec<String>, Vec<NumberCell>) = fields.into_iter().unzip();
        let StoredColumns { columns, damage } = stored::read_columns(self.path, &dataset, &cells)?;
        let table = StoredTable::of_columns(names.into_iter().zip(columns).collect());
        Ok(StoredTable { damage, ..table })
    }

    /// The offset of DSEC, at the root or beside the columns.
    fn t_offset(&self, name: &str) -> Result<i64, String> {
        let group = name.rsplit_once('/').map_or("", |(group, _)| group);
        let places = [format!("{name}/t_offset"), format!("{group}/t_offset"), "t_offset".into()];
        let found = places.iter().find_map(|place| self.file.dataset(place.trim_matches('/')).ok());
        let Some(dataset) = found else { return Ok(0) };
        let value = dataset.read_i64().map_err(|error| format!("`t_offset`: {error}"))?;
        Ok(value.first().copied().unwrap_or(0))
    }

    /// Texts among the attributes of the table and of its times.
    fn notes(&self, name: &str) -> Vec<String> {
        let of_dataset = |path: &str| self.file.dataset(path).ok()?.attrs().ok();
        let of_group = |path: &str| self.file.group(path).ok()?.attrs().ok();
        let places = [of_dataset(name), of_group(name), of_dataset(&format!("{name}/t"))];
        let attributes = places.into_iter().flatten().flatten();
        let mut notes: Vec<String> = attributes
            .filter_map(|(key, value)| match value {
                AttrValue::String(text)
                | AttrValue::AsciiString(text)
                | AttrValue::VarLenString(text)
                | AttrValue::VarLenAsciiString(text) => Some(format!("# {key}: {text}")),
                _ => None,
            })
            .collect();
        // The layout of DSEC is in microseconds.
        if self.file.dataset("ms_to_idx").is_ok() {
            notes.push("# time in us (layout of DSEC)".into());
        }
        notes
    }
}

/// Whether a dataset is a table of events: records of the four columns, or N x 4 numbers.
fn is_table(dataset: &Dataset, is_named: bool) -> bool {
    let has_all = |members: &[hdf5_pure::CompoundMember]| {
        let mut columns = COLUMN_NAMES.iter();
        columns.all(|names| members.iter().any(|member| names.contains(&member.name.as_str())))
    };
    match dataset.datatype() {
        Ok(Datatype::Compound { members, .. }) => has_all(&members),
        Ok(Datatype::FixedPoint { .. } | Datatype::FloatingPoint { .. }) => {
            is_named && dataset.shape().is_ok_and(|shape| matches!(shape.as_slice(), [_, 4]))
        }
        _ => false,
    }
}
