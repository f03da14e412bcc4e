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

    /// Number of rows.
    #[must_use]
    pub fn n_rows(&self) -> usize {
        self.columns.first().map_or(0, |(_, column)| column.len())
    }
}
