//! HDF5 event tables, as DSEC, M3ED and many converters write them.
//!
//! The crate `hdf5-pure` reads them without the C library: contiguous and chunked data,
//! plain or with gzip, shuffle or LZF. Blosc and Zstandard, which DSEC itself uses, need
//! filters it does not have: the error advises to rewrite the file with gzip.

mod dsec;

pub use dsec::{SideColumn, SideGroup, write_dsec};

use super::npy::Column;
use hdf5_pure::{Dataset, File};
use std::path::{Path, PathBuf};

/// The columns of an event table.
#[derive(Debug, Clone, PartialEq)]
pub struct EventColumns {
    /// Time, pixel column, pixel row, polarity; of equal length.
    pub columns: [Column; 4],
    /// Offset to be added to every time (DSEC), µs; 0 where the file states none.
    pub t_offset_us: i64,
}

/// Why a file gives no events, or cannot be written.
#[derive(Debug, thiserror::Error)]
#[error("{path}: {what}", path = path.display())]
pub struct Hdf5Error {
    path: PathBuf,
    what: String,
}

/// Names under which the four columns are kept.
const COLUMN_NAMES: [&[&str]; 4] =
    [&["t", "ts", "timestamp"], &["x", "xs"], &["y", "ys"], &["p", "ps", "polarity"]];

/// Groups in which events are kept.
const GROUP_NAMES: [&str; 5] = ["events", "", "CD/events", "prophesee/left", "davis/left/events"];

/// Reads the event table of an HDF5 file: `t`, `x`, `y`, `p` in a group `events` (or at the root,
/// or in other groups in use), or one table `events` of N x 4.
///
/// # Errors
/// When the file cannot be read, is no HDF5 file, or holds no event table.
pub fn read_events(path: &Path) -> Result<EventColumns, Hdf5Error> {
    let wrong = |what: String| Hdf5Error { path: path.to_owned(), what };
    let unreadable = |e: hdf5_pure::Error| {
        wrong(format!(
            "cannot be read: {e}; if it is compressed with Blosc or Zstandard, rewrite it with gzip (h5repack -f GZIP=4)"
        ))
    };
    let file = File::open_streaming(path).map_err(unreadable)?;
    let t_offset_us = match file.dataset("t_offset") {
        Ok(dataset) => dataset.read_i64().map_err(unreadable)?.first().copied().unwrap_or(0),
        Err(_) => 0,
    };
    for group in GROUP_NAMES {
        let find = |names: &[&str]| {
            let inside = |name: &&str| {
                let separator = if group.is_empty() { "" } else { "/" };
                file.dataset(&format!("{group}{separator}{name}")).ok()
            };
            names.iter().find_map(inside)
        };
        let found: Option<Vec<Dataset>> = COLUMN_NAMES.iter().map(|names| find(names)).collect();
        let Some(found) = found else { continue };
        let read = |dataset: &Dataset| column(dataset).map_err(unreadable);
        let columns = [read(&found[0])?, read(&found[1])?, read(&found[2])?, read(&found[3])?];
        return Ok(EventColumns { columns, t_offset_us });
    }
    if let Ok(table) = file.dataset("events") {
        let shape = table.shape().map_err(unreadable)?;
        if !matches!(shape.as_slice(), [_, 4]) {
            return Err(wrong(format!("`events` has shape {shape:?}; expected N x 4: t, x, y, p")));
        }
        let values = column(&table).map_err(unreadable)?;
        return Ok(EventColumns { columns: split_rows(&values), t_offset_us });
    }
    Err(wrong(
        "holds no event table; expected t, x, y, p in a group `events` or at the root".into(),
    ))
}

fn column(dataset: &Dataset) -> Result<Column, hdf5_pure::Error> {
    Ok(match dataset.read_i64() {
        Ok(values) if !is_float(dataset) => Column::Int(values),
        _ => Column::Float(dataset.read_f64()?),
    })
}

fn is_float(dataset: &Dataset) -> bool {
    dataset
        .dtype()
        .is_ok_and(|dtype| matches!(dtype, hdf5_pure::DType::F32 | hdf5_pure::DType::F64))
}

fn split_rows(values: &Column) -> [Column; 4] {
    std::array::from_fn(|i| match values {
        Column::Int(values) => Column::Int(values.iter().skip(i).step_by(4).copied().collect()),
        Column::Float(values) => Column::Float(values.iter().skip(i).step_by(4).copied().collect()),
    })
}
