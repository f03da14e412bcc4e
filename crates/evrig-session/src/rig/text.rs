//! Where a description's text comes from: a file, or what the program carries.

use super::problems::DescriptionError;
use std::path::Path;

/// Largest description file; a larger one is not a description.
const MAX_BYTES: u64 = 1 << 20;

/// Reads a text file of bounded size.
pub fn read_text(path: &Path) -> Result<String, DescriptionError> {
    let unreadable =
        |source| DescriptionError::Unreadable { path: path.display().to_string(), source };
    let length = std::fs::metadata(path).map_err(unreadable)?.len();
    if length > MAX_BYTES {
        let path = path.display().to_string();
        return Err(DescriptionError::TooLong { path, length, limit: MAX_BYTES });
    }
    std::fs::read_to_string(path).map_err(unreadable)
}

/// The file a user named, or else the bundled description of that name: its name in messages and
/// its text.
pub fn find_text(
    what: &'static str,
    named: &str,
    bundled: &[(&'static str, &'static str, &'static str)],
) -> Result<(String, String), DescriptionError> {
    let path = Path::new(named);
    if path.is_file() {
        return Ok((named.to_owned(), read_text(path)?));
    }
    match bundled.iter().find(|(name, _, _)| *name == named) {
        Some((_, file, text)) => Ok(((*file).to_owned(), (*text).to_owned())),
        None => Err(DescriptionError::UnknownName {
            what,
            name: named.to_owned(),
            known: bundled.iter().map(|(name, _, _)| *name).collect(),
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_that_is_not_there_is_named() {
        let error = read_text(Path::new("no/such/rig.toml")).unwrap_err();
        assert!(error.to_string().contains("no/such/rig.toml"), "{error}");
    }
}
