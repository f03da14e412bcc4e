//! `session.json`, the manifest of a session, written last.

use super::{SessionError, Sha256Hex};
use evrig_core::geometry::Size;
use evrig_core::time::{Clock, Davis};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::io::Write;
use std::path::Path;

/// The manifest's schema; a reader refuses all but this and the version before it.
pub const SCHEMA: &str = "evrig.session/2";

/// The former schema, in which a device's `description` has the key `says`.
const FORMER_SCHEMA: &str = "evrig.session/1";

/// The manifest of a session.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Manifest {
    /// [`SCHEMA`].
    pub schema: String,
    /// The directory's name when it was made.
    pub name: String,
    /// Version of evrig that made it.
    pub evrig_version: String,
    /// When it was made, RFC 3339, UTC.
    pub created: String,
    /// Where it came from.
    pub origin: Origin,
    /// Whether everything that was to be recorded was.
    pub status: SessionStatus,
    /// The streams, in the order of their names on the page.
    pub streams: Vec<StreamEntry>,
    /// Size and checksum of every recorded file, by path inside the session.
    pub files: BTreeMap<String, FileEntry>,
    /// Everything that was lost or is doubtful; empty when nothing is.
    pub losses: Vec<DataLoss>,
    /// What an import had to decide about the files it read, and known defects of their layout.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub decisions: Vec<String>,
    /// What it was recorded with; none for what was imported.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub recording: Option<Box<Recording>>,
}

/// What a session was recorded with, and how that went.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Recording {
    /// The rig description as it was used, its whole text.
    pub rig: String,
    /// The trajectory description as it was used, its whole text.
    pub trajectory: String,
    /// The devices, with the settings they read back.
    pub devices: Vec<DeviceEntry>,
    /// The state in which the recording ended, and why.
    pub ended: String,
    /// Host time of the first step, ns of the Unix clock; none if it never came to that.
    pub trajectory_began_ns: Option<i64>,
    /// Discipline of the clocks, as the rig states it and as far as it was measured.
    pub clocks: serde_json::Value,
}

/// One device as it was used.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DeviceEntry {
    /// Its part in the rig.
    pub name: String,
    /// Model, firmware and settings as the device reported and read them back.
    #[serde(alias = "says")]
    pub description: serde_json::Value,
    /// Samples that reached the files.
    pub n_samples: u64,
    /// Samples lost on the way because something was full.
    pub n_dropped: u64,
    /// Why it did not last to the end.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lost: Option<String>,
}

/// Where a session came from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Origin {
    /// A plain DAVIS recording.
    Aedat4 {
        /// Name of the file it was.
        file: String,
    },
    /// A recording in the layout of the published Raw2Event recorder.
    #[serde(rename = "raw2event")]
    Raw2Event {
        /// The part of the names it was found by.
        id: String,
        /// Name of the DAVIS file.
        davis: String,
    },
    /// Frames, with or without events.
    Frames {
        /// Name of the array or directory they were.
        frames: String,
        /// Where their times came from.
        timestamps: String,
        /// Name of the events' file, if there was one.
        events: Option<String>,
    },
    /// A file of another format.
    Converted {
        /// Name of the file or folder it was.
        file: String,
        /// Its format.
        format: String,
    },
    /// Recorded by this program on a rig.
    Recorded {
        /// Name of the rig.
        rig: String,
        /// Name of the trajectory.
        trajectory: String,
    },
}

/// Whether everything that was to be recorded was.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SessionStatus {
    /// Nothing is missing.
    Complete,
    /// The recording was broken off by a person or a fault.
    Aborted,
    /// The recording was cut; what is there was taken up to the cut.
    Recovered,
}

impl std::fmt::Display for SessionStatus {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Complete => "complete",
            Self::Aborted => "aborted",
            Self::Recovered => "recovered",
        })
    }
}

/// Kind of a stream's data.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StreamKind {
    /// Events.
    Events,
    /// Frames.
    Frames,
    /// Inertial samples.
    Imu,
    /// Triggers of the camera.
    Triggers,
    /// Poses of the arm.
    Poses,
    /// Metadata of other streams.
    Metadata,
    /// Readings of two clocks at the same time.
    ClockReadings,
    /// Log of the program.
    Log,
}

impl std::fmt::Display for StreamKind {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Events => "events",
            Self::Frames => "frames",
            Self::Imu => "imu",
            Self::Triggers => "triggers",
            Self::Poses => "poses",
            Self::Metadata => "metadata",
            Self::ClockReadings => "clock",
            Self::Log => "log",
        })
    }
}

/// One stream and the counts found in its file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StreamEntry {
    /// Its name in evrig.
    pub name: String,
    /// Kind of its data.
    pub kind: StreamKind,
    /// Its file, inside the session.
    pub file: String,
    /// Its number in that file, for files of several streams.
    pub stream_id: Option<u32>,
    /// The pixel grid, for events and frames.
    pub size: Option<Size>,
    /// Number of events, frames, samples or edges that can be read.
    pub count: u64,
    /// First stamp, µs of the stream's clock.
    pub first_us: Option<i64>,
    /// Last stamp, µs of the stream's clock.
    pub last_us: Option<i64>,
    /// The clock of its stamps: `davis`, or `pi-sensor` for the Pi's.
    #[serde(default = "davis_clock")]
    pub clock: String,
    /// The camera or program that made it, as stated in the file.
    pub source: String,
}

fn davis_clock() -> String {
    Davis::NAME.into()
}

/// A recorded file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct FileEntry {
    /// Its length.
    pub bytes: u64,
    /// Its SHA-256, lower-case hexadecimal.
    pub sha256: Sha256Hex,
    /// Where reading had to stop, for a file that is cut or damaged.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub damage: Option<Damage>,
}

/// Where reading a file had to stop.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Damage {
    /// Description of the damage, with offset and packet.
    pub what: String,
}

/// Something that was lost, dropped or is doubtful.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct DataLoss {
    /// The stream, or the file where the stream is unknown.
    pub stream: String,
    /// Description.
    pub what: String,
    /// Number of events, frames or packets; 0 where it is unknown.
    pub count: u64,
}

impl Manifest {
    /// The manifest of the session at `root`, made now by this version.
    pub(crate) fn new(
        root: &Path,
        origin: Origin,
        status: SessionStatus,
        streams: Vec<StreamEntry>,
        files: impl IntoIterator<Item = (String, FileEntry)>,
        losses: Vec<DataLoss>,
    ) -> Self {
        Self {
            schema: SCHEMA.into(),
            name: file_name(root),
            evrig_version: env!("CARGO_PKG_VERSION").into(),
            created: chrono::Utc::now().to_rfc3339_opts(chrono::SecondsFormat::Secs, true),
            origin,
            status,
            streams,
            files: files.into_iter().collect(),
            losses,
            decisions: Vec::new(),
            recording: None,
        }
    }

    /// Reads and checks a manifest.
    ///
    /// # Errors
    /// When it cannot be read, is not a manifest, or is of a newer schema.
    pub fn read(path: &Path) -> Result<Self, SessionError> {
        let text = std::fs::read_to_string(path).map_err(SessionError::io(path))?;
        let wrong = |what: String| SessionError::Manifest { path: path.to_owned(), what };
        let value: serde_json::Value =
            serde_json::from_str(&text).map_err(|e| wrong(format!("not JSON: {e}")))?;
        let schema = value.get("schema").and_then(|schema| schema.as_str()).unwrap_or("none");
        if ![SCHEMA, FORMER_SCHEMA].contains(&schema) {
            return Err(wrong(format!(
                "schema is `{schema}`, this evrig reads `{SCHEMA}`; use the evrig that made it or \
                 a newer one"
            )));
        }
        let read: Self =
            serde_json::from_value(value).map_err(|e| wrong(format!("not a manifest: {e}")))?;
        Ok(Self { schema: SCHEMA.into(), ..read })
    }

    /// Seals the session: writes the manifest atomically.
    ///
    /// # Errors
    /// When writing fails.
    pub fn seal(&self, path: &Path) -> Result<(), SessionError> {
        let text = serde_json::to_string_pretty(self)
            .map_err(|e| SessionError::Manifest { path: path.to_owned(), what: e.to_string() })?;
        write_whole(path, text.as_bytes())
    }
}

/// The last part of a path, as text for the manifest.
pub(crate) fn file_name(path: &Path) -> String {
    path.file_name().map_or_else(|| path.display().to_string(), |n| n.to_string_lossy().into())
}

/// Writes a file atomically: to a temporary file, which is synced and renamed.
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), SessionError> {
    let beside = path.with_extension("partial");
    let write = || {
        let mut file = std::fs::File::create(&beside)?;
        file.write_all(bytes)?;
        file.write_all(b"\n")?;
        file.sync_all()?;
        std::fs::rename(&beside, path)?;
        sync_folder_of(path)
    };
    write().map_err(SessionError::io(path))
}

/// Syncs the directory of a new file.
pub(super) fn sync_folder_of(path: &Path) -> std::io::Result<()> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    std::fs::File::open(folder.unwrap_or(Path::new(".")))?.sync_all()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_manifest_of_the_former_schema_is_read_and_a_newer_one_is_refused() {
        let text = |schema: &str, key: &str| {
            let device = serde_json::json!({
                "name": "davis", key: {"source": "usb"}, "n_samples": 3, "n_dropped": 0,
            });
            serde_json::json!({
                "schema": schema, "name": "s", "evrig_version": "0", "created": "",
                "origin": {"kind": "recorded", "rig": "sim", "trajectory": "line"},
                "status": "complete", "streams": [], "files": {}, "losses": [],
                "recording": {
                    "rig": "", "trajectory": "", "devices": [device], "ended": "complete",
                    "trajectory_began_ns": null, "clocks": null,
                },
            })
            .to_string()
        };
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("session.json");
        for (schema, key) in [(SCHEMA, "description"), (FORMER_SCHEMA, "says")] {
            std::fs::write(&path, text(schema, key)).unwrap();
            let manifest = Manifest::read(&path).unwrap();
            assert_eq!(manifest.schema, SCHEMA);
            assert_eq!(manifest.recording.unwrap().devices[0].description["source"], "usb");
        }
        std::fs::write(&path, text("evrig.session/3", "description")).unwrap();
        assert!(Manifest::read(&path).unwrap_err().to_string().contains(SCHEMA));
    }
}
