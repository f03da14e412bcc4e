//! Tables of every container as columns.

use crate::SessionError;
use evrig_format::npy::{ArrayReader, Npz};
use evrig_format::{StoredTable, hdf5, parquet, text};
use std::path::Path;

/// Reads the columns of a file, by its ending.
pub(super) fn read(path: &Path, table: Option<&str>) -> Result<StoredTable, SessionError> {
    let ending = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    Ok(match ending.as_str() {
        "npy" => ArrayReader::open_cut(path)?.read_table()?,
        "npz" => of_npz(path, table)?,
        "h5" | "hdf5" | "hdf" => hdf5::read_events(path, table)?,
        "parquet" => parquet::read_table(path)
            .map_err(|error| SessionError::Import { path: path.to_owned(), what: plain(&error) })?,
        "zip" => text::read_zipped_table(path).map_err(|error| of_text(path, error))?,
        _ => text::read_table(path).map_err(|error| of_text(path, error))?,
    })
}

/// A message without the path, which the session's error adds.
fn plain(error: &parquet::TableError) -> String {
    match error {
        parquet::TableError::Io { source, .. } => source.to_string(),
        parquet::TableError::Read { source, .. } | parquet::TableError::Write { source, .. } => {
            format!("cannot be read as Parquet: {source}")
        }
    }
}

fn of_text(path: &Path, error: text::TextTableError) -> SessionError {
    let what = match error {
        text::TextTableError::Io { source, .. } => source.to_string(),
        text::TextTableError::Line { line, what, .. } => format!("line {line}: {what}"),
    };
    SessionError::import(path, what)
}

fn of_npz(path: &Path, table: Option<&str>) -> Result<StoredTable, SessionError> {
    let wrong = |what: String| SessionError::import(path, what);
    let mut npz = Npz::open(path)?;
    let names = npz.names();
    if let Some(name) = table {
        return Ok(npz.open_array(name)?.read_table()?);
    }
    // Arrays of one column each.
    let columns: Vec<String> = names.iter().filter(|name| is_column(name)).cloned().collect();
    if columns.len() >= 4 {
        return Ok(npz.columns(&columns)?);
    }
    let known = ["events", "event_data", "arr_0"];
    let found = known.into_iter().find(|name| names.iter().any(|n| n == name));
    // The column before an archive's cut is no table.
    let is_table = |name: &&String| names.len() == 1 && !(npz.is_cut() && is_column(name));
    let only = names.first().filter(is_table).map(String::as_str);
    let Some(name) = found.or(only) else {
        let cut = if npz.is_cut() { "is cut, copy or write it again; it " } else { "" };
        return Err(wrong(format!(
            "{cut}holds {names:?}; expected arrays t, x, y, p, or one array `events` of shape (N, 4); \
             another one is chosen with --table"
        )));
    };
    let mut read = npz.open_array(name)?.read_table()?;
    // Arrays that only `evrig export` writes beside its events, which are in us.
    if names.iter().any(|name| name.ends_with("_first_event")) {
        read.notes.push("# exported by evrig, time in us".into());
    }
    Ok(read)
}

/// Whether an array's name is that of a column: `t`, `timestamps_us`, `x`, `polarity`.
fn is_column(name: &str) -> bool {
    let lower = name.to_lowercase();
    let first = lower.split(|c: char| !c.is_alphanumeric()).next().unwrap_or("");
    let known = [
        "t",
        "ts",
        "time",
        "times",
        "timestamp",
        "timestamps",
        "x",
        "xs",
        "y",
        "ys",
        "p",
        "ps",
        "pol",
        "polarity",
        "polarities",
        "on",
    ];
    known.contains(&first) && !lower.ends_with("offset")
}
