//! NumPy's npy arrays and npz archives.
//!
//! The crate `npyz` parses and writes headers; the elements are decoded here, because
//! people store events in any integer or float type, either byte order, and as
//! structured arrays, and frames are read one at a time from arrays larger than memory.

mod read;
mod write;

pub use read::{Array, ArrayReader, Column, Npz};
pub use write::{ArrayWriter, Element, NpzWriter};

use std::path::PathBuf;

/// What can be wrong with an npy or npz file.
#[derive(Debug, thiserror::Error)]
pub enum NpyError {
    /// The file cannot be read or written.
    #[error("{path}: {source}", path = path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// It is not what its name says.
    #[error("{path}: {what}", path = path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// What is wrong and what to do.
        what: String,
    },
}

impl NpyError {
    fn format(path: &std::path::Path, what: impl Into<String>) -> Self {
        Self::Format { path: path.to_owned(), what: what.into() }
    }

    fn io(path: &std::path::Path, source: std::io::Error) -> Self {
        // npyz reports a malformed header as invalid data; that is the format's fault, not the disk's.
        match source.kind() {
            std::io::ErrorKind::InvalidData => {
                Self::format(path, format!("not an npy array: {source}"))
            }
            std::io::ErrorKind::UnexpectedEof => Self::format(
                path,
                "the file ends before the data its header announces; copy or write it again",
            ),
            _ => Self::Io { path: path.to_owned(), source },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_reads_back_in_every_element_type() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.npz");
        let mut npz = NpzWriter::create(&path).unwrap();
        npz.add("t", &[3], [-1_i64, 0, 1_700_000_000_000_000]).unwrap();
        npz.add("grid", &[2, 2], [0.5_f32, -1.5, 2.0, 1e9]).unwrap();
        npz.add("on", &[2], [true, false]).unwrap();
        npz.finish().unwrap();
        let mut npz = Npz::open(&path).unwrap();
        assert_eq!(npz.names(), ["t", "grid", "on"]);
        let t = npz.array("t").unwrap();
        assert_eq!(t.fields[0].1, Column::Int(vec![-1, 0, 1_700_000_000_000_000]));
        let grid = npz.array("grid").unwrap();
        assert_eq!(grid.shape, [2, 2]);
        assert_eq!(grid.fields[0].1, Column::Float(vec![0.5, -1.5, 2.0, 1e9]));
        assert_eq!(npz.array("on").unwrap().fields[0].1, Column::Int(vec![1, 0]));
    }

    #[test]
    fn frames_are_read_one_by_one() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("frames.npy");
        let mut writer = ArrayWriter::<u16>::create(&path, &[2, 1, 2]).unwrap();
        writer.extend(&[1, 2]).unwrap();
        writer.extend(&[3, 65_535]).unwrap();
        writer.finish().unwrap();
        let mut reader = ArrayReader::open(&path).unwrap();
        assert_eq!(reader.shape(), [2, 1, 2]);
        assert_eq!(reader.unsigned_bytes(), Some(2));
        assert_eq!(reader.next_u16(2).unwrap(), [1, 2]);
        assert_eq!(reader.next_u16(2).unwrap(), [3, 65_535]);
        assert!(reader.next_u16(1).is_err());
    }

    #[test]
    fn a_header_that_promises_more_than_the_file_holds_is_named_and_not_believed() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("cut.npy");
        let mut writer = ArrayWriter::<i64>::create(&path, &[4]).unwrap();
        writer.extend(&[1, 2, 3, 4]).unwrap();
        writer.finish().unwrap();
        let text = std::fs::read(&path).unwrap();
        let text = String::from_utf8_lossy(&text[..]).replace("(4,)", "(9999999999,)");
        std::fs::write(&path, text.as_bytes()).unwrap();
        let error = match ArrayReader::open(&path) {
            Ok(reader) => reader.read_all().unwrap_err(),
            Err(error) => error,
        };
        assert!(error.to_string().contains("cut.npy"), "{error}");
    }

    #[test]
    fn what_is_no_array_is_told_so() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("text.npy");
        std::fs::write(&path, "hello, I am a text file, not an array").unwrap();
        let error = ArrayReader::open(&path).err().unwrap().to_string();
        assert!(error.contains("not an npy array"), "{error}");
        assert!(Npz::open(&path).err().unwrap().to_string().contains("not an npz archive"));
    }
}
