//! The session of the demo: one effect is drawn and sealed, then the simulated rig records with it.

use crate::commands::record::described;
use crate::prove::{
    ConcealedEffect, DiagnosisOutcome, Family, Judgement, SealedTruth, TrialRecord, judge, open,
    seal, strengths,
};
use anyhow::Context;
use evrig_analysis::diagnose::Diagnosis;
use evrig_core::stats::SplitMix;
use evrig_core::time::Span;
use evrig_session::Manifest;
use evrig_session::rig::Rig;
use evrig_session::trajectory::OptionalSegments;
use evrig_sim::world::WorldDescription;
use evrig_sim::{Simulation, simulate};
use serde_json::json;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// A circle: every direction of motion.
const DURATION_S: f64 = 4.0;

/// Frames of the Pi a second.
const PI_FRAMES_HZ: f64 = 60.0;

/// Strengths between which the effect is drawn, in units of the trials' table: far enough above the
/// detection floor that a miss is a fault.
const STRENGTHS: [f64; 2] = [2.0, 3.0];

/// The truth and its seal.
pub(super) struct SealedPaths {
    truth: PathBuf,
    seal: PathBuf,
}

/// Draws an effect, or takes the one of that name, at a drawn strength.
pub(super) fn draw(effect: Option<&str>, from: &[&str], seed: u64) -> SealedTruth {
    let mut random = SplitMix::new(seed, 0);
    let drawn = from[random.below(from.len())];
    let strength = random.between(STRENGTHS[0], STRENGTHS[1]);
    let nonce = format!("{:016x}{:016x}", random.bits(), random.bits());
    let (known, _) = strengths(Family::World);
    let entry = known.iter().find(|entry| entry.id == effect.unwrap_or(drawn));
    let concealed = |entry: &crate::prove::StrengthScale| ConcealedEffect {
        id: entry.id.to_owned(),
        parameters: entry.parameters(strength),
        strength,
    };
    let effects = entry.into_iter().map(concealed).collect();
    SealedTruth { effects, nonce, ..SealedTruth::nothing() }
}

/// The nominal world with the effects of a truth.
pub(super) fn world(truth: &SealedTruth) -> anyhow::Result<WorldDescription> {
    let effects = truth.effects.iter().map(|c| (c.id.clone(), c.description()));
    let effects: serde_json::Map<String, serde_json::Value> = effects.collect();
    Ok(serde_json::from_value(json!({ "effects": effects }))?)
}

/// Records on the simulated rig in virtual time; `watch` gets the progress, 0 to 1.
pub(super) fn record(
    world: &WorldDescription,
    seed: u64,
    out: &Path,
    watch: &mut dyn FnMut(f64),
) -> anyhow::Result<Manifest> {
    let (_, trajectory, path) = described("sim", "circle", OptionalSegments::LeftOut)?;
    let rig = demo_rig()?;
    let duration = Some(Span::from_secs_f64(DURATION_S).min(path.duration()));
    let (trajectory, path) = (&trajectory, &path);
    let simulation = Simulation { rig: &rig, trajectory, path, world, seed, out, duration };
    simulate(&simulation, watch).context("the recording failed")
}

/// The simulated rig with half as many frames of the Pi, raw only: the demo needs no more.
fn demo_rig() -> anyhow::Result<Rig> {
    let mut text: toml::Table = toml::from_str(&Rig::simulated()?.text)?;
    if let Some(pi) = text.get_mut("pi").and_then(toml::Value::as_table_mut) {
        pi.insert("rgb".to_owned(), false.into());
        pi.insert("frame_rate_hz".to_owned(), PI_FRAMES_HZ.into());
    }
    Ok(Rig::parse("sim, with half as many frames of the Pi", &toml::to_string(&text)?)?)
}

impl SealedPaths {
    /// Writes the truth beside the session and its checksum into it.
    pub(super) fn seal(truth: &SealedTruth, session: &Path) -> anyhow::Result<Self> {
        let mut beside = session.as_os_str().to_owned();
        beside.push(".truth.json");
        let paths = Self { truth: PathBuf::from(beside), seal: session.join("seal.json") };
        seal(truth, &paths.truth, &paths.seal)?;
        Ok(paths)
    }

    /// Opens the seal and judges the diagnosis.
    pub(super) fn judge(&self, diagnosis: &Diagnosis) -> anyhow::Result<(SealedTruth, Judgement)> {
        let truth = open(&self.truth, &self.seal)?;
        let outcome = DiagnosisOutcome::Answered { diagnosis: serde_json::to_value(diagnosis)? };
        let answer = outcome.answer()?;
        let record = TrialRecord {
            schema: "evrig.trial/1".into(),
            trial: "demo".into(),
            truth: truth.clone(),
            truth_sha256: String::new(),
            sensor_px: [0, 0],
            made_s: 0.0,
            diagnosed_s: 0.0,
            outcome,
        };
        Ok((truth, judge(&record, &answer, &BTreeSet::new())))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::CONCEALABLE;

    #[test]
    fn a_seed_draws_the_same_truth_and_the_seeds_cover_the_list() {
        let of = |seed| draw(None, &CONCEALABLE, seed);
        assert_eq!(of(3), of(3));
        let ids: BTreeSet<String> = (0..60).map(|seed| of(seed).effects[0].id.clone()).collect();
        assert_eq!(ids.len(), CONCEALABLE.len(), "{ids:?}");
    }

    #[test]
    fn every_effect_of_the_list_can_be_chosen_and_is_on_in_its_world() {
        for id in CONCEALABLE {
            let truth = draw(Some(id), &CONCEALABLE, 1);
            assert_eq!(world(&truth).unwrap().effects.keys_on(), [id]);
        }
    }
}
