//! Tables of numbers as text: one row a line, separated by commas, semicolons, tabs or blanks.
//!
//! Lines that begin with `#`, `%` or `//` are comments. The separator is taken from the first other
//! line, which may be a heading. `True` and `False`, `On` and `Off` count as 1 and 0. In a
//! table with semicolons a comma is a decimal point.

mod cells;

use crate::npy::Column;
use crate::{BLOCK_BYTES, StoredTable};
use cells::{Separator, is_number, parse_row};
use std::fs::File;
use std::io::{BufReader, Read};
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
    /// Lines taken or begun.
    n_lines: u64,
}

/// Reads a table. A last line without its end that is no whole row is left out and stated as
/// damage.
///
/// # Errors
/// When the file cannot be read, or a line is not a row of numbers.
pub fn read_table(path: &Path) -> Result<StoredTable, TextTableError> {
    let io = |source| TextTableError::Io { path: path.to_owned(), source };
    read_rows(path, &mut File::open(path).map_err(io)?, false)
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
        let entry = entry.ok().flatten();
        return read_rows(path, &mut entry.ok_or_else(|| other("is no zip archive".into()))?, true);
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
    let mut entry = archive.by_name(name).map_err(|error| other(error.to_string()))?;
    read_rows(path, &mut entry, false)
}

/// Reads the lines, a block at a time. Where `is_cut`, a failure to read is the end.
fn read_rows(
    path: &Path,
    reader: &mut impl Read,
    is_cut: bool,
) -> Result<StoredTable, TextTableError> {
    let mut rows = Rows::default();
    let mut damage = is_cut.then(|| "the archive is cut".to_owned());
    let mut block = Vec::new();
    let mut is_end = false;
    while !is_end {
        let n_before = block.len();
        match reader.by_ref().take(BLOCK_BYTES as u64).read_to_end(&mut block) {
            Ok(n) => is_end = n == 0,
            Err(_) if is_cut && block.len() > n_before => {}
            Err(_) if is_cut && !rows.columns.is_empty() => {
                block.clear();
                is_end = true;
            }
            Err(source) => return Err(TextTableError::Io { path: path.to_owned(), source }),
        }
        let last = block.iter().rposition(|byte| *byte == b'\n');
        let end = if is_end { block.len() } else { last.map_or(0, |last| last + 1) };
        match rows.take_lines(&block[..end]) {
            Ok(()) => drop(block.drain(..end)),
            // What is left at the end is a line without its end.
            Err(what) if is_end && !rows.columns.is_empty() => {
                damage = Some(format!("the file is cut in line {}: {what}", rows.n_lines));
            }
            Err(what) => {
                let path = path.to_owned();
                return Err(TextTableError::Line { path, line: rows.n_lines, what });
            }
        }
    }
    rows.names.resize(rows.columns.len(), String::new());
    let columns = rows.names.into_iter().zip(rows.columns).collect();
    Ok(StoredTable { columns, notes: rows.notes, t_offset_us: 0, damage })
}

impl Rows {
    /// Takes lines, of which the last may be without its end.
    fn take_lines(&mut self, mut lines: &[u8]) -> Result<(), String> {
        while !lines.is_empty() {
            self.n_lines += 1;
            lines = match self.take_plain(lines) {
                Some(rest) => rest,
                None => {
                    let end = lines.iter().position(|byte| *byte == b'\n');
                    let (line, rest) = lines.split_at(end.map_or(lines.len(), |end| end + 1));
                    self.take(line)?;
                    rest
                }
            };
        }
        Ok(())
    }

    /// Takes a line of plain numbers, as many as there are columns; gives what follows it.
    fn take_plain<'a>(&mut self, lines: &'a [u8]) -> Option<&'a [u8]> {
        let rest = cells::parse_plain_row(lines, self.separator?, &mut self.row)?;
        let is_row = self.row.len() == self.columns.len();
        is_row.then(|| self.push_row())?;
        Some(rest)
    }

    fn push_row(&mut self) {
        for (column, number) in self.columns.iter_mut().zip(&self.row) {
            cells::push(column, *number);
        }
    }

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
            self.columns = vec![Column::default(); n];
        }
        if self.columns.len() != self.row.len() {
            // The first line of some files is the width and height of the sensor.
            if self.columns.len() == 2 && self.columns[0].len() == 1 && self.names.is_empty() {
                self.note_sensor();
                self.columns = vec![Column::default(); self.row.len()];
            } else {
                return Err(format!(
                    "expected {} numbers, found {} in `{}`",
                    self.columns.len(),
                    self.row.len(),
                    cells::shorten(line)
                ));
            }
        }
        self.push_row();
        Ok(())
    }

    fn note_sensor(&mut self) {
        let [width, height] = [0, 1].map(|i| self.columns[i].get(0) as i64);
        self.notes.push(format!("sensor size {width} x {height}"));
    }
}

#[cfg(test)]
mod tests;
