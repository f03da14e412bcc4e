use super::super::record::ProofPlan;
use super::super::seal::SealError;
use super::super::{ConcealedEffect, TrialMix, draw};
use super::*;
use crate::prove::plasmode::PlasmodeRecording;
use evrig_core::event::{Event, Events};
use evrig_core::frame::{Frame, FrameTiming, Samples};
use evrig_core::geometry::Size;
use evrig_core::time::Stamp;
use serde_json::json;
use std::cell::{Cell, RefCell};

const SIZE: Size = Size { width: 12, height: 8 };

fn recording() -> SessionMaker {
    let mut events = Events::new();
    for i in 0..400_i64 {
        events.push(Event { t: 1_000_000 + i * 2_000, x: (i % 12) as u16, y: 3, on: i % 3 == 0 });
    }
    let frame = |i: i64| {
        Frame::gray(
            FrameTiming::from_stamp(Stamp::from_micros(1_000_000 + i * 100_000)),
            SIZE,
            Samples::U8(vec![90; 96]),
        )
    };
    let frames = (0..9).map(frame).collect();
    SessionMaker::Plasmode(Box::new(PlasmodeRecording { size: SIZE, events, frames }))
}

fn trials(n: usize) -> Vec<ConcealedTrial> {
    draw(TrialMix { single: n, ..TrialMix::none(Family::Plasmode) }, 5)
}

/// An answer that names an effect.
fn names(id: &str) -> DiagnosisOutcome {
    let diagnosis = json!({ "verdict": "explained", "effects": [{ "id": id }] });
    DiagnosisOutcome::Answered { diagnosis }
}

fn bench<'a>(out: &'a Path, ask: &'a dyn Fn(&Path) -> DiagnosisOutcome) -> ProofRun<'a> {
    ProofRun { out, ask, is_tidy: true, heading: "Trials" }
}

#[test]
fn who_is_asked_sees_a_session_with_a_seal_and_no_truth_near_it() {
    let folder = tempfile::tempdir().unwrap();
    let seen = RefCell::new(Vec::new());
    let ask = |session: &Path| {
        let mut files = Vec::new();
        for entry in std::fs::read_dir(session).unwrap() {
            files.push(entry.unwrap().path());
        }
        let text: String = files.iter().filter_map(|f| std::fs::read_to_string(f).ok()).collect();
        let ids = super::super::plasmode::APPLICABLE;
        assert!(ids.iter().all(|id| !text.contains(id)), "{text}");
        assert!(session.join("seal.json").exists());
        seen.borrow_mut().push(session.to_owned());
        names("junction_leak")
    };
    let proof = bench(folder.path(), &ask).run(&recording(), &trials(3), &mut |_, _| {}).unwrap();
    // Once as it is, then every trial; what the plain recording shows counts neither way.
    assert_eq!(seen.borrow().len(), 4);
    assert!(proof.known.contains("junction_leak"));
    assert!(proof.judgements.iter().all(|j| j.named.is_empty() && j.missed == 1));
    assert!(seen.borrow().iter().all(|session| !session.exists()), "tidy");
}

#[test]
fn a_run_that_was_broken_off_goes_on_with_the_trial_it_was_at() {
    let folder = tempfile::tempdir().unwrap();
    let trials = trials(4);
    let n_asked = Cell::new(0);
    let ask = |_: &Path| {
        n_asked.set(n_asked.get() + 1);
        names("event_drop")
    };
    let bench = bench(folder.path(), &ask);
    // Broken off after two trials: what is there then is what a kill would have left.
    let first = bench.run(&recording(), &trials[..2], &mut |_, _| {}).unwrap();
    assert_eq!((n_asked.get(), first.score.n), (3, 2));
    let path = folder.path().join("proof-plasmode.json");
    let so_far: Proof = serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
    assert_eq!(so_far.judgements, first.judgements);
    let all = bench.run(&recording(), &trials, &mut |_, _| {}).unwrap();
    assert_eq!(n_asked.get(), 5, "two more, and none again");
    assert_eq!(all.judgements[..2], first.judgements[..]);
    assert_eq!(all.score.n, 4);
}

#[test]
fn a_session_that_was_sealed_is_not_made_again() {
    let folder = tempfile::tempdir().unwrap();
    let trials = trials(1);
    let ask = |session: &Path| {
        std::fs::write(session.join("left-behind"), "").unwrap();
        names("event_drop")
    };
    let bench = ProofRun { is_tidy: false, ..bench(folder.path(), &ask) };
    bench.run(&recording(), &trials, &mut |_, _| {}).unwrap();
    let session = folder.path().join("sessions").join(&trials[0].name);
    // As if it had been killed while it was diagnosed.
    let record = folder.path().join("trials").join(&trials[0].name).with_extension("json");
    std::fs::remove_file(&record).unwrap();
    bench.run(&recording(), &trials, &mut |_, _| {}).unwrap();
    assert!(record.exists() && session.join("left-behind").exists());
    // A session without its seal was not finished.
    std::fs::remove_file(&record).unwrap();
    std::fs::remove_file(session.join("seal.json")).unwrap();
    std::fs::write(session.join("half-written"), "").unwrap();
    bench.run(&recording(), &trials, &mut |_, _| {}).unwrap();
    assert!(!session.join("half-written").exists());
}

#[test]
fn a_trial_without_an_answer_is_a_miss_and_not_an_end() {
    let folder = tempfile::tempdir().unwrap();
    let ask = |_: &Path| DiagnosisOutcome::OutOfTime { after_s: 1.0 };
    let proof = bench(folder.path(), &ask).run(&recording(), &trials(2), &mut |_, _| {}).unwrap();
    assert_eq!((proof.score.unanswered, proof.score.top1.hits, proof.score.top1.of), (2, 0, 2));
}

#[test]
fn a_truth_that_was_changed_before_its_seal_is_opened_ends_the_run() {
    let folder = tempfile::tempdir().unwrap();
    let trials = trials(1);
    let truth = folder.path().join("truth").join(format!("{}.json", trials[0].name));
    let ask = |_: &Path| {
        // As one would who wants to be right.
        if let Ok(text) = std::fs::read_to_string(&truth) {
            std::fs::write(&truth, text.replace("strength", "Strength")).unwrap();
        }
        names("event_drop")
    };
    let error = bench(folder.path(), &ask).run(&recording(), &trials, &mut |_, _| {}).unwrap_err();
    assert!(matches!(error, ProveError::Seal(SealError::Broken { .. })), "{error}");
}

#[test]
fn sessions_made_elsewhere_are_judged_by_their_seals_and_stay() {
    let folder = tempfile::tempdir().unwrap();
    let maker = recording();
    let mut trial = trials(1).remove(0);
    trial.truth.effects = vec![ConcealedEffect {
        id: "event_drop".into(),
        parameters: [("fraction".into(), 0.2)].into(),
        strength: 2.0,
    }];
    let session = folder.path().join("made/sessions/other-000");
    maker.make(&trial, &session).unwrap();
    let truth = folder.path().join("made/truth/other-000.json");
    seal(&trial.truth, &truth, &session.join("seal.json")).unwrap();
    let ask = |_: &Path| names("event_drop");
    let out = folder.path().join("out");
    let made = folder.path().join("made");
    let ready = PreparedTrials::find(&made).unwrap();
    assert_eq!(ready.count(), 1);
    let proof = bench(&out, &ask).run_prepared(&ready, &mut |_, _| {}).unwrap();
    assert_eq!((proof.family, proof.score.top1.hits), (Family::ThirdParty, 1));
    assert!(session.join("session.json").exists());
    let none = PreparedTrials::find(folder.path());
    assert!(matches!(none, Err(ProveError::NoneReady { .. })));
}

#[test]
fn a_plan_does_not_reveal_what_is_hidden() {
    let plan = ProofPlan {
        schema: "evrig.proof-plan/2".into(),
        family: Family::Plasmode,
        mix: Some(TrialMix { single: 1, ..TrialMix::none(Family::Plasmode) }),
        seed: 5,
        seconds: None,
        options: evrig_analysis::diagnose::DiagnosisOptions::default(),
        trials_sha256: super::super::sha256(&serde_json::to_vec(&trials(1)).unwrap()),
    };
    let text = serde_json::to_string(&plan).unwrap();
    assert!(super::super::plasmode::APPLICABLE.iter().all(|id| !text.contains(id)), "{text}");
}
