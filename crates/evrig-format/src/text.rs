//! Tables of numbers as text: one row a line, separated by commas, semicolons, tabs or blanks.
//!
//! Lines that begin with `#`, `%` or `//` are comments. The separator is taken from the first other
//! line, which may be a heading. `True` and `False`, `On` and `Off` count as 1 and 0. In a
//! table with semicolons a comma is a decimal point.

mod cells;

use crate::StoredTable;
use crate::npy::Column;
use cells::{Separator, is_number, parse_row};
use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};

/// Comments kept; those of a file's head describe its columns.
const MAX_NOTES: usize = 64;

/// Why a text file is no table.
#[derive(Debug, thiserror::Error)]
pub enum TextTableError {
    /// The file cannot be read.
    #[error("{path}: {source}", path = path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// A line is not a row of numbers.
    #[error("{path}: line {line}: {what}", path = path.display())]
    Line {
        /// The file.
        path: PathBuf,
        /// The line, from 1.
        line: u64,
        /// What was expected and found.
        what: String,
    },
}

/// Rows read so far.
#[derive(Default)]
struct Rows {
    names: Vec<String>,
    notes: Vec<String>,
    columns: Vec<Column>,
    separator: Option<Separator>,
    row: Vec<cells::Number>,
}

/// Reads a table. A last line without its end that is no whole row is left out and stated as
/// damage.
///
/// # Errors
/// When the file cannot be read, or a line is not a row of numbers.
pub fn read_table(path: &Path) -> Result<StoredTable, TextTableError> {
    let io = |source| TextTableError::Io { path: path.to_owned(), source };
    let mut reader = BufReader::with_capacity(1 << 20, File::open(path).map_err(io)?);
    read_rows(path, &mut reader, false)
}

/// Reads the table in a zip archive of one text, as rpg_e2vid reads its events. What an archive that
/// was cut still holds is read up to the cut.
///
/// # Errors
/// When the file cannot be read, holds no text or several, or a line is not a row of numbers.
pub fn read_zipped_table(path: &Path) -> Result<StoredTable, TextTableError> {
    let io = |source| TextTableError::Io { path: path.to_owned(), source };
    let other = |what: String| io(std::io::Error::other(what));
    let file = File::open(path).map_err(io)?;
    let Ok(mut archive) = zip::ZipArchive::new(BufReader::new(file)) else {
        let mut file = BufReader::new(File::open(path).map_err(io)?);
        let entry = zip::read::read_zipfile_from_stream(&mut file);
        let entry = entry.ok().flatten().ok_or_else(|| other("is no zip archive".into()))?;
        return read_rows(path, &mut BufReader::with_capacity(1 << 20, entry), true);
    };
    let is_text = |name: &String| name.ends_with(".txt") || name.ends_with(".csv");
    let names = archive.file_names().filter_map(Result::ok).map(|name| name.into_owned());
    let names: Vec<String> = names.filter(is_text).collect();
    let [name] = names.as_slice() else {
        let found = if names.is_empty() { "none".to_owned() } else { names.join(", ") };
        return Err(other(format!(
            "holds the texts: {found}; expected one .txt or .csv: unpack it and import the text"
        )));
    };
    let entry = archive.by_name(name).map_err(|error| other(error.to_string()))?;
    read_rows(path, &mut BufReader::with_capacity(1 << 20, entry), false)
}

/// Reads the lines. Where `is_cut`, a failure to read is the end.
fn read_rows(
    path: &Path,
    reader: &mut impl BufRead,
    is_cut: bool,
) -> Result<StoredTable, TextTableError> {
    let io = |source| TextTableError::Io { path: path.to_owned(), source };
    let mut rows = Rows::default();
    let mut damage = is_cut.then(|| "the archive is cut".to_owned());
    let mut line = Vec::new();
    for number in 1_u64.. {
        line.clear();
        match reader.read_until(b'\n', &mut line) {
            Ok(0) => break,
            Ok(_) => {}
            Err(_) if is_cut && !rows.columns.is_empty() => break,
            Err(error) => return Err(io(error)),
        }
        let is_whole = line.ends_with(b"\n");
        match rows.take(&line) {
            Ok(()) => {}
            Err(what) if !is_whole && !rows.columns.is_empty() => {
                damage = Some(format!("the file is cut in line {number}: {what}"));
            }
            Err(what) => {
                return Err(TextTableError::Line { path: path.to_owned(), line: number, what });
            }
        }
    }
    rows.names.resize(rows.columns.len(), String::new());
    let columns = rows.names.into_iter().zip(rows.columns).collect();
    Ok(StoredTable { columns, notes: rows.notes, t_offset_us: 0, damage })
}

impl Rows {
    fn take(&mut self, line: &[u8]) -> Result<(), String> {
        let line = line.strip_prefix(b"\xef\xbb\xbf").unwrap_or(line).trim_ascii();
        if line.is_empty() {
            return Ok(());
        }
        let is_comment = [&b"#"[..], b"%", b"//"].iter().any(|mark| line.starts_with(mark));
        if is_comment {
            if self.notes.len() < MAX_NOTES {
                self.notes.push(String::from_utf8_lossy(line).into_owned());
            }
            return Ok(());
        }
        if self.columns.is_empty() && self.names.is_empty() {
            let separator = Separator::of(line);
            self.separator = Some(separator);
            let cells: Vec<&[u8]> = separator.split(line).collect();
            if !cells.iter().all(|cell| cell.is_empty() || is_number(cell, separator)) {
                self.names = cells.iter().map(|cell| cells::text(cell)).collect();
                return Ok(());
            }
        }
        let Some(separator) = self.separator else { return Ok(()) };
        parse_row(line, separator, &mut self.row)?;
        let expected = if self.names.is_empty() { self.columns.len() } else { self.names.len() };
        if self.columns.is_empty() {
            let n = if expected == 0 { self.row.len() } else { expected };
            self.columns = vec![Column::Int(Vec::new()); n];
        }
        if self.columns.len() != self.row.len() {
            // The first line of some files is the width and height of the sensor.
            if self.columns.len() == 2 && self.columns[0].len() == 1 && self.names.is_empty() {
                self.note_sensor();
                self.columns = vec![Column::Int(Vec::new()); self.row.len()];
            } else {
                return Err(format!(
                    "expected {} numbers, found {} in `{}`",
                    self.columns.len(),
                    self.row.len(),
                    cells::shorten(line)
                ));
            }
        }
        for (column, number) in self.columns.iter_mut().zip(&self.row) {
            cells::push(column, *number);
        }
        Ok(())
    }

    fn note_sensor(&mut self) {
        let first = |column: &Column| match column {
            Column::Int(values) => values.first().copied().unwrap_or(0),
            Column::Float(values) => values.first().map_or(0, |value| *value as i64),
        };
        let [width, height] = [first(&self.columns[0]), first(&self.columns[1])];
        self.notes.push(format!("sensor size {width} x {height}"));
    }
}

#[cfg(test)]
mod tests;
