//! Reading: any numeric element type becomes `i64` or `f64` columns, or raw rows.

use super::NpyError;
use super::header::read_header;
use crate::column::{Column, NumberCell, NumberKind};
use crate::{BLOCK_BYTES, StoredTable};
use npyz::{DType, Endianness, Order, TypeChar, TypeStr};
use std::fs::File;
use std::io::{BufReader, Read, Seek};
use std::path::{Path, PathBuf};

/// An array read whole: its shape and one column a field (one column without a name for plain
/// arrays).
#[derive(Debug, Clone, PartialEq)]
pub struct Array {
    /// Length along each axis.
    pub shape: Vec<u64>,
    /// Field name (empty for plain arrays) and values in C order.
    pub fields: Vec<(String, Column)>,
}

/// A field of an element; none of its cells is padding.
#[derive(Debug, Clone)]
struct Field {
    name: String,
    cell: NumberCell,
}

/// What an element consists of.
struct ArrayElement {
    fields: Vec<Field>,
    /// With the padding of aligned records.
    n_bytes: usize,
}

/// An open array whose elements are read in order, as many at a time as the caller wants.
pub struct ArrayReader<R> {
    path: PathBuf,
    shape: Vec<u64>,
    element: ArrayElement,
    reader: R,
}

impl ArrayReader<BufReader<File>> {
    /// Opens an npy file and reads its header.
    ///
    /// # Errors
    /// When the file cannot be read, is not an npy array of numbers in C order, or ends before the
    /// data that its header announces.
    pub fn open(path: &Path) -> Result<Self, NpyError> {
        let io = |source| NpyError::io(path, source);
        let mut array = Self::open_cut(path)?;
        let about = array.reader.get_ref().metadata().map_err(io)?;
        // A pipe has no length; a file's length is checked against the announced data.
        if about.is_file() {
            let header = array.reader.stream_position().map_err(io)?;
            let announced = array.n_elements().checked_mul(array.element.n_bytes as u64);
            if announced.is_none_or(|n| n > about.len().saturating_sub(header)) {
                return Err(io(std::io::ErrorKind::UnexpectedEof.into()));
            }
        }
        Ok(array)
    }

    /// Opens an npy file that may end before the data that its header announces.
    ///
    /// # Errors
    /// When the file cannot be read, or is not an npy array of numbers in C order.
    pub fn open_cut(path: &Path) -> Result<Self, NpyError> {
        let file = File::open(path).map_err(|source| NpyError::io(path, source))?;
        Self::new(path.to_owned(), BufReader::with_capacity(BLOCK_BYTES, file))
    }
}

impl<R: Read> ArrayReader<R> {
    pub(super) fn new(path: PathBuf, mut reader: R) -> Result<Self, NpyError> {
        let header = read_header(&mut reader).map_err(|e| NpyError::io(&path, e))?;
        if header.order() == Order::Fortran && header.shape().len() > 1 {
            return Err(NpyError::format(
                &path,
                "the array is in Fortran order; save numpy.ascontiguousarray(array) instead",
            ));
        }
        let element =
            ArrayElement::of(&header.dtype()).map_err(|what| NpyError::format(&path, what))?;
        Ok(Self { path, shape: header.shape().to_vec(), element, reader })
    }

    /// How many elements the shape announces; the most there can be where it announces more.
    fn n_elements(&self) -> u64 {
        self.shape.iter().fold(1, |n, m| n.saturating_mul(*m))
    }

    /// Length along each axis.
    #[must_use]
    pub fn shape(&self) -> &[u64] {
        &self.shape
    }

    /// Bytes of one unsigned integer element, for plain arrays of those; `None` for all others.
    #[must_use]
    pub fn unsigned_bytes(&self) -> Option<usize> {
        match self.element.fields.as_slice() {
            [Field { name, cell }] if name.is_empty() && cell.kind == NumberKind::Unsigned => {
                Some(cell.n_bytes)
            }
            _ => None,
        }
    }

    /// The next `n` elements of a plain array of u8.
    ///
    /// # Errors
    /// When the file ends before.
    pub fn next_u8(&mut self, n: usize) -> Result<Vec<u8>, NpyError> {
        let mut bytes = Vec::new();
        let n_read = (&mut self.reader).take(n as u64).read_to_end(&mut bytes);
        match n_read {
            Ok(read) if read == n => Ok(bytes),
            Ok(_) => Err(NpyError::io(&self.path, std::io::ErrorKind::UnexpectedEof.into())),
            Err(source) => Err(NpyError::io(&self.path, source)),
        }
    }

    /// The next `n` elements of a plain array of u16.
    ///
    /// # Errors
    /// When the file ends before.
    pub fn next_u16(&mut self, n: usize) -> Result<Vec<u16>, NpyError> {
        let bytes = self.next_u8(n * 2)?;
        let is_big_endian = self.element.fields.first().is_some_and(|f| f.cell.is_big_endian);
        let pairs = bytes.chunks_exact(2).map(|pair| [pair[0], pair[1]]);
        Ok(if is_big_endian {
            pairs.map(u16::from_be_bytes).collect()
        } else {
            pairs.map(u16::from_le_bytes).collect()
        })
    }

    /// Reads the array to its end.
    ///
    /// # Errors
    /// When the file ends before the data its header announces.
    pub fn read_all(mut self) -> Result<Array, NpyError> {
        let (columns, n_missing) = self.read_records(self.n_elements())?;
        if n_missing > 0 {
            return Err(NpyError::io(&self.path, std::io::ErrorKind::UnexpectedEof.into()));
        }
        let names = self.element.fields.into_iter().map(|field| field.name);
        Ok(Array { shape: self.shape, fields: names.zip(columns).collect() })
    }

    /// Reads the array as a table: records of named fields, or N rows of 4 to 8 numbers. Rows that the
    /// header announces and the file does not hold are stated as damage.
    ///
    /// # Errors
    /// When the array is neither, or reading fails.
    pub fn read_table(mut self) -> Result<StoredTable, NpyError> {
        let mut n_records = self.n_elements();
        if let [Field { name, cell }] = self.element.fields.as_slice() {
            let &[n_rows, n_columns @ 4..=8] = self.shape.as_slice() else {
                let what = format!(
                    "has shape {:?}; expected (N, 4) with columns t, x, y, p, or records with \
                     fields t, x, y, p",
                    self.shape
                );
                return Err(NpyError::format(&self.path, what));
            };
            let n_bytes = self.element.n_bytes;
            let place = |i: usize| NumberCell { offset: i * n_bytes + cell.offset, ..*cell };
            let field = |i| Field { name: name.clone(), cell: place(i) };
            let fields = (0..n_columns as usize).map(field).collect();
            self.element = ArrayElement { fields, n_bytes: n_columns as usize * n_bytes };
            n_records = n_rows;
        }
        let (columns, n_missing) = self.read_records(n_records)?;
        let cut = || format!("the file is cut: {n_missing} of {n_records} rows are missing");
        let names = self.element.fields.into_iter().map(|field| field.name);
        let table = StoredTable::of_columns(names.zip(columns).collect());
        Ok(StoredTable { damage: (n_missing > 0).then(cut), ..table })
    }

    /// Reads a plain array, where `is_cut` up to the end of the data: its elements, and how many the
    /// header announces.
    pub(super) fn read_column(mut self, is_cut: bool) -> Result<(Column, u64), NpyError> {
        let n = self.n_elements();
        let (mut columns, n_missing) = self.read_records(n)?;
        match columns.pop() {
            Some(column) if n_missing == 0 || is_cut => Ok((column, n)),
            _ => Err(NpyError::io(&self.path, std::io::ErrorKind::UnexpectedEof.into())),
        }
    }

    /// The next `n` records, a column a field, up to the end of the data; and how many are missing.
    fn read_records(&mut self, n: u64) -> Result<(Vec<Column>, u64), NpyError> {
        let ArrayElement { fields, n_bytes } = &self.element;
        let mut columns = vec![Column::default(); fields.len()];
        let mut n_missing = n;
        // A header may announce more than there is: memory grows with the data read.
        let n_rows = (BLOCK_BYTES / n_bytes).max(1);
        let mut block = Vec::with_capacity(n_rows * n_bytes);
        while n_missing > 0 {
            block.clear();
            let n_asked = n_missing.min(n_rows as u64) * *n_bytes as u64;
            let read = self.reader.by_ref().take(n_asked).read_to_end(&mut block);
            let n_read = read.map_err(|source| NpyError::io(&self.path, source))?;
            for (field, column) in fields.iter().zip(&mut columns) {
                field.cell.decode(&block, *n_bytes, column);
            }
            n_missing -= (n_read / n_bytes) as u64;
            if (n_read as u64) < n_asked {
                break;
            }
        }
        Ok((columns, n_missing))
    }
}

impl ArrayElement {
    fn of(dtype: &DType) -> Result<Self, String> {
        let mut element = Self { fields: Vec::new(), n_bytes: 0 };
        match dtype {
            DType::Plain(number) if matches!(number.type_char(), TypeChar::RawData) => {
                return Err(format!("elements of type {number} are not numbers"));
            }
            DType::Plain(number) => element.append("", number)?,
            DType::Record(fields) => {
                for field in fields {
                    let DType::Plain(number) = &field.dtype else {
                        return Err(format!("field {} is not a plain number", field.name));
                    };
                    element.append(&field.name, number)?;
                }
            }
            DType::Array(..) => {
                return Err("elements are arrays themselves; use a plain array".into());
            }
        }
        match element.fields.is_empty() {
            true => Err("its elements have no fields".into()),
            false => Ok(element),
        }
    }

    /// Appends a field, or the padding between fields of an aligned record, which has no name.
    fn append(&mut self, name: &str, number: &TypeStr) -> Result<(), String> {
        let kind = match number.type_char() {
            TypeChar::Int => NumberKind::Signed,
            TypeChar::Uint | TypeChar::Bool => NumberKind::Unsigned,
            TypeChar::Float => NumberKind::Float,
            TypeChar::RawData if name.is_empty() => {
                self.n_bytes += number.size_field() as usize;
                return Ok(());
            }
            _ => return Err(format!("elements of type {number} are not numbers")),
        };
        let n_bytes = number.num_bytes().unwrap_or(0);
        let is_big_endian = number.endianness() == Endianness::Big;
        let cell = NumberCell { kind, n_bytes, is_big_endian, offset: self.n_bytes };
        if !cell.is_known() {
            return Err(format!("elements of type {number} are not read; use int64 or float64"));
        }
        self.fields.push(Field { name: name.to_owned(), cell });
        self.n_bytes += n_bytes;
        Ok(())
    }
}
