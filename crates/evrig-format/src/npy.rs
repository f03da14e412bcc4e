//! NumPy's npy arrays and npz archives.
//!
//! The crate `npyz` parses and writes headers; the elements are decoded here, because
//! people store events in any integer or float type, either byte order, and as
//! structured arrays, and frames are read one at a time from arrays larger than memory.

mod header;
mod npz;
mod read;
mod write;

pub use crate::column::Column;
pub use npz::Npz;
pub use read::{Array, ArrayReader};
pub use write::{ArrayWriter, Element, NpzWriter};

use std::path::PathBuf;

/// Errors of npy and npz files.
#[derive(Debug, thiserror::Error)]
pub enum NpyError {
    /// The file cannot be read or written.
    #[error("{path}: {source}", path = path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// The content is not of the expected format.
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
        // npyz reports a malformed header as invalid data; that is the format's fault, not the
        // disk's.
        match source.kind() {
            std::io::ErrorKind::InvalidData => {
                // npyz draws the line that it could not read below its message, however long it is.
                let what = source.to_string();
                Self::format(
                    path,
                    format!("not an npy array: {}", what.lines().next().unwrap_or("")),
                )
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
        let shape = "'fortran_order': False, 'shape': (9999999999,), }\n";
        header_only(&path, &format!("{{'descr': '<i8', {shape}"));
        let error = refusal(&path);
        assert!(error.contains("cut.npy: the file ends before the data"), "{error}");
    }

    #[test]
    fn a_cut_table_gives_its_whole_rows() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("rows.npy");
        let mut writer = ArrayWriter::<i64>::create(&path, &[30, 4]).unwrap();
        (0..30_i64).for_each(|i| writer.extend(&[70_000 * i, i, 2 * i, i % 2]).unwrap());
        writer.finish().unwrap();
        let read = || ArrayReader::open_cut(&path).and_then(ArrayReader::read_table).unwrap();
        let whole = read();
        assert_eq!((whole.columns.len(), whole.n_rows(), whole.damage), (4, 30, None));
        assert_eq!(whole.columns[0].1, Column::Int((0..30).map(|i| 70_000 * i).collect()));
        assert_eq!(whole.columns[2].1, Column::Short((0..30).map(|i| 2 * i).collect()));
        let bytes = std::fs::read(&path).unwrap();
        std::fs::write(&path, &bytes[..bytes.len() - 33]).unwrap();
        assert!(ArrayReader::open(&path).is_err());
        let cut = read();
        assert_eq!(cut.columns[2].1, Column::Short((0..28).map(|i| 2 * i).collect()));
        assert_eq!(cut.damage.unwrap(), "the file is cut: 2 of 30 rows are missing");
    }

    fn refusal(path: &std::path::Path) -> String {
        ArrayReader::open(path).err().unwrap().to_string()
    }

    /// An npy file of this header and no data.
    fn header_only(path: &std::path::Path, header: &str) {
        let mut bytes = b"\x93NUMPY\x02\0".to_vec();
        bytes.extend((header.len() as u32).to_le_bytes());
        bytes.extend(header.bytes());
        std::fs::write(path, bytes).unwrap();
    }

    #[test]
    fn elements_of_nothing_are_refused_and_a_mad_header_is_told_in_a_line() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("none.npy");
        let shape = "'fortran_order': False, 'shape': (1000000000000000000,), }\n";
        header_only(&path, &format!("{{'descr': [], {shape}"));
        let error = refusal(&path);
        assert!(error.contains("no fields"), "{error}");
        header_only(&path, &format!("{{'descr': {}, {shape}", "'".repeat(3_000)));
        let error = refusal(&path);
        assert!(error.contains("not an npy array") && error.len() < 400, "{error}");
        let shape = "'fortran_order': False, 'shape': (9999999999, 9999999999), }\n";
        header_only(&path, &format!("{{'descr': '<i8', {shape}"));
        let error = refusal(&path);
        assert!(error.contains("more elements than can be counted"), "{error}");
        std::fs::write(&path, b"\x93NUMPY\x02\0\xff\xff\xff\xff{").unwrap();
        let error = refusal(&path);
        assert!(error.contains("4294967295 bytes"), "{error}");
        // A parser that tries every way to read a bracket would not come to an end.
        header_only(&path, &format!("{{'descr': {}, {shape}", "[".repeat(60)));
        let error = refusal(&path);
        assert!(error.contains("brackets in brackets"), "{error}");
    }

    #[test]
    fn what_is_no_array_is_told_so() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("text.npy");
        std::fs::write(&path, "hello, I am a text file, not an array").unwrap();
        let error = refusal(&path);
        assert!(error.contains("not an npy array"), "{error}");
        assert!(Npz::open(&path).err().unwrap().to_string().contains("not an npz archive"));
    }
}
