//! What the values of one column show.

use super::column_values::{bounds, first_distinct};
use evrig_format::npy::Column;
use std::fmt;

/// What the values of one column show.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct ColumnFacts {
    n: usize,
    min: f64,
    max: f64,
    is_whole: bool,
    /// Values smaller than the one before them.
    n_descents: usize,
    /// The first distinct values.
    distinct: Vec<f64>,
    /// Values below zero.
    n_negative: usize,
}

/// More distinct values than any convention of polarity has.
const MAX_POLARITIES: usize = 3;

impl ColumnFacts {
    pub(super) fn of(column: &Column) -> Self {
        match column {
            Column::Short(values) => Self::of_values(values, f64::from),
            Column::Int(values) => Self::of_values(values, |value| value as f64),
            Column::Float(values) => Self {
                is_whole: values.iter().all(|value| value.fract() == 0.0),
                ..Self::of_values(values, |value| value)
            },
        }
    }

    /// Facts of whole numbers.
    fn of_values<T: Copy + Default + PartialOrd>(values: &[T], float: impl Fn(T) -> f64) -> Self {
        let [min, max] =
            bounds(values).map_or([f64::INFINITY, f64::NEG_INFINITY], |b| b.map(&float));
        Self {
            n: values.len(),
            min,
            max,
            is_whole: true,
            n_descents: values.windows(2).filter(|pair| pair[1] < pair[0]).count(),
            distinct: first_distinct::<_, { MAX_POLARITIES + 1 }>(values)
                .into_iter()
                .map(float)
                .collect(),
            n_negative: values.iter().filter(|value| **value < T::default()).count(),
        }
    }

    /// Two or three values of a known convention.
    pub(super) fn can_be_polarity(&self) -> bool {
        let is_known = |value: &f64| super::polarity::is_known(*value);
        self.distinct.len() <= MAX_POLARITIES && self.distinct.iter().all(is_known)
    }

    /// Whole numbers, the largest of them near the grid's side.
    pub(super) fn can_be_coordinate(&self, side: Option<u16>) -> bool {
        // Some events off the grid are counted as losses; twice the side is another column.
        let most = side.map_or(f64::from(u16::MAX), |side| 2.0 * f64::from(side));
        self.is_whole && self.max <= most && 2 * self.n_negative <= self.n
    }

    /// More than the two values of a polarity.
    pub(super) fn can_be_time(&self) -> bool {
        self.n <= MAX_POLARITIES || self.distinct.len() > MAX_POLARITIES
    }

    /// In order of time, but for a few.
    pub(super) fn is_ascending(&self) -> bool {
        100 * self.n_descents <= self.n
    }
}

impl fmt::Display for ColumnFacts {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}..{}", self.min, self.max)?;
        if self.is_whole { Ok(()) } else { write!(f, " with fractions") }
    }
}
