//! The state of a recording as its journal states it.

use crate::{DataLoss, SessionError};
use serde::Deserialize;
use serde_json::Value;
use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;

/// A line longer than this is damage.
const MAX_LINE_BYTES: u64 = 16 << 20;

/// The recorder's states, as its journal names them.
const RECORDER_STATES: [&str; 8] =
    ["preflight", "start pose", "cameras", "lead-in", "trajectory", "tail", "drain", "seal"];

/// A description as it was used.
#[derive(Debug, Clone, Default, PartialEq, Eq, Deserialize)]
pub(super) struct DescriptionText {
    pub(super) name: String,
    pub(super) text: String,
}

/// What the journal states of its recording.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct JournalSummary {
    pub(super) rig: DescriptionText,
    pub(super) trajectory: DescriptionText,
    pub(super) clocks: Value,
    /// Devices that were set up, with their descriptions.
    pub(super) devices: Vec<(String, Value)>,
    /// Host time of the first step, ns of the Unix clock.
    pub(super) began_ns: Option<i64>,
    /// The last state that was entered.
    pub(super) state: String,
    /// When the last line was written.
    pub(super) last_at: String,
    /// Lines that cannot be read.
    n_unreadable: u64,
}

impl JournalSummary {
    /// Reads a journal; lines that are cut or damaged are counted and left out.
    pub(super) fn read(path: &Path) -> Result<Self, SessionError> {
        let mut summary = Self {
            rig: DescriptionText::default(),
            trajectory: DescriptionText::default(),
            clocks: Value::Null,
            devices: Vec::new(),
            began_ns: None,
            state: "preflight".into(),
            last_at: "a time that is not known".into(),
            n_unreadable: 0,
        };
        let file = File::open(path).map_err(SessionError::io(path))?;
        let mut reader = BufReader::new(file);
        let mut line = Vec::new();
        loop {
            line.clear();
            let n = reader
                .by_ref()
                .take(MAX_LINE_BYTES)
                .read_until(b'\n', &mut line)
                .map_err(SessionError::io(path))?;
            if n == 0 {
                return Ok(summary);
            }
            match serde_json::from_slice(&line) {
                Ok(entry) => summary.take(&entry),
                Err(_) if line.iter().all(u8::is_ascii_whitespace) => {}
                Err(_) => summary.n_unreadable += 1,
            }
        }
    }

    fn take(&mut self, entry: &Value) {
        let described = |key: &str| DescriptionText::deserialize(&entry[key]).unwrap_or_default();
        if let Some(at) = entry["at"].as_str() {
            self.last_at = at.to_owned();
        }
        match entry["what"].as_str().unwrap_or_default() {
            "recording" => {
                self.rig = described("rig");
                self.trajectory = described("trajectory");
                self.clocks = entry["clocks"].clone();
            }
            "device" => {
                let name = entry["name"].as_str().unwrap_or_default().to_owned();
                // Journals of evrig.session/1 have the key `says`.
                let description = entry.get("description").or_else(|| entry.get("says"));
                self.devices.push((name, description.cloned().unwrap_or_default()));
            }
            "first step" => self.began_ns = entry["unix_ns"].as_i64(),
            state if RECORDER_STATES.contains(&state) => self.state = state.to_owned(),
            _ => {}
        }
    }

    /// What could not be read of the journal.
    pub(super) fn losses(&self) -> Option<DataLoss> {
        let what = "lines that are cut or damaged and were left out".to_owned();
        let loss = DataLoss { stream: "journal.jsonl".into(), what, count: self.n_unreadable };
        (self.n_unreadable > 0).then_some(loss)
    }
}
