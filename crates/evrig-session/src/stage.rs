//! `stage.json`: inputs, parameters and outputs of a derived result.

use super::manifest::write_whole;
use super::{SessionError, Sha256Hex, sha256_of_file};
use evrig_core::stats::read_value;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::Path;

/// Inputs, parameters and outputs of one run of one stage.
///
/// It holds no time and no path, so that equal inputs give equal bytes on every machine.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StageRecord {
    /// `evrig.stage/1`.
    pub schema: String,
    /// The stage's name.
    pub stage: String,
    /// The stream it generated or analysed.
    pub stream: Option<String>,
    /// Version of evrig that ran it.
    pub evrig_version: String,
    /// SHA-256 of every input, by path inside the session.
    pub inputs: BTreeMap<String, Sha256Hex>,
    /// Every parameter, the seed among them.
    pub parameters: Value,
    /// SHA-256 of every output, by name inside the stage's directory.
    pub outputs: BTreeMap<String, Sha256Hex>,
    /// Counts: what went in, what came out, what was left out and why.
    pub tally: Value,
}

impl StageRecord {
    /// A record without outputs yet.
    #[must_use]
    pub fn new(
        stage: &str,
        stream: Option<&str>,
        inputs: BTreeMap<String, Sha256Hex>,
        parameters: Value,
    ) -> Self {
        Self {
            schema: "evrig.stage/1".into(),
            stage: stage.into(),
            stream: stream.map(str::to_owned),
            evrig_version: env!("CARGO_PKG_VERSION").into(),
            inputs,
            parameters,
            outputs: BTreeMap::new(),
            tally: Value::Null,
        }
    }

    /// What the stage counted.
    ///
    /// # Errors
    /// When it is none of this stage's.
    pub fn tally_as<T: DeserializeOwned>(&self) -> Result<T, serde_json::Error> {
        read_value(self.tally.clone())
    }

    /// Whether `other` is the record of the same stage run on the same inputs with the same
    /// parameters by the same version.
    #[must_use]
    pub fn is_same_run(&self, other: &Self) -> bool {
        self.schema == other.schema
            && self.stage == other.stage
            && self.stream == other.stream
            && self.evrig_version == other.evrig_version
            && self.inputs == other.inputs
            && self.parameters == other.parameters
    }
}

/// The record of a stage's directory; `None` when there is none or it cannot be read,
/// which makes the stage stale.
#[must_use]
pub fn read_stage(directory: &Path) -> Option<StageRecord> {
    let text = std::fs::read_to_string(directory.join("stage.json")).ok()?;
    serde_json::from_str(&text).ok()
}

/// Adds the checksums of the named outputs and writes the record, last of all.
///
/// # Errors
/// When an output cannot be read or writing fails.
pub fn write_stage(
    directory: &Path,
    mut record: StageRecord,
    outputs: &[&str],
) -> Result<StageRecord, SessionError> {
    for &name in outputs {
        let (sha256, _) = sha256_of_file(&directory.join(name))?;
        record.outputs.insert(name.to_owned(), sha256);
    }
    let path = directory.join("stage.json");
    let text = serde_json::to_string_pretty(&record)
        .map_err(|e| SessionError::Manifest { path: path.clone(), what: e.to_string() })?;
    write_whole(&path, text.as_bytes())?;
    Ok(record)
}
