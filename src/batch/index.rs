//! `dataset.json`: what is in a dataset, session by session.

use super::{
    BatchError, FoundSession, OutcomeKind, SplitBy, SplitShare, Splits, read_outcome, stimulus,
};
use crate::pipeline::read_diagnosis;
use evrig_analysis::diagnose;
use evrig_core::effect_id::EffectId;
use evrig_generate::GenerateParameters;
use evrig_session::{
    DataLoss, Manifest, Origin, Session, SessionStatus, StreamKind, read_stage, sha256_of_bytes,
    write_whole,
};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;

/// The index of a dataset.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Index {
    /// `evrig.dataset/1`.
    pub schema: String,
    /// The directory's name.
    pub name: String,
    /// The version that wrote it.
    pub evrig_version: String,
    /// How it was asked to be split.
    pub shares: Vec<SplitShare>,
    /// What no two parts have in common.
    #[serde(default)]
    pub split_by: SplitBy,
    /// Seed of the split.
    #[serde(default)]
    pub split_seed: u64,
    /// The sessions' paths by the name of their part.
    pub splits: BTreeMap<String, Vec<String>>,
    /// The rigs, the most used first.
    pub rigs: Vec<IndexedRig>,
    /// What a reader should know before taking means over it.
    pub warnings: Vec<String>,
    /// The sessions in the order of their paths.
    pub sessions: Vec<IndexedSession>,
}

/// A set-up that sessions were recorded with.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct IndexedRig {
    /// Its name and the beginning of its description's SHA-256; of an import, what it came from.
    pub id: String,
    /// How many sessions.
    pub n_sessions: u64,
}

/// A session in the index.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct IndexedSession {
    /// Its path in the dataset.
    pub path: String,
    /// The version of evrig that made it; empty where it cannot be read.
    pub made_by: String,
    /// Whether everything that was to be recorded was.
    pub status: Option<SessionStatus>,
    /// The rig, as in [`Index::rigs`].
    pub rig: Option<String>,
    /// The trajectory it was recorded along.
    pub trajectory: Option<String>,
    /// SHA-256 of the image that was shown; none where the session states none.
    #[serde(default)]
    pub stimulus: Option<String>,
    /// The part it is in.
    pub split: Option<String>,
    /// From the first to the last stamp of its real events or frames, seconds.
    pub duration_s: Option<f64>,
    /// Its streams, recorded and generated.
    pub streams: Vec<IndexedStream>,
    /// What the recording lost.
    pub losses: Vec<DataLoss>,
    /// The diagnosis's word: `no_mismatch`, `explained`, ...; none if it was not diagnosed.
    pub diagnosis: Option<diagnose::DiagnosisVerdict>,
    /// The effects it named.
    pub effects: Vec<NamedEffect>,
    /// How its last processing went; none if there was none.
    pub verdict: Option<OutcomeKind>,
    /// What was lost, or why it failed.
    pub because: Vec<String>,
}

/// An effect that a session's diagnosis named.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct NamedEffect {
    /// Its id.
    pub id: EffectId,
    /// Its gain on held-out events, nats per event.
    pub heldout_gain_nats_per_event: f64,
    /// Its parameters.
    pub parameters: BTreeMap<String, f64>,
}

/// A stream in the index.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct IndexedStream {
    /// Its name.
    pub name: String,
    /// What flows in it.
    pub kind: StreamKind,
    /// `recorded`, or the stage that made it.
    pub made_by: String,
    /// Events, frames or samples.
    pub count: u64,
    /// Of generated events: the frames or scene they were generated from.
    pub from: Option<String>,
    /// Of generated events: the seed.
    pub seed: Option<u64>,
}

/// Makes the index of what was found.
#[must_use]
pub fn index(root: &Path, found: &[FoundSession], splits: &Splits) -> Index {
    let real = root.canonicalize().unwrap_or_else(|_| root.to_owned());
    let name = real.file_name().map(|name| name.to_string_lossy().into_owned());
    let sessions: Vec<IndexedSession> = found.iter().map(|one| entry(root, one, splits)).collect();
    let mut parts: BTreeMap<String, Vec<String>> =
        splits.shares().iter().map(|share| (share.name.clone(), Vec::new())).collect();
    let mut rigs: BTreeMap<String, u64> = BTreeMap::new();
    for session in &sessions {
        if let Some(split) = &session.split {
            parts.entry(split.clone()).or_default().push(session.path.clone());
        }
        if let Some(rig) = &session.rig {
            *rigs.entry(rig.clone()).or_default() += 1;
        }
    }
    let mut rigs: Vec<IndexedRig> =
        rigs.into_iter().map(|(id, n_sessions)| IndexedRig { id, n_sessions }).collect();
    rigs.sort_by(|a, b| b.n_sessions.cmp(&a.n_sessions).then(a.id.cmp(&b.id)));
    Index {
        schema: "evrig.dataset/1".into(),
        name: name.unwrap_or_default(),
        evrig_version: env!("CARGO_PKG_VERSION").into(),
        shares: splits.shares().to_vec(),
        split_by: splits.by(),
        split_seed: splits.seed(),
        splits: parts,
        warnings: warnings(&sessions, &rigs, splits.by()),
        rigs,
        sessions,
    }
}

fn entry(root: &Path, found: &FoundSession, splits: &Splits) -> IndexedSession {
    let outcome = read_outcome(root, &found.key);
    let mut because = outcome.as_ref().map(|o| o.because.clone()).unwrap_or_default();
    let mut verdict = outcome.map(|outcome| outcome.verdict);
    let mut entry = IndexedSession {
        path: found.key.clone(),
        made_by: String::new(),
        status: None,
        rig: None,
        trajectory: None,
        stimulus: None,
        split: None,
        duration_s: None,
        streams: Vec::new(),
        losses: Vec::new(),
        diagnosis: None,
        effects: Vec::new(),
        verdict: None,
        because: Vec::new(),
    };
    match &found.session {
        Ok(session) => {
            let manifest = session.manifest();
            entry.made_by = manifest.evrig_version.clone();
            entry.status = Some(manifest.status);
            entry.rig = Some(rig(manifest));
            entry.trajectory = match &manifest.origin {
                Origin::Recorded { trajectory, .. } => Some(trajectory.clone()),
                _ => None,
            };
            entry.stimulus = stimulus(manifest).map(str::to_owned);
            entry.split = Some(splits.of(manifest).to_owned());
            entry.duration_s = duration_s(manifest);
            entry.streams = streams(session);
            entry.losses = manifest.losses.clone();
            // A diagnosis that cannot be read is none; `evrig report SESSION` states why.
            if let Ok(Some(diagnosis)) = read_diagnosis(session) {
                entry.diagnosis = Some(diagnosis.verdict);
                entry.effects = diagnosis.effects.iter().map(named).collect();
            }
        }
        Err(error) => {
            verdict = Some(OutcomeKind::Failed);
            because = vec![error.clone()];
        }
    }
    IndexedSession { verdict, because, ..entry }
}

fn named(effect: &diagnose::FittedEffect) -> NamedEffect {
    let parameters = effect.parameters.iter();
    NamedEffect {
        id: effect.id,
        heldout_gain_nats_per_event: effect.heldout_gain_nats_per_event,
        parameters: parameters.map(|(key, interval)| (key.clone(), interval.value)).collect(),
    }
}

/// The rig by name and content: two files of one name are two rigs.
fn rig(manifest: &Manifest) -> String {
    let of_import = |kind: &str| {
        let events = manifest.streams.iter().find(|s| s.kind == StreamKind::Events);
        let size = events.and_then(|stream| stream.size).map(|size| format!(", {size}"));
        format!("{kind}{}", size.unwrap_or_default())
    };
    match (&manifest.origin, &manifest.recording) {
        (Origin::Recorded { rig, .. }, Some(recording)) => {
            let hash = sha256_of_bytes(recording.rig.as_bytes()).to_string();
            format!("{rig} {}", hash.get(..8).unwrap_or(&hash))
        }
        (Origin::Recorded { rig, .. }, None) => rig.clone(),
        (Origin::Aedat4 { .. }, _) => of_import("imported AEDAT4"),
        (Origin::Raw2Event { .. }, _) => of_import("imported Raw2Event"),
        (Origin::Frames { .. }, _) => of_import("imported frames"),
        (Origin::Converted { format, .. }, _) => of_import(&format!("imported {format}")),
    }
}

fn duration_s(manifest: &Manifest) -> Option<f64> {
    let of = |kind| manifest.streams.iter().find(move |stream| stream.kind == kind);
    let stream = of(StreamKind::Events).or_else(|| of(StreamKind::Frames))?;
    let (first, last) = stream.first_us.zip(stream.last_us)?;
    Some(last.saturating_sub(first) as f64 * 1e-6)
}

fn streams(session: &Session) -> Vec<IndexedStream> {
    let recorded = session.manifest().streams.iter().map(|stream| IndexedStream {
        name: stream.name.clone(),
        kind: stream.kind,
        made_by: "recorded".into(),
        count: stream.count,
        from: None,
        seed: None,
    });
    let generated = session.generated_names().into_iter().map(|name| {
        let record = read_stage(&session.layout().derived("generate", Some(&name)));
        let text = |key: &str| Some(record.as_ref()?.parameters.get(key)?.as_str()?.to_owned());
        let parameter = |key: &str| record.as_ref()?.parameters.get(key).cloned();
        let generator: Option<GenerateParameters> =
            parameter("generator").and_then(|value| serde_json::from_value(value).ok());
        let seed = generator.map(|generator| generator.seed);
        IndexedStream {
            count: record.as_ref().and_then(|r| r.tally.get("n_events")?.as_u64()).unwrap_or(0),
            from: text("from"),
            // A diagnosed camera has no parameters of a model.
            seed: seed.or_else(|| parameter("seed")?.as_u64()),
            name: name.to_string(),
            kind: StreamKind::Events,
            made_by: "generate".into(),
        }
    });
    recorded.chain(generated).collect()
}

fn warnings(sessions: &[IndexedSession], rigs: &[IndexedRig], by: SplitBy) -> Vec<String> {
    let mut warnings = Vec::new();
    let is_unstated =
        |session: &&IndexedSession| session.split.is_some() && session.stimulus.is_none();
    let n_unstated = sessions.iter().filter(is_unstated).count();
    if by == SplitBy::Stimulus && n_unstated > 0 {
        warnings.push(format!(
            "{n_unstated} sessions do not state which image was displayed, so that the split \
             counts each as a separate image; `evrig record --images` notes it"
        ));
    }
    if rigs.len() > 1 {
        let names: Vec<String> =
            rigs.iter().map(|rig| format!("{} ({})", rig.id, rig.n_sessions)).collect();
        warnings.push(format!(
            "the dataset mixes sessions of {} rigs: {}; `evrig compare DATASET --rig NAME` \
             selects one",
            rigs.len(),
            names.join("; ")
        ));
    }
    let newer: Vec<&str> = sessions
        .iter()
        .filter(|session| is_newer(&session.made_by))
        .map(|session| session.path.as_str())
        .collect();
    if !newer.is_empty() {
        warnings.push(format!(
            "made by a newer evrig than this one ({}), whose files may contain keys that this one \
             does not read: {}",
            env!("CARGO_PKG_VERSION"),
            newer.join(", ")
        ));
    }
    warnings
}

/// Whether a version is later than ours.
fn is_newer(version: &str) -> bool {
    let numbers = |version: &str| -> Vec<u64> {
        let plain = version.split(['-', '+']).next().unwrap_or("");
        plain.split('.').map(|part| part.parse().unwrap_or(0)).collect()
    };
    numbers(version) > numbers(env!("CARGO_PKG_VERSION"))
}

impl Index {
    /// Writes `dataset.json`, whole or not at all.
    ///
    /// # Errors
    /// When the disk refuses.
    pub fn write(&self, root: &Path) -> Result<(), BatchError> {
        let path = root.join("dataset.json");
        let text = serde_json::to_string_pretty(self)
            .map_err(|e| BatchError::Malformed { path: path.clone(), what: e.to_string() })?;
        Ok(write_whole(&path, text.as_bytes())?)
    }

    /// Sessions with this verdict; `None` counts those never processed.
    #[must_use]
    pub fn n_with(&self, verdict: Option<OutcomeKind>) -> usize {
        self.sessions.iter().filter(|session| session.verdict == verdict).count()
    }

    /// Events, frames or samples of all sessions by stream.
    #[must_use]
    pub fn totals(&self) -> BTreeMap<(String, String), u64> {
        let mut totals = BTreeMap::new();
        for stream in self.sessions.iter().flat_map(|session| &session.streams) {
            let key = (stream.name.clone(), stream.kind.to_string());
            *totals.entry(key).or_default() += stream.count;
        }
        totals
    }

    /// Time recorded, seconds.
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        self.sessions.iter().filter_map(|session| session.duration_s).sum()
    }
}

/// The index that a dataset holds; none when there is none.
///
/// # Errors
/// When it cannot be understood.
pub fn read_index(root: &Path) -> Result<Option<Index>, BatchError> {
    let path = root.join("dataset.json");
    let text = match std::fs::read_to_string(&path) {
        Ok(text) => text,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(None),
        Err(error) => return Err(BatchError::io(&path)(error)),
    };
    let index = serde_json::from_str(&text);
    index.map(Some).map_err(|error| BatchError::Malformed {
        path,
        what: format!("not an index: {error}; `evrig process` writes it anew when it is removed"),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn versions_are_distinguished_by_their_numbers() {
        assert!(is_newer("99.0.0") && is_newer("0.100.0"));
        assert!(!is_newer(env!("CARGO_PKG_VERSION")) && !is_newer("0.0.9") && !is_newer(""));
    }
}
