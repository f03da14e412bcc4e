//! Repair: writes the manifest of a recording that was interrupted.
//!
//! Recorded files stay as they are. They are counted up to where they can be read, and what the
//! journal states of rig, trajectory and devices goes into a manifest of status `recovered` whose
//! losses name the cut.

mod journal_summary;

use super::rig_log;
use super::{
    DataLoss, DeviceEntry, Journal, Manifest, Origin, Recording, Session, SessionError,
    SessionLayout, SessionStatus, StreamKind, count_file, seal_recording, verify,
};
use journal_summary::JournalSummary;
use serde_json::json;
use std::path::Path;

/// What a repair found and did.
#[derive(Debug, Clone, PartialEq)]
pub enum Repair {
    /// The session is sealed and everything it claims holds.
    NotNeeded,
    /// It was sealed again.
    Resealed(Box<Manifest>),
}

/// Seals a session whose recorder died.
///
/// # Errors
/// When the directory holds no recording, is being recorded, is of a newer schema, or was sealed
/// and has been changed since: that is no cut, and a new seal would hide it.
pub fn repair(root: &Path) -> Result<Repair, SessionError> {
    let layout = SessionLayout::new(root);
    if is_sealed(&layout)? {
        let session = Session::open(root)?;
        if verify(&session)?.holds() {
            return Ok(Repair::NotNeeded);
        }
        return Err(SessionError::Manifest {
            path: layout.manifest(),
            what: "the session was sealed and its files have changed since (see `evrig verify`); \
                   a new seal would hide that, so restore them from a copy"
                .into(),
        });
    }
    if !layout.journal().exists() {
        return Err(SessionError::NotASession {
            root: root.to_owned(),
            what: "it has neither session.json nor journal.jsonl, so nothing was recorded in it"
                .into(),
        });
    }
    // Held until the end: a recorder that is alive has the journal, and so is left alone.
    let mut journal = Journal::open(&layout.journal())?;
    let summary = JournalSummary::read(&layout.journal())?;
    let mut losses = vec![DataLoss {
        stream: "recording".into(),
        what: format!(
            "cut off in state {}, after {}; what had not reached the disk by then is missing, at \
             most the last second",
            summary.state, summary.last_at
        ),
        count: 0,
    }];
    losses.extend(summary.losses());
    losses.extend(set_aside(&layout)?);
    losses.extend(arrived_but_missing(&layout)?);
    let origin = Origin::Recorded {
        rig: summary.rig.name.clone(),
        trajectory: summary.trajectory.name.clone(),
    };
    let recording = recording(&layout, summary)?;
    journal.note("repair", &json!({"losses": losses}))?;
    let manifest = seal_recording(&layout, origin, SessionStatus::Recovered, recording, losses)?;
    Ok(Repair::Resealed(Box::new(manifest)))
}

/// Whether there is a manifest: one of another schema is an error, one that is no JSON is none.
fn is_sealed(layout: &SessionLayout) -> Result<bool, SessionError> {
    let path = layout.manifest();
    let text = match std::fs::read(&path) {
        Ok(text) => text,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(false),
        Err(source) => return Err(SessionError::Io { path, source }),
    };
    if serde_json::from_slice::<serde_json::Value>(&text).is_err() {
        return Ok(false);
    }
    Manifest::read(&path).map(|_| true)
}

/// Removes an incomplete manifest; renames one that cannot be read.
fn set_aside(layout: &SessionLayout) -> Result<Option<DataLoss>, SessionError> {
    let partial = layout.manifest().with_extension("partial");
    if partial.exists() {
        std::fs::remove_file(&partial).map_err(SessionError::io(&partial))?;
    }
    let path = layout.manifest();
    if !path.exists() {
        return Ok(None);
    }
    let aside = path.with_extension("json.damaged");
    std::fs::rename(&path, &aside).map_err(SessionError::io(&path))?;
    let what = "could not be read and is kept as session.json.damaged".into();
    Ok(Some(DataLoss { stream: "session.json".into(), what, count: 0 }))
}

/// Events and samples of the event camera that are logged as arrived and missing from its file.
fn arrived_but_missing(layout: &SessionLayout) -> Result<Vec<DataLoss>, SessionError> {
    if !layout.rig_log().exists() {
        return Ok(Vec::new());
    }
    let arrivals = rig_log::arrivals(&layout.rig_log())?;
    // An unreadable file holds none of them.
    let held =
        count_file(&layout.davis(), &mut |_| {}).map(|found| found.streams).unwrap_or_default();
    let mut losses = Vec::new();
    for (stream, counted) in arrivals {
        let found = held.iter().find(|found| found.stream.id == stream);
        let n_held = found.map_or(0, |found| found.count);
        let count = counted.saturating_sub(n_held);
        if count > 0 {
            let what = format!("stream {stream}: had arrived, but had not reached the file");
            losses.push(DataLoss { stream: "davis.aedat4".into(), what, count });
        }
    }
    Ok(losses)
}

/// The manifest's entry of the recording, as far as the journal states it.
fn recording(layout: &SessionLayout, summary: JournalSummary) -> Result<Recording, SessionError> {
    let counts = match layout.rig_log().exists() {
        true => rig_log::count_log(&layout.rig_log())?.topics,
        false => Vec::new(),
    };
    let n_messages = |name: &str| {
        let topic = match name {
            "davis" => "davis-arrivals",
            "pi" => "pi-metadata",
            _ => return 0,
        };
        let expected = (topic, StreamKind::Metadata);
        let found = counts.iter().find(|found| rig_log::stream_names(found.topic) == expected);
        found.map_or(0, |found| found.count)
    };
    let device = |(name, description): (String, serde_json::Value)| DeviceEntry {
        n_samples: n_messages(&name),
        name,
        description,
        n_dropped: 0,
        lost: Some("the recorder died; what the device dropped is not known".into()),
    };
    Ok(Recording {
        rig: summary.rig.text,
        trajectory: summary.trajectory.text,
        devices: summary.devices.into_iter().map(device).collect(),
        ended: format!("cut off in state {}", summary.state),
        trajectory_began_ns: summary.began_ns,
        clocks: summary.clocks,
    })
}

#[cfg(test)]
mod tests;
