//! A table of numbers as a file stores it, before anything is decided about its columns.

use crate::npy::Column;

/// Columns with their names, and texts in the file that may state what they hold.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct StoredTable {
    /// Names, empty where the file gives none, and values of equal length.
    pub columns: Vec<(String, Column)>,
    /// Comments and attributes.
    pub notes: Vec<String>,
    /// Added to every time, µs; 0 where the file states none.
    pub t_offset_us: i64,
    /// Where reading had to stop, for a file that is cut.
    pub damage: Option<String>,
}

impl StoredTable {
    /// A table of columns without notes.
    #[must_use]
    pub fn of_columns(columns: Vec<(String, Column)>) -> Self {
        Self { columns, ..Self::default() }
    }

    /// Unnamed columns of an array of rows that is stored row by row.
    #[must_use]
    pub fn of_rows(values: &Column, n_columns: usize) -> Self {
        fn pick<T: Copy>(values: &[T], n_columns: usize, i: usize) -> Vec<T> {
            values.iter().skip(i).step_by(n_columns).copied().collect()
        }
        let column = |i| match values {
            Column::Int(values) => Column::Int(pick(values, n_columns, i)),
            Column::Float(values) => Column::Float(pick(values, n_columns, i)),
        };
        Self::of_columns((0..n_columns).map(|i| (String::new(), column(i))).collect())
    }

    /// Number of rows.
    #[must_use]
    pub fn n_rows(&self) -> usize {
        self.columns.first().map_or(0, |(_, column)| column.len())
    }
}
