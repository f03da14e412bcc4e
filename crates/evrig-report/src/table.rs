//! A table of a dataset: plain without script, sortable by its heads with it.

use super::figure::Link;
use super::number::{count, quantity, significant};
use evrig_core::stats::Estimate;

/// Columns and rows; a row shorter than the columns ends in empty cells.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Table {
    /// What is listed.
    pub title: String,
    /// What to look for.
    pub caption: String,
    /// Heads, from the left.
    pub columns: Vec<Column>,
    /// Rows, in the order that a reader without script sees.
    pub rows: Vec<Vec<Cell>>,
}

/// The head of a column.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Column {
    /// Name.
    pub name: String,
    /// Unit; empty for none.
    pub unit: String,
    /// Whether the cells are numbers, set to the right.
    pub is_numeric: bool,
}

/// One cell: what is read and what it is sorted by.
#[derive(Debug, Clone, PartialEq)]
pub struct Cell {
    text: String,
    /// Sorted by this number where it is finite, by the text otherwise.
    key: Option<f64>,
    link: Option<Link>,
}

impl Column {
    /// A column of words.
    #[must_use]
    pub fn text(name: &str) -> Self {
        Self { name: name.to_owned(), unit: String::new(), is_numeric: false }
    }

    /// A column of numbers.
    #[must_use]
    pub fn number(name: &str, unit: &str) -> Self {
        Self { name: name.to_owned(), unit: unit.to_owned(), is_numeric: true }
    }
}

impl Cell {
    /// Words.
    #[must_use]
    pub fn text(text: &str) -> Self {
        Self { text: text.to_owned(), key: None, link: None }
    }

    /// A whole number.
    #[must_use]
    pub fn count(n: u64) -> Self {
        Self { text: count(n), key: Some(n as f64), link: None }
    }

    /// A bare number to three digits; for what has no error, such as a setting.
    #[must_use]
    pub fn number(value: f64) -> Self {
        Self { text: significant(value, 3), key: Some(value), link: None }
    }

    /// A value with its error; sorted by the value.
    #[must_use]
    pub fn estimate(estimate: &Estimate) -> Self {
        Self { text: quantity(estimate).to_string(), key: Some(estimate.value), link: None }
    }

    /// The same cell as a link to a file beside the page.
    #[must_use]
    pub fn with_link(self, link: Link) -> Self {
        Self { link: Some(link), ..self }
    }

    /// What is read.
    #[must_use]
    pub fn shown(&self) -> &str {
        &self.text
    }

    /// What it is sorted by, where that is a number.
    #[must_use]
    pub fn sort_key(&self) -> Option<f64> {
        self.key.filter(|key| key.is_finite())
    }

    /// Where it leads.
    #[must_use]
    pub fn link(&self) -> Option<&Link> {
        self.link.as_ref()
    }
}
