//! The error of values that are named by a keyword in files and on the command line.

/// A text that is none of the keywords of its type.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("`{found}` is unknown; expected {expected}")]
pub struct UnknownKeyword {
    found: String,
    expected: &'static str,
}

impl UnknownKeyword {
    /// The error for `found` where `expected` lists the keywords.
    #[must_use]
    pub fn new(found: &str, expected: &'static str) -> Self {
        Self { found: found.to_owned(), expected }
    }
}
