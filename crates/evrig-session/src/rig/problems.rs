//! The mistakes of a description file.

use std::cell::RefCell;
use std::fmt;
use std::ops::Range;

/// One mistake: where and what.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Problem {
    /// Line of the file, from 1.
    pub line: usize,
    /// The key, what was found and what was expected.
    pub what: String,
}

/// Why a description file cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum DescriptionError {
    /// The file cannot be read.
    #[error("cannot read the description {path}: {source}")]
    Unreadable {
        /// The file.
        path: String,
        /// The system's error.
        source: std::io::Error,
    },
    /// The file is far too long for a description.
    #[error(
        "{path} has {length} bytes; a description has at most {limit}: is this the right file?"
    )]
    TooLong {
        /// The file.
        path: String,
        /// Its length.
        length: u64,
        /// The longest allowed.
        limit: u64,
    },
    /// Neither a file nor the name of a description that the program carries.
    #[error(
        "there is no {what} `{name}`: neither a file nor one of {}{}",
        known.join(", "), hint(name, known)
    )]
    UnknownName {
        /// Rig or trajectory.
        what: &'static str,
        /// What was asked for.
        name: String,
        /// The descriptions that the program carries.
        known: Vec<&'static str>,
    },
    /// The file has mistakes; all that could be found at once.
    #[error("{}", Listed { file, problems })]
    Wrong {
        /// The file.
        file: String,
        /// Its mistakes, in the order of their lines.
        problems: Vec<Problem>,
    },
}

fn hint(name: &str, known: &[&'static str]) -> String {
    // `trajectories/circle.toml` means the bundled `circle` where there are no files.
    let stem = name.rsplit(['/', '\\']).next().unwrap_or(name).trim_end_matches(".toml");
    super::closest(stem, known.iter().copied())
        .map_or(String::new(), |near| format!("; did you mean `{near}`?"))
}

struct Listed<'a> {
    file: &'a str,
    problems: &'a [Problem],
}

impl fmt::Display for Listed<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { file, problems } = self;
        if let [only] = problems {
            return write!(f, "{file}:{}: {}", only.line, only.what);
        }
        write!(f, "{file} has {} mistakes:", problems.len())?;
        for Problem { line, what } in *problems {
            write!(f, "\n  {file}:{line}: {what}")?;
        }
        Ok(())
    }
}

impl DescriptionError {
    /// The mistakes in the file; none when it could not be read at all.
    #[must_use]
    pub fn problems(&self) -> &[Problem] {
        match self {
            Self::Wrong { problems, .. } => problems,
            Self::Unreadable { .. } | Self::TooLong { .. } | Self::UnknownName { .. } => &[],
        }
    }
}

/// Mistakes while they are collected.
pub(crate) struct Problems {
    file: String,
    line_starts: Vec<usize>,
    found: RefCell<Vec<Problem>>,
}

impl Problems {
    pub(crate) fn new(file: &str, text: &str) -> Self {
        let line_starts = std::iter::once(0).chain(text.match_indices('\n').map(|(i, _)| i + 1));
        Self {
            file: file.to_owned(),
            line_starts: line_starts.collect(),
            found: RefCell::default(),
        }
    }

    pub(crate) fn add(&self, at: Range<usize>, what: impl Into<String>) {
        let line = self.line_starts.partition_point(|start| *start <= at.start);
        self.found.borrow_mut().push(Problem { line, what: what.into() });
    }

    pub(crate) fn add_missing(
        &self,
        at: Range<usize>,
        key: &str,
        place: &str,
        near_miss: Option<String>,
    ) {
        let hint = near_miss.map_or(String::new(), |found| format!(" (it has `{found}`)"));
        self.add(at, format!("`{key}` is missing in {place}{hint}"));
    }

    pub(crate) fn add_unknown(
        &self,
        at: Range<usize>,
        name: &str,
        suggestion: Option<&str>,
        known: &[&str],
    ) {
        let hint = match suggestion {
            Some(suggestion) => format!("did you mean `{suggestion}`?"),
            None => format!("known here: {}", sorted(known).join(", ")),
        };
        self.add(at, format!("unknown key `{name}`; {hint}"));
    }

    pub(crate) fn none_or<T>(self, value: T) -> Result<T, DescriptionError> {
        if self.found.borrow().is_empty() { Ok(value) } else { Err(self.into_error()) }
    }

    pub(crate) fn into_error(self) -> DescriptionError {
        let mut problems = self.found.into_inner();
        problems.sort_by_key(|problem| problem.line);
        DescriptionError::Wrong { file: self.file, problems }
    }
}

fn sorted<'k>(known: &[&'k str]) -> Vec<&'k str> {
    let mut known = known.to_vec();
    known.sort_unstable();
    known.dedup();
    known
}
