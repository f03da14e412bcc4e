//! Archives of arrays: a zip of npy files.

use super::{Array, ArrayReader, NpyError};
use crate::StoredTable;
use std::fs::File;
use std::io::{BufReader, Cursor, Read};
use std::path::{Path, PathBuf};
use zip::ZipArchive;

/// An open npz archive.
pub struct Npz {
    path: PathBuf,
    source: NpzSource,
}

enum NpzSource {
    Whole(ZipArchive<BufReader<File>>),
    /// The names and bytes before the cut of an archive whose directory, at its end, is missing.
    Cut(Vec<(String, Vec<u8>)>),
}

impl Npz {
    /// Opens an npz archive. Of one that is cut, the arrays before the cut are read into memory.
    ///
    /// # Errors
    /// When the file cannot be read or is not a zip archive.
    pub fn open(path: &Path) -> Result<Self, NpyError> {
        let open = || File::open(path).map_err(|source| NpyError::io(path, source));
        let source = match ZipArchive::new(BufReader::new(open()?)) {
            Ok(archive) => NpzSource::Whole(archive),
            Err(error) => {
                let members = members_before_cut(BufReader::new(open()?));
                if members.is_empty() {
                    return Err(NpyError::format(path, format!("not an npz archive: {error}")));
                }
                NpzSource::Cut(members)
            }
        };
        Ok(Self { path: path.to_owned(), source })
    }

    /// Whether the archive ends before its directory.
    #[must_use]
    pub fn is_cut(&self) -> bool {
        matches!(self.source, NpzSource::Cut(_))
    }

    /// Names of the arrays, without the ending `.npy`.
    #[must_use]
    pub fn names(&self) -> Vec<String> {
        let without_ending = |name: &str| name.strip_suffix(".npy").unwrap_or(name).to_owned();
        match &self.source {
            NpzSource::Whole(archive) => {
                archive.file_names().flatten().map(|name| without_ending(&name)).collect()
            }
            NpzSource::Cut(members) => {
                members.iter().map(|(name, _)| without_ending(name)).collect()
            }
        }
    }

    /// Opens one array.
    ///
    /// # Errors
    /// When there is no such array, or it is not an array of numbers.
    pub fn open_array(&mut self, name: &str) -> Result<ArrayReader<Box<dyn Read + '_>>, NpyError> {
        let inside = PathBuf::from(format!("{}[{name}]", self.path.display()));
        let file = format!("{name}.npy");
        let reader: Box<dyn Read> = match &mut self.source {
            NpzSource::Whole(archive) => match archive.by_name(&file) {
                Ok(entry) => Box::new(BufReader::new(entry)),
                Err(error) => return Err(NpyError::format(&inside, error.to_string())),
            },
            NpzSource::Cut(members) => match members.iter().find(|(name, _)| *name == file) {
                Some((_, bytes)) => Box::new(Cursor::new(bytes)),
                None => return Err(NpyError::format(&inside, "is not before the archive's cut")),
            },
        };
        ArrayReader::new(inside, reader)
    }

    /// Reads one array whole.
    ///
    /// # Errors
    /// When there is no such array, it is not an array of numbers, or it is cut.
    pub fn array(&mut self, name: &str) -> Result<Array, NpyError> {
        self.open_array(name)?.read_all()
    }

    /// Reads arrays as the columns of one table. Rows that are not before the cut of an archive in
    /// all columns are stated as damage.
    ///
    /// # Errors
    /// When an array is missing or is not one of plain numbers.
    pub fn columns(&mut self, names: &[String]) -> Result<StoredTable, NpyError> {
        let is_cut = self.is_cut();
        let (mut columns, mut n_rows) = (Vec::new(), 0);
        for name in names {
            let array = self.open_array(name)?;
            let (column, n) = array.read_column(is_cut)?;
            n_rows = n_rows.max(n);
            columns.push((name.clone(), column));
        }
        if !is_cut {
            return Ok(StoredTable::of_columns(columns));
        }
        let n_whole = columns.iter().map(|(_, column)| column.len()).min().unwrap_or(0);
        columns.iter_mut().for_each(|(_, column)| column.truncate(n_whole));
        let n_missing = n_rows - n_whole as u64;
        let damage = format!("the file is cut: {n_missing} of {n_rows} rows are missing");
        Ok(StoredTable { damage: Some(damage), ..StoredTable::of_columns(columns) })
    }
}

/// Names and bytes of the files in a zip stream, by the header before each file; the last may be
/// shorter than it was.
fn members_before_cut(mut stream: impl Read) -> Vec<(String, Vec<u8>)> {
    let mut members = Vec::new();
    while let Ok(Some(mut entry)) = zip::read::read_zipfile_from_stream(&mut stream) {
        let Ok(name) = entry.name().map(|name| name.into_owned()) else { break };
        let mut bytes = Vec::new();
        let is_whole = entry.read_to_end(&mut bytes).is_ok();
        members.push((name, bytes));
        if !is_whole {
            break;
        }
    }
    members
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::npy::{Column, NpzWriter};

    #[test]
    fn an_archive_cut_anywhere_gives_the_rows_before_the_cut() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.npz");
        let mut npz = NpzWriter::create(&path).unwrap();
        npz.add("t", &[100], (0..100).map(|i| 1_000_i64 * i)).unwrap();
        npz.add("x", &[100], 0..100_i64).unwrap();
        npz.finish().unwrap();
        let whole = std::fs::read(&path).unwrap();
        let names = ["t", "x"].map(str::to_owned);
        let mut lengths = Vec::new();
        for n_bytes in 0..whole.len() {
            std::fs::write(&path, &whole[..n_bytes]).unwrap();
            let Ok(mut npz) = Npz::open(&path) else { continue };
            assert!(npz.is_cut());
            let Ok(table) = npz.columns(&names) else { continue };
            let n = table.n_rows();
            let damage = format!("the file is cut: {} of 100 rows are missing", 100 - n);
            assert_eq!(table.damage.as_deref(), Some(&*damage));
            if n > 0 {
                assert_eq!(table.columns[1].1, Column::Short((0..n as i16).collect()));
            }
            lengths.push(n);
        }
        assert!(lengths.is_sorted() && lengths.contains(&50), "{lengths:?}");
        assert_eq!(lengths.last(), Some(&100), "a directory alone is no loss of rows");
    }
}
