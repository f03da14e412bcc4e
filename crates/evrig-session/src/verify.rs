//! Verification: checksums and counts of a session are recomputed from its files.

use super::file_counts::{StreamCounts, stream_names};
use super::rig_log::{self, RigLogCounts};
use super::{
    RigLogError, Session, SessionError, StreamEntry, StreamKind, count_file, read_stage,
    sha256_of_file,
};
use evrig_core::finding::Finding;
use evrig_format::npy::ArrayReader;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::Path;

/// The findings of a session.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct Verification {
    /// One finding per claim.
    pub findings: Vec<Finding>,
}

impl Verification {
    /// Whether every claim holds.
    #[must_use]
    pub fn holds(&self) -> bool {
        self.findings.iter().all(Finding::holds)
    }

    fn hold(&mut self, subject: &str, description: String) {
        self.findings.push(Finding::good(subject, description));
    }

    fn fail(&mut self, subject: &str, description: String) {
        self.findings.push(Finding::bad(subject, description));
    }
}

/// Recomputes checksums and counts of a session, recorded and derived.
///
/// # Errors
/// When the manifest points outside the session; files that are missing, cut or changed are
/// findings.
pub fn verify(session: &Session) -> Result<Verification, SessionError> {
    let mut verification = Verification::default();
    for (name, entry) in &session.manifest().files {
        let path = session.layout().inside(name)?;
        match sha256_of_file(&path) {
            Err(error) => verification.fail(name, error.to_string()),
            Ok((sha256, bytes)) if sha256 == entry.sha256 && bytes == entry.bytes => {
                verification.hold(name, format!("{bytes} bytes, checksum as recorded"));
            }
            Ok((_, bytes)) if bytes != entry.bytes => verification
                .fail(name, format!("{} bytes were recorded, {bytes} are there", entry.bytes)),
            Ok((sha256, _)) => verification
                .fail(name, format!("checksum {} was recorded, {sha256} is there", entry.sha256)),
        }
    }
    count_streams(session, &mut verification)?;
    check_derived(session, &mut verification);
    Ok(verification)
}

fn count_streams(session: &Session, verification: &mut Verification) -> Result<(), SessionError> {
    let mut counted: BTreeMap<&str, Vec<StreamCounts>> = BTreeMap::new();
    let mut logs = BTreeMap::new();
    for entry in &session.manifest().streams {
        let path = session.layout().inside(&entry.file)?;
        if entry.file.ends_with(".npy") {
            compare_array(&path, entry, verification);
            continue;
        }
        if entry.file.ends_with(".mcap") {
            let held = logs.entry(entry.file.clone()).or_insert_with(|| rig_log::count_log(&path));
            compare_log(held, entry, verification);
            continue;
        }
        if !counted.contains_key(entry.file.as_str()) {
            match count_file(&path, &mut |_| {}) {
                Ok(found) => {
                    counted.insert(&entry.file, found.streams);
                }
                Err(error) => verification.fail(&entry.name, error.to_string()),
            }
        }
        let Some(streams) = counted.get(entry.file.as_str()) else { continue };
        let found = streams.iter().find(|found| entry.stream_id == Some(found.stream.id));
        match found {
            Some(found) => compare_counts(entry, found, verification),
            None => {
                let held = stream_names(streams).join(", ");
                verification
                    .fail(&entry.name, format!("is not in {}, which holds: {held}", entry.file));
            }
        }
    }
    Ok(())
}

fn compare_log(
    held: &Result<RigLogCounts, RigLogError>,
    entry: &StreamEntry,
    verification: &mut Verification,
) {
    let held = match held {
        Ok(held) => held,
        Err(error) => return verification.fail(&entry.name, error.to_string()),
    };
    let found = held.topics.iter().find(|found| rig_log::stream_names(found.topic).0 == entry.name);
    let there = found.map_or((0, None, None), |it| (it.count, it.first_us, it.last_us));
    compare_extent(entry, "log time", there, verification);
}

fn compare_counts(entry: &StreamEntry, found: &StreamCounts, verification: &mut Verification) {
    let there = (found.count, found.first_us, found.last_us);
    compare_extent(entry, "stamp", there, verification);
}

/// Compares the number of samples with their first and last times, microseconds.
fn compare_extent(
    entry: &StreamEntry,
    time: &str,
    there: (u64, Option<i64>, Option<i64>),
    verification: &mut Verification,
) {
    let recorded = (entry.count, entry.first_us, entry.last_us);
    if recorded == there {
        let text = format!("{} {}, first and last {time} as recorded", entry.count, entry.kind);
        return verification.hold(&entry.name, text);
    }
    let text = |(count, first, last): (u64, Option<i64>, Option<i64>)| {
        let us = |time: Option<i64>| time.map_or("none".to_owned(), |time| time.to_string());
        format!("{count}, first at {} us, last at {} us", us(first), us(last))
    };
    let text = format!("recorded were {}; found {}", text(recorded), text(there));
    verification.fail(&entry.name, text);
}

fn compare_array(path: &Path, entry: &StreamEntry, verification: &mut Verification) {
    let shape = ArrayReader::open(path).map(|reader| reader.shape().to_vec());
    match shape {
        Ok(shape) if entry.kind == StreamKind::Frames && shape.first() == Some(&entry.count) => {
            verification.hold(&entry.name, format!("{} frames as recorded", entry.count));
        }
        Ok(shape) => verification.fail(
            &entry.name,
            format!("{} {} were recorded, the array has shape {shape:?}", entry.count, entry.kind),
        ),
        Err(error) => verification.fail(&entry.name, error.to_string()),
    }
}

fn check_derived(session: &Session, verification: &mut Verification) {
    let derived = session.root().join("derived");
    let entries = std::fs::read_dir(&derived).into_iter().flatten().flatten();
    // The lock file of a running `process` is next to the stages' directories.
    let mut directories: Vec<_> =
        entries.map(|entry| entry.path()).filter(|path| path.is_dir()).collect();
    directories.sort();
    for directory in directories {
        let folder = directory.file_name().map(|name| name.to_string_lossy().into_owned());
        let subject = format!("derived/{}", folder.unwrap_or_default());
        let Some(record) = read_stage(&directory) else {
            verification.fail(&subject, "has no stage.json; run the stage again".into());
            continue;
        };
        for (name, expected) in &record.outputs {
            let subject = format!("{subject}/{name}");
            match sha256_of_file(&directory.join(name)) {
                Ok((sha256, _)) if sha256 == *expected => {
                    verification.hold(&subject, "checksum as its stage wrote it".into());
                }
                Ok(_) => verification.fail(&subject, "was changed since its stage wrote it".into()),
                Err(error) => verification.fail(&subject, error.to_string()),
            }
        }
    }
}
