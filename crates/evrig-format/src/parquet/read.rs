//! Reading: the numeric columns of a table, whatever program wrote it.

use super::TableError;
use crate::StoredTable;
use crate::npy::Column;
use parquet::basic::{ConvertedType, LogicalType, TimeUnit};
use parquet::column::reader::{ColumnReader, ColumnReaderImpl};
use parquet::data_type::DataType;
use parquet::errors::ParquetError;
use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::schema::types::ColumnDescriptor;
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// Rows read at once.
const ROWS_PER_BATCH: usize = 1 << 16;

/// Reads the columns of numbers of a table; columns of text, lists and structures are left out.
///
/// # Errors
/// When the file cannot be read or a column has empty cells.
pub fn read_table(path: &Path) -> Result<StoredTable, TableError> {
    let file =
        File::open(path).map_err(|source| TableError::Io { path: path.to_owned(), source })?;
    read(file).map_err(|source| TableError::Read { path: path.to_owned(), source })
}

fn read(file: File) -> Result<StoredTable, ParquetError> {
    let begins_as_parquet = {
        let mut magic = [0; 4];
        (&file).read_exact(&mut magic).is_ok() && magic == *b"PAR1"
    };
    let reader = SerializedFileReader::new(file).map_err(|error| match begins_as_parquet {
        true => ParquetError::General(format!(
            "the file is cut or damaged, and Parquet's index is at its end; copy or write it again \
             ({error})"
        )),
        false => error,
    })?;
    let metadata = reader.metadata();
    let schema = metadata.file_metadata().schema_descr_ptr();
    let mut notes = Vec::new();
    // The table of `evrig export`.
    let pairs = metadata.file_metadata().key_value_metadata();
    if pairs.is_some_and(|pairs| pairs.iter().any(|pair| pair.key == "evrig")) {
        notes.push("# exported by evrig, time in us".to_owned());
    }
    let mut columns = Vec::new();
    let described = schema.columns().iter().enumerate();
    for (i, column) in described.filter(|(_, column)| is_of_numbers(column)) {
        let mut values = Column::default();
        notes.extend(stated_unit(column));
        for group in 0..reader.num_row_groups() {
            let group = reader.get_row_group(group)?;
            append(group.get_column_reader(i)?, column, &mut values)?;
        }
        columns.push((column.name().to_owned(), values));
    }
    Ok(StoredTable { columns, notes, ..StoredTable::default() })
}

/// A note of the unit that a column of times states.
fn stated_unit(column: &ColumnDescriptor) -> Option<String> {
    let unit = match column.logical_type_ref() {
        Some(LogicalType::Timestamp(stamp)) => match stamp.unit {
            TimeUnit::MILLIS => "ms",
            TimeUnit::MICROS => "us",
            TimeUnit::NANOS => "ns",
        },
        _ => return None,
    };
    Some(format!("# time in {unit} (type of column {})", column.name()))
}

/// Whether the cells are numbers, one a row.
fn is_of_numbers(column: &ColumnDescriptor) -> bool {
    use parquet::basic::Type;
    let is_number = matches!(
        column.physical_type(),
        Type::BOOLEAN | Type::INT32 | Type::INT64 | Type::FLOAT | Type::DOUBLE
    );
    is_number && column.max_rep_level() == 0
}

fn append(
    reader: ColumnReader,
    column: &ColumnDescriptor,
    values: &mut Column,
) -> Result<(), ParquetError> {
    let is_u32 = column.converted_type() == ConvertedType::UINT_32;
    let whole = |value: i32| if is_u32 { i64::from(value as u32) } else { value.into() };
    match reader {
        ColumnReader::BoolColumnReader(reader) => each_batch(reader, column, |batch| {
            values.extend_integers(batch.iter().map(|value| (*value).into()));
        }),
        ColumnReader::Int32ColumnReader(reader) => each_batch(reader, column, |batch| {
            values.extend_integers(batch.iter().map(|value| whole(*value)));
        }),
        ColumnReader::Int64ColumnReader(reader) => {
            each_batch(reader, column, |batch| values.extend_integers(batch.iter().copied()))
        }
        ColumnReader::FloatColumnReader(reader) => each_batch(reader, column, |batch| {
            values.extend_floats(batch.iter().map(|value| (*value).into()));
        }),
        ColumnReader::DoubleColumnReader(reader) => {
            each_batch(reader, column, |batch| values.extend_floats(batch.iter().copied()))
        }
        _ => Ok(()),
    }
}

fn each_batch<T: DataType>(
    mut reader: ColumnReaderImpl<T>,
    column: &ColumnDescriptor,
    mut take: impl FnMut(&[T::T]),
) -> Result<(), ParquetError> {
    let mut values = Vec::new();
    let mut levels = Vec::new();
    let is_optional = column.max_def_level() > 0;
    loop {
        values.clear();
        levels.clear();
        let levels = is_optional.then_some(&mut levels);
        let (n_rows, n_values, _) =
            reader.read_records(ROWS_PER_BATCH, levels, None, &mut values)?;
        if n_rows > n_values {
            let what = format!("column `{}` has {} empty cells", column.name(), n_rows - n_values);
            return Err(ParquetError::General(what));
        }
        if n_rows == 0 {
            return Ok(());
        }
        take(&values);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use evrig_core::event::{Event, Events};

    #[test]
    fn of_a_cut_file_it_is_said_why_nothing_can_be_read() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.parquet");
        let events: Events = (0..100).map(|t| Event { t, x: 1, y: 2, on: true }).collect();
        crate::parquet::write_events(&path, events.as_slice(), &[]).unwrap();
        assert_eq!(read_table(&path).unwrap().n_rows(), 100);
        let bytes = std::fs::read(&path).unwrap();
        std::fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
        let error = read_table(&path).unwrap_err().to_string();
        assert!(error.contains("the file is cut or damaged") && error.contains("again"), "{error}");
    }
}
