//! What the values of one column show.

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
            Column::Short(values) => Self::of_values(values.iter().map(|value| (*value).into())),
            Column::Int(values) => Self::of_values(values.iter().map(|value| *value as f64)),
            Column::Float(values) => Self {
                is_whole: values.iter().all(|value| value.fract() == 0.0),
                ..Self::of_values(values.iter().copied())
            },
        }
    }

    /// Facts of whole numbers.
    fn of_values(values: impl Iterator<Item = f64>) -> Self {
        let mut facts = Self {
            n: 0,
            min: f64::INFINITY,
            max: f64::NEG_INFINITY,
            is_whole: true,
            n_descents: 0,
            distinct: Vec::new(),
            n_negative: 0,
        };
        let mut last = f64::NEG_INFINITY;
        for value in values {
            facts.n += 1;
            facts.min = facts.min.min(value);
            facts.max = facts.max.max(value);
            facts.n_descents += usize::from(value < last);
            facts.n_negative += usize::from(value < 0.0);
            if facts.distinct.len() <= MAX_POLARITIES {
                // Without a branch on each: polarities are as random as a coin.
                let is_known =
                    facts.distinct.iter().fold(false, |is, known| is | (*known == value));
                if !is_known {
                    facts.distinct.push(value);
                }
            }
            last = value;
        }
        facts
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
