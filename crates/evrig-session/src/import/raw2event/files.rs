//! Which files belong together: by their tag, then by the nearest time.

use crate::SessionError;
use crate::manifest::file_name;
use chrono::NaiveDateTime;
use std::path::{Path, PathBuf};

/// The files of one recording.
#[derive(Debug)]
pub(super) struct RecordingFiles {
    pub(super) davis: PathBuf,
    pub(super) metadata: PathBuf,
    pub(super) raw: Option<PathBuf>,
    pub(super) rgb: Option<PathBuf>,
    /// How the choice was made.
    pub(super) decisions: Vec<String>,
}

/// A file of the layout: `<kind>_<tag>_<time><ending>`.
#[derive(Debug, Clone)]
struct NamedFile {
    path: PathBuf,
    tag: String,
    time: Option<NaiveDateTime>,
}

/// Reads a name; the time is the last 15 characters, `20250601_170406`.
fn named(path: &Path, kind: &str, ending: &str) -> Option<NamedFile> {
    let name = file_name(path);
    let rest = name.strip_prefix(kind)?.strip_suffix(ending)?;
    let split = rest.len().checked_sub(15).filter(|at| rest.is_char_boundary(*at));
    let time =
        split.and_then(|at| NaiveDateTime::parse_from_str(&rest[at..], "%Y%m%d_%H%M%S").ok());
    let tag = match (time, split) {
        (Some(_), Some(at)) => rest[..at].trim_end_matches('_'),
        _ => rest,
    };
    Some(NamedFile { path: path.to_owned(), tag: tag.to_owned(), time })
}

impl RecordingFiles {
    pub(super) fn find(directory: &Path, id: &str) -> Result<Self, SessionError> {
        let entries = std::fs::read_dir(directory).map_err(SessionError::io(directory))?;
        let mut paths: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).collect();
        paths.sort();
        let of_kind = |kind: &str, ending: &str| -> Vec<NamedFile> {
            paths.iter().filter_map(|path| named(path, kind, ending)).collect()
        };
        let recordings = of_kind("dv_output_", ".aedat4");
        let pi: Vec<Vec<NamedFile>> = ["metadata_", "raw_frames_", "rgb_frames_"]
            .iter()
            .map(|kind| of_kind(kind, ".dat"))
            .collect();
        let davis = choose(directory, id, &recordings, &pi[0])?;
        let mut decisions = Vec::new();
        let mut nearest = |files: &[NamedFile]| -> Option<PathBuf> {
            let same_tag = files.iter().filter(|file| file.tag == davis.tag);
            let apart = |file: &&NamedFile| match (file.time, davis.time) {
                (Some(a), Some(b)) => (a - b).num_seconds().abs(),
                _ => i64::MAX,
            };
            let found = same_tag.min_by_key(apart)?;
            let seconds = apart(&found);
            let by = if seconds == i64::MAX {
                "by tag".into()
            } else {
                format!("by tag, {seconds} s apart")
            };
            decisions.push(format!(
                "{} belongs to {} ({by})",
                file_name(&found.path),
                file_name(&davis.path)
            ));
            Some(found.path.clone())
        };
        let metadata = nearest(&pi[0]);
        let raw = nearest(&pi[1]);
        let rgb = nearest(&pi[2]);
        let metadata = metadata.ok_or_else(|| {
            let what = format!("holds no metadata_*.dat with the tag `{}`", davis.tag);
            SessionError::import(directory, what)
        })?;
        Ok(Self { davis: davis.path, metadata, raw, rgb, decisions })
    }
}

/// The one recording whose DAVIS file, or whose metadata, has `id` in its name.
fn choose(
    directory: &Path,
    id: &str,
    recordings: &[NamedFile],
    metadata: &[NamedFile],
) -> Result<NamedFile, SessionError> {
    let has_id = |file: &&NamedFile| file_name(&file.path).contains(id);
    let mut found: Vec<&NamedFile> = recordings.iter().filter(has_id).collect();
    if found.is_empty() {
        // Host and Pi name their files by their own clocks: the id may be the Pi's time.
        let tags: Vec<&NamedFile> = metadata.iter().filter(has_id).collect();
        let same_tag = |file: &&NamedFile| tags.iter().any(|tag| tag.tag == file.tag);
        found = recordings.iter().filter(same_tag).collect();
        if let (true, [tag]) = (found.len() > 1, tags.as_slice()) {
            let apart = |file: &&NamedFile| match (file.time, tag.time) {
                (Some(a), Some(b)) => (a - b).num_seconds().abs(),
                _ => i64::MAX,
            };
            found = found.into_iter().min_by_key(apart).into_iter().collect();
        }
    }
    match found.as_slice() {
        [only] => Ok((*only).clone()),
        [] => {
            let known: Vec<String> = recordings.iter().map(|file| file_name(&file.path)).collect();
            let what =
                format!("no recording has `{id}` in its name; there are: {}", known.join(", "));
            Err(SessionError::import(directory, what))
        }
        several => {
            let names: Vec<String> = several.iter().map(|file| file_name(&file.path)).collect();
            let what =
                format!("`{id}` matches several names; give a longer part: {}", names.join(", "));
            Err(SessionError::import(directory, what))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_is_kind_tag_and_time() {
        let path = Path::new("/d/raw_frames_3_cat_00017_20250601_170406.dat");
        let file = named(path, "raw_frames_", ".dat").unwrap();
        assert_eq!(file.tag, "3_cat_00017");
        assert_eq!(file.time.unwrap().to_string(), "2025-06-01 17:04:06");
        assert!(named(path, "rgb_frames_", ".dat").is_none());
        let untimed = named(Path::new("metadata_x.dat"), "metadata_", ".dat").unwrap();
        assert_eq!((untimed.tag.as_str(), untimed.time), ("x", None));
    }
}
