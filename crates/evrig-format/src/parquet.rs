//! Event tables as Parquet, which pandas, polars, DuckDB and Hugging Face's datasets read.
//!
//! Columns `t` (int64, microseconds), `x` and `y` (uint16), `p` (uint8, 1 for On), all required,
//! compressed with Zstandard, sorted by `t`; the key-value metadata describe them.

mod read;

pub use read::read_table;

use evrig_core::event::EventSlice;
use parquet::basic::{Compression, Encoding, ZstdLevel};
use parquet::data_type::{DataType, Int32Type, Int64Type};
use parquet::errors::ParquetError;
use parquet::file::metadata::{KeyValue, SortingColumn};
use parquet::file::properties::WriterProperties;
use parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};
use parquet::schema::parser::parse_message_type;
use parquet::schema::types::ColumnPath;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Events per row group, which a reader holds in memory.
const EVENTS_PER_ROW_GROUP: usize = 1 << 20;

const SCHEMA: &str = "message events {
    REQUIRED INT64 t;
    REQUIRED INT32 x (INTEGER(16, false));
    REQUIRED INT32 y (INTEGER(16, false));
    REQUIRED INT32 p (INTEGER(8, false));
}";

/// Why a table cannot be written or read.
#[derive(Debug, thiserror::Error)]
pub enum TableError {
    /// The file cannot be made.
    #[error("{path}: {source}", path = path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// Reading failed.
    #[error("{path}: cannot be read as Parquet: {source}", path = path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The reason.
        source: ParquetError,
    },
    /// Writing failed.
    #[error("{path}: cannot be written: {source}", path = path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// The reason.
        source: ParquetError,
    },
}

/// Writes events with key-value metadata.
///
/// # Errors
/// When writing fails.
pub fn write_events(
    path: &Path,
    events: EventSlice<'_>,
    metadata: &[(&str, String)],
) -> Result<(), TableError> {
    let file =
        File::create(path).map_err(|source| TableError::Io { path: path.to_owned(), source })?;
    write(file, events, metadata)
        .map_err(|source| TableError::Write { path: path.to_owned(), source })
}

fn write(
    file: File,
    events: EventSlice<'_>,
    metadata: &[(&str, String)],
) -> Result<(), ParquetError> {
    let pairs = metadata.iter().map(|(key, text)| KeyValue::new((*key).to_owned(), text.clone()));
    let time = ColumnPath::from("t");
    let properties = WriterProperties::builder()
        .set_compression(Compression::ZSTD(ZstdLevel::try_new(3)?))
        // Neighbours in time differ by little: a dictionary of times would hold each of them.
        .set_column_dictionary_enabled(time.clone(), false)
        .set_column_encoding(time, Encoding::DELTA_BINARY_PACKED)
        .set_created_by(concat!("evrig ", env!("CARGO_PKG_VERSION")).to_owned())
        .set_sorting_columns(Some(vec![SortingColumn {
            column_idx: 0,
            descending: false,
            nulls_first: false,
        }]))
        .set_key_value_metadata(Some(pairs.collect()))
        .build();
    let schema = Arc::new(parse_message_type(SCHEMA)?);
    let mut writer = SerializedFileWriter::new(file, schema, Arc::new(properties))?;
    for start in (0..events.len()).step_by(EVENTS_PER_ROW_GROUP) {
        let part = events.range(start, (start + EVENTS_PER_ROW_GROUP).min(events.len()));
        let mut group = writer.next_row_group()?;
        column::<Int64Type>(&mut group, part.t)?;
        let wide = |column: &[u16]| column.iter().map(|&v| i32::from(v)).collect::<Vec<_>>();
        column::<Int32Type>(&mut group, &wide(part.x))?;
        column::<Int32Type>(&mut group, &wide(part.y))?;
        let p: Vec<i32> = part.on.iter().map(|&on| i32::from(on)).collect();
        column::<Int32Type>(&mut group, &p)?;
        group.close()?;
    }
    writer.close()?;
    Ok(())
}

fn column<T: DataType>(
    group: &mut SerializedRowGroupWriter<'_, File>,
    values: &[T::T],
) -> Result<(), ParquetError> {
    let next = group.next_column()?;
    let mut writer =
        next.ok_or_else(|| ParquetError::General("a column too many was written".into()))?;
    writer.typed::<T>().write_batch(values, None, None)?;
    writer.close()
}
