//! A table; sortable where scripts run.

use super::figure::FileLink;
use super::number::{count, quantity, significant};
use evrig_core::stats::Estimate;

/// Columns and rows; a row shorter than the columns ends in empty cells.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ReportTable {
    /// Title.
    pub title: String,
    /// Caption.
    pub caption: String,
    /// Column heads.
    pub columns: Vec<TableColumn>,
    /// Rows in their initial order.
    pub rows: Vec<Vec<TableCell>>,
}

/// The head of a column.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TableColumn {
    /// Name.
    pub name: String,
    /// Unit; empty for none.
    pub unit: String,
    /// Whether the cells are numbers, aligned right.
    pub is_numeric: bool,
}

/// One cell with its sort key.
#[derive(Debug, Clone, PartialEq)]
pub struct TableCell {
    text: String,
    /// Sorted by this number where it is finite, by the text otherwise.
    key: Option<f64>,
    link: Option<FileLink>,
}

impl TableColumn {
    /// A column of text.
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

impl TableCell {
    /// Text.
    #[must_use]
    pub fn text(text: &str) -> Self {
        Self { text: text.to_owned(), key: None, link: None }
    }

    /// A whole number.
    #[must_use]
    pub fn count(n: u64) -> Self {
        Self { text: count(n), key: Some(n as f64), link: None }
    }

    /// A number without error, to three digits.
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
    pub fn with_link(self, link: FileLink) -> Self {
        Self { link: Some(link), ..self }
    }

    /// The text.
    #[must_use]
    pub fn shown(&self) -> &str {
        &self.text
    }

    /// The numeric sort key, where there is one.
    #[must_use]
    pub fn sort_key(&self) -> Option<f64> {
        self.key.filter(|key| key.is_finite())
    }

    /// The link.
    #[must_use]
    pub fn link(&self) -> Option<&FileLink> {
        self.link.as_ref()
    }
}
