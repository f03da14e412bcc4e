//! Columns of numbers, and numbers in records of bytes.

/// One column of numbers, integers kept exact.
///
/// Coordinates and polarities take two bytes each: tables of events are as large in memory as the
/// events.
#[derive(Debug, Clone)]
pub enum Column {
    /// Integers and booleans, all in 16 bits.
    Short(Vec<i16>),
    /// Integers.
    Int(Vec<i64>),
    /// Floating point.
    Float(Vec<f64>),
}

impl Default for Column {
    fn default() -> Self {
        Self::Short(Vec::new())
    }
}

impl PartialEq for Column {
    /// Whether the numbers are equal, in whichever width.
    fn eq(&self, other: &Self) -> bool {
        let is_same_kind = matches!(self, Self::Float(_)) == matches!(other, Self::Float(_));
        is_same_kind
            && self.len() == other.len()
            && match (self, other) {
                (Self::Float(a), Self::Float(b)) => a == b,
                (Self::Short(a), Self::Short(b)) => a == b,
                (Self::Int(a), Self::Int(b)) => a == b,
                (Self::Short(short), Self::Int(int)) | (Self::Int(int), Self::Short(short)) => {
                    short.iter().zip(int).all(|(a, b)| i64::from(*a) == *b)
                }
                _ => false,
            }
    }
}

impl Column {
    /// Number of values.
    #[must_use]
    pub fn len(&self) -> usize {
        match self {
            Self::Short(values) => values.len(),
            Self::Int(values) => values.len(),
            Self::Float(values) => values.len(),
        }
    }

    /// Whether there is no value.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The value at `i`, integers beyond 53 bits rounded.
    ///
    /// # Panics
    /// When `i` is not below the length, as indexing does.
    #[must_use]
    pub fn get(&self, i: usize) -> f64 {
        match self {
            Self::Short(values) => values[i].into(),
            Self::Int(values) => values[i] as f64,
            Self::Float(values) => values[i],
        }
    }

    /// Keeps the first `n` numbers.
    pub(crate) fn truncate(&mut self, n: usize) {
        match self {
            Self::Short(values) => values.truncate(n),
            Self::Int(values) => values.truncate(n),
            Self::Float(values) => values.truncate(n),
        }
    }

    /// Whole numbers; floats are rounded.
    ///
    /// # Errors
    /// The index of the first value that is not finite or beyond the range of 64 bits.
    pub fn into_integers(self) -> Result<Vec<i64>, usize> {
        match self {
            Self::Short(values) => Ok(values.into_iter().map(i64::from).collect()),
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

    /// Appends whole numbers.
    pub(crate) fn extend_integers(&mut self, values: impl Iterator<Item = i64> + Clone) {
        if let Self::Short(short) = self {
            let (n, mut do_fit) = (short.len(), true);
            short.extend(values.clone().map(|value| {
                do_fit &= i64::from(value as i16) == value;
                value as i16
            }));
            if do_fit {
                return;
            }
            short.truncate(n);
            *self = Self::Int(short.iter().map(|value| (*value).into()).collect());
        }
        match self {
            Self::Short(_) => {}
            Self::Int(wide) => wide.extend(values),
            Self::Float(floats) => floats.extend(values.map(|value| value as f64)),
        }
    }

    /// Appends numbers with fractions; the column becomes one of floats.
    pub(crate) fn extend_floats(&mut self, values: impl Iterator<Item = f64>) {
        if !matches!(self, Self::Float(_)) {
            *self = Self::Float((0..self.len()).map(|i| self.get(i)).collect());
        }
        if let Self::Float(floats) = self {
            floats.extend(values);
        }
    }
}

/// How a number is stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum NumberKind {
    Signed,
    Unsigned,
    Float,
}

/// A number in each record of a table, of 1, 2, 4 or 8 bytes; floats of 4 or 8.
#[derive(Debug, Clone, Copy)]
pub(crate) struct NumberCell {
    pub(crate) kind: NumberKind,
    pub(crate) n_bytes: usize,
    pub(crate) is_big_endian: bool,
    /// Bytes of the record in front of it.
    pub(crate) offset: usize,
}

impl NumberCell {
    /// Whether numbers are stored so.
    pub(crate) fn is_known(self) -> bool {
        match self.kind {
            NumberKind::Float => matches!(self.n_bytes, 4 | 8),
            NumberKind::Signed | NumberKind::Unsigned => matches!(self.n_bytes, 1 | 2 | 4 | 8),
        }
    }

    /// Appends the number of each whole record of `stride` bytes, which hold the cell.
    pub(crate) fn decode(self, records: &[u8], stride: usize, into: &mut Column) {
        match self.n_bytes {
            1 => self.numbers::<1>(records, stride, into),
            2 => self.numbers::<2>(records, stride, into),
            4 => self.numbers::<4>(records, stride, into),
            _ => self.numbers::<8>(records, stride, into),
        }
    }

    fn numbers<const N: usize>(self, records: &[u8], stride: usize, into: &mut Column) {
        let unused = 64 - 8 * N as u32;
        let bits = records.chunks_exact(stride).map(|record| {
            let mut cell = [0; 8];
            cell[..N].copy_from_slice(&record[self.offset..self.offset + N]);
            let bits = u64::from_le_bytes(cell);
            if self.is_big_endian { bits.swap_bytes() >> unused } else { bits }
        });
        match self.kind {
            // Shifting left and back carries the sign of a narrow integer to all 64 bits.
            NumberKind::Signed => {
                into.extend_integers(bits.map(|bits| ((bits << unused) as i64) >> unused));
            }
            NumberKind::Unsigned => {
                into.extend_integers(bits.map(|bits| i64::try_from(bits).unwrap_or(i64::MAX)));
            }
            NumberKind::Float if N == 4 => {
                into.extend_floats(bits.map(|bits| f32::from_bits(bits as u32).into()));
            }
            NumberKind::Float => into.extend_floats(bits.map(f64::from_bits)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_column_is_widened_by_the_first_value_that_needs_it() {
        let mut column = Column::default();
        column.extend_integers([3, -1].into_iter());
        assert!(matches!(column, Column::Short(_)));
        column.extend_integers([7, 32_768].into_iter());
        assert!(matches!(&column, Column::Int(values) if *values == [3, -1, 7, 32_768]));
        column.extend_floats([0.5].into_iter());
        column.extend_integers([2].into_iter());
        assert_eq!(column, Column::Float(vec![3.0, -1.0, 7.0, 32_768.0, 0.5, 2.0]));
        assert_eq!(Column::Short(vec![1, 2]), Column::Int(vec![1, 2]));
        assert_ne!(Column::Short(vec![1, 2]), Column::Int(vec![1, 3]));
        assert_ne!(Column::Short(vec![1]), Column::Float(vec![1.0]));
    }

    #[test]
    fn numbers_of_every_width_and_order_are_decoded() {
        let cell =
            |kind, n_bytes, is_big_endian| NumberCell { kind, n_bytes, is_big_endian, offset: 1 };
        let decode = |cell: NumberCell, bytes: &[u8]| {
            let mut column = Column::default();
            let record = [&[9], bytes].concat();
            cell.decode(&[record.clone(), record].concat(), 1 + bytes.len(), &mut column);
            column
        };
        let minus_two = Column::Int(vec![-2; 2]);
        for n in [1, 2, 4, 8] {
            let bytes = (-2_i64).to_le_bytes();
            assert_eq!(decode(cell(NumberKind::Signed, n, false), &bytes[..n]), minus_two);
            let bytes = (-2_i64).to_be_bytes();
            assert_eq!(decode(cell(NumberKind::Signed, n, true), &bytes[8 - n..]), minus_two);
        }
        let most = decode(cell(NumberKind::Unsigned, 8, false), &[255; 8]);
        assert_eq!(most, Column::Int(vec![i64::MAX; 2]));
        let half = decode(cell(NumberKind::Float, 4, true), &0.5_f32.to_be_bytes());
        assert_eq!(half, Column::Float(vec![0.5; 2]));
        let third = decode(cell(NumberKind::Float, 8, false), &(1.0_f64 / 3.0).to_le_bytes());
        assert_eq!(third, Column::Float(vec![1.0 / 3.0; 2]));
    }
}
