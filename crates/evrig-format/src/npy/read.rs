//! Reading: any numeric element type becomes `i64` or `f64` columns, or raw rows.

use super::NpyError;
use super::header::read_header;
use npyz::{DType, Endianness, Order, TypeChar, TypeStr};
use std::fs::File;
use std::io::{BufReader, Read, Seek};
use std::path::{Path, PathBuf};

/// One column of numbers, integers kept exact.
#[derive(Debug, Clone, PartialEq)]
pub enum Column {
    /// Integers and booleans.
    Int(Vec<i64>),
    /// Floating point.
    Float(Vec<f64>),
}

impl Column {
    /// Number of values.
    #[must_use]
    pub fn len(&self) -> usize {
        match self {
            Self::Int(values) => values.len(),
            Self::Float(values) => values.len(),
        }
    }

    /// Whether there is no value.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Whole numbers; floats are rounded. `Err` is the index of the first value that is not finite
    /// or beyond the range of 64 bits.
    ///
    /// # Errors
    /// The index of the offending value.
    pub fn into_integers(self) -> Result<Vec<i64>, usize> {
        match self {
            Self::Int(values) => Ok(values),
            Self::Float(values) => values
                .into_iter()
                .enumerate()
                .map(|(i, value)| {
                    let fits = value.is_finite() && value.abs() < 9.2e18;
                    if fits { Ok(value.round() as i64) } else { Err(i) }
                })
                .collect(),
        }
    }
}

/// An array read whole: its shape and one column a field (one column without a name for plain
/// arrays).
#[derive(Debug, Clone, PartialEq)]
pub struct Array {
    /// Length along each axis.
    pub shape: Vec<u64>,
    /// Field name (empty for plain arrays) and values in C order.
    pub fields: Vec<(String, Column)>,
}

#[derive(Debug, Clone, Copy)]
enum NumberKind {
    Int,
    Uint,
    Float,
    /// Bytes between fields of an aligned or padded record.
    Padding,
}

#[derive(Debug, Clone)]
struct Field {
    name: String,
    kind: NumberKind,
    n_bytes: usize,
    is_big_endian: bool,
}

/// An open array whose elements are read in order, as many at a time as the caller wants.
pub struct ArrayReader<R> {
    path: PathBuf,
    shape: Vec<u64>,
    fields: Vec<Field>,
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
        let file = File::open(path).map_err(io)?;
        let mut array = Self::new(path.to_owned(), BufReader::with_capacity(1 << 20, file))?;
        let about = array.reader.get_ref().metadata().map_err(io)?;
        // A pipe has no length; a file's length is checked against the announced data.
        if about.is_file() {
            let header = array.reader.stream_position().map_err(io)?;
            let announced = array.n_elements().checked_mul(array.element_bytes() as u64);
            if announced.is_none_or(|n| n > about.len().saturating_sub(header)) {
                return Err(io(std::io::ErrorKind::UnexpectedEof.into()));
            }
        }
        Ok(array)
    }
}

impl<R: Read> ArrayReader<R> {
    fn new(path: PathBuf, mut reader: R) -> Result<Self, NpyError> {
        let header = read_header(&mut reader).map_err(|e| NpyError::io(&path, e))?;
        if header.order() == Order::Fortran && header.shape().len() > 1 {
            return Err(NpyError::format(
                &path,
                "the array is in Fortran order; save numpy.ascontiguousarray(array) instead",
            ));
        }
        let fields = fields_of(&header.dtype()).map_err(|what| NpyError::format(&path, what))?;
        Ok(Self { path, shape: header.shape().to_vec(), fields, reader })
    }

    /// How many elements the shape announces; the most there can be where it announces more.
    fn n_elements(&self) -> u64 {
        self.shape.iter().fold(1, |n, m| n.saturating_mul(*m))
    }

    /// Bytes of one element with all its fields.
    fn element_bytes(&self) -> usize {
        self.fields.iter().map(|field| field.n_bytes).sum()
    }

    /// Length along each axis.
    #[must_use]
    pub fn shape(&self) -> &[u64] {
        &self.shape
    }

    /// Bytes of one unsigned integer element, for plain arrays of those; `None` for all others.
    #[must_use]
    pub fn unsigned_bytes(&self) -> Option<usize> {
        match self.fields.as_slice() {
            [Field { kind: NumberKind::Uint, n_bytes, name, .. }] if name.is_empty() => {
                Some(*n_bytes)
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
        let is_big_endian = self.fields.first().is_some_and(|field| field.is_big_endian);
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
        let row = self.element_bytes();
        let mut columns: Vec<Column> = self.fields.iter().map(Field::empty_column).collect();
        let is_padding = |field: &Field| matches!(field.kind, NumberKind::Padding);
        // A header may announce more than there is: memory grows with the data read.
        let mut left = self.n_elements();
        while left > 0 {
            let n_rows = left.min(1 << 16) as usize;
            let bytes = self.next_u8(n_rows * row)?;
            let mut at = 0;
            for (field, column) in self.fields.iter().zip(&mut columns) {
                let cells = bytes.chunks_exact(row).map(|cells| &cells[at..at + field.n_bytes]);
                if !is_padding(field) {
                    field.decode(cells, column);
                }
                at += field.n_bytes;
            }
            left -= n_rows as u64;
        }
        let fields = self.fields.into_iter().zip(columns).filter(|(field, _)| !is_padding(field));
        let fields = fields.map(|(field, column)| (field.name, column)).collect();
        Ok(Array { shape: self.shape, fields })
    }
}

/// An open npz archive.
pub struct Npz {
    path: PathBuf,
    archive: zip::ZipArchive<BufReader<File>>,
}

impl Npz {
    /// Opens an npz archive.
    ///
    /// # Errors
    /// When the file cannot be read or is not a zip archive.
    pub fn open(path: &Path) -> Result<Self, NpyError> {
        let file = File::open(path).map_err(|source| NpyError::io(path, source))?;
        let archive = zip::ZipArchive::new(BufReader::new(file))
            .map_err(|e| NpyError::format(path, format!("not an npz archive: {e}")))?;
        Ok(Self { path: path.to_owned(), archive })
    }

    /// Names of the arrays, without the ending `.npy`.
    #[must_use]
    pub fn names(&self) -> Vec<String> {
        let names = self.archive.file_names();
        let without_ending = |name: &str| name.strip_suffix(".npy").unwrap_or(name).to_owned();
        names.flatten().map(|name| without_ending(&name)).collect()
    }

    /// Reads one array whole.
    ///
    /// # Errors
    /// When there is no such array, or it is not an array of numbers.
    pub fn array(&mut self, name: &str) -> Result<Array, NpyError> {
        let inside = PathBuf::from(format!("{}[{name}]", self.path.display()));
        let entry = self
            .archive
            .by_name(&format!("{name}.npy"))
            .map_err(|e| NpyError::format(&inside, e.to_string()))?;
        ArrayReader::new(inside, BufReader::new(entry))?.read_all()
    }
}

impl Field {
    fn new(name: String, element: &TypeStr) -> Result<Self, String> {
        let kind = match element.type_char() {
            TypeChar::Int => NumberKind::Int,
            TypeChar::Uint | TypeChar::Bool => NumberKind::Uint,
            TypeChar::Float => NumberKind::Float,
            TypeChar::RawData if name.is_empty() => NumberKind::Padding,
            _ => return Err(format!("elements of type {element} are not numbers")),
        };
        let n_bytes = match kind {
            NumberKind::Padding => element.size_field() as usize,
            _ => element.num_bytes().unwrap_or(0),
        };
        let is_known = match kind {
            NumberKind::Float => matches!(n_bytes, 4 | 8),
            NumberKind::Int | NumberKind::Uint => matches!(n_bytes, 1 | 2 | 4 | 8),
            NumberKind::Padding => n_bytes > 0,
        };
        if !is_known {
            return Err(format!("elements of type {element} are not read; use int64 or float64"));
        }
        let is_big_endian = element.endianness() == Endianness::Big;
        Ok(Self { name, kind, n_bytes, is_big_endian })
    }

    fn empty_column(&self) -> Column {
        match self.kind {
            NumberKind::Float => Column::Float(Vec::new()),
            NumberKind::Int | NumberKind::Uint | NumberKind::Padding => Column::Int(Vec::new()),
        }
    }

    fn decode<'a>(&self, cells: impl Iterator<Item = &'a [u8]>, column: &mut Column) {
        match column {
            Column::Int(values) => values.extend(cells.map(|cell| self.integer(cell))),
            Column::Float(values) => values.extend(cells.map(|cell| self.float(cell))),
        }
    }

    /// The cell's bytes as one unsigned number.
    fn bits(&self, cell: &[u8]) -> u64 {
        let shift_in = |bits: u64, byte: &u8| (bits << 8) | u64::from(*byte);
        if self.is_big_endian {
            cell.iter().fold(0, shift_in)
        } else {
            cell.iter().rev().fold(0, shift_in)
        }
    }

    fn integer(&self, cell: &[u8]) -> i64 {
        let bits = self.bits(cell);
        let unused = 64 - 8 * self.n_bytes as u32;
        match self.kind {
            // Shifting left and back carries the sign of a narrow integer to all 64 bits.
            NumberKind::Int => ((bits << unused) as i64) >> unused,
            NumberKind::Uint | NumberKind::Float | NumberKind::Padding => {
                i64::try_from(bits).unwrap_or(i64::MAX)
            }
        }
    }

    fn float(&self, cell: &[u8]) -> f64 {
        let bits = self.bits(cell);
        match self.n_bytes {
            4 => f64::from(f32::from_bits(bits as u32)),
            _ => f64::from_bits(bits),
        }
    }
}

fn fields_of(dtype: &DType) -> Result<Vec<Field>, String> {
    match dtype {
        DType::Plain(element) if matches!(element.type_char(), TypeChar::RawData) => {
            Err(format!("elements of type {element} are not numbers"))
        }
        DType::Plain(element) => Ok(vec![Field::new(String::new(), element)?]),
        DType::Record(fields) if fields.is_empty() => Err("its elements have no fields".into()),
        DType::Record(fields) => fields
            .iter()
            .map(|field| match &field.dtype {
                DType::Plain(element) => Field::new(field.name.clone(), element),
                _ => Err(format!("field {} is not a plain number", field.name)),
            })
            .collect(),
        DType::Array(..) => Err("elements are arrays themselves; use a plain array".into()),
    }
}
