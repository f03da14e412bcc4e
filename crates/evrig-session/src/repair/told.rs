//! What the journal of a recording tells.

use crate::{Loss, SessionError};
use serde::Deserialize;
use serde_json::Value;
use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;

/// A line longer than this is damage.
const MAX_LINE_BYTES: u64 = 16 << 20;

/// The recorder's states, as its journal names them.
const STATES: [&str; 8] =
    ["preflight", "start pose", "cameras", "lead-in", "trajectory", "tail", "drain", "seal"];

/// A description as it was used.
#[derive(Debug, Clone, Default, PartialEq, Eq, Deserialize)]
pub(super) struct Described {
    pub(super) name: String,
    pub(super) text: String,
}

/// Everything the journal says of its recording.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Told {
    pub(super) rig: Described,
    pub(super) trajectory: Described,
    pub(super) clocks: Value,
    /// Devices that were set up, with what they said of themselves.
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

impl Told {
    /// Reads a journal; lines that are cut or damaged are counted and left out.
    pub(super) fn read(path: &Path) -> Result<Self, SessionError> {
        let mut told = Self {
            rig: Described::default(),
            trajectory: Described::default(),
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
                return Ok(told);
            }
            match serde_json::from_slice(&line) {
                Ok(entry) => told.take(&entry),
                Err(_) if line.iter().all(u8::is_ascii_whitespace) => {}
                Err(_) => told.n_unreadable += 1,
            }
        }
    }

    fn take(&mut self, entry: &Value) {
        let described = |key: &str| Described::deserialize(&entry[key]).unwrap_or_default();
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
                self.devices.push((name, entry["says"].clone()));
            }
            "first step" => self.began_ns = entry["unix_ns"].as_i64(),
            state if STATES.contains(&state) => self.state = state.to_owned(),
            _ => {}
        }
    }

    /// What could not be read of the journal.
    pub(super) fn losses(&self) -> Option<Loss> {
        let what = "lines that are cut or damaged and were left out".to_owned();
        let loss = Loss { stream: "journal.jsonl".into(), what, count: self.n_unreadable };
        (self.n_unreadable > 0).then_some(loss)
    }
}
