//! `evrig prove`: concealed trials, from the plan to the score.

use super::{Ending, Output, WrongUse};
use crate::cli::ProveArgs;
use crate::prove::{
    ConcealedTrial, DiagnosisProcess, Family, PreparedTrials, Proof, ProofPlan, ProofRun,
    SessionMaker, TrialMix, claim_folder, draw, markdown, quick, quick_failures, sha256,
};
use anyhow::Context;
use evrig_analysis::diagnose::DiagnosisOptions;
use evrig_core::time::Span;
use serde_json::json;
use std::num::NonZeroUsize;
use std::time::Duration;

/// Shortest session that covers every direction of a circle, seconds.
const QUICK_S: f64 = 2.6;
const FULL_S: f64 = 5.0;

/// Default time limit of a diagnosis, seconds.
const DEADLINE_S: f64 = 1_800.0;

/// What is proved.
struct PlannedProof {
    plan: ProofPlan,
    trials: TrialSource,
    /// How long a diagnosis may take.
    deadline: Duration,
}

/// The trials of a run.
enum TrialSource {
    Made(SessionMaker, Vec<ConcealedTrial>),
    Prepared(PreparedTrials),
}

impl TrialSource {
    fn count(&self) -> usize {
        match self {
            Self::Made(_, trials) => trials.len(),
            Self::Prepared(ready) => ready.count(),
        }
    }

    fn family(&self) -> Family {
        match self {
            Self::Made(maker, _) => maker.family(),
            Self::Prepared(_) => Family::ThirdParty,
        }
    }
}

pub(super) fn run(args: &ProveArgs, output: &Output) -> anyhow::Result<Ending> {
    let run = plan(args)?;
    std::fs::create_dir_all(&args.out)
        .with_context(|| format!("cannot make {}", args.out.display()))?;
    claim_folder(&args.out, &run.plan, args.resume)?;
    let proof = prove(args, &run, output)?;
    let unheld = if args.quick { quick_failures(&proof.judgements) } else { Vec::new() };
    let mut text = markdown(&heading(&run.plan), &proof.score, &proof.judgements);
    for complaint in &unheld {
        text += &format!("failed: {complaint}\n");
    }
    let value = json!({ "schema": "evrig.prove/2", "out": args.out, "plan": run.plan,
        "not_held": unheld, "proof": proof });
    output.result(&value, text)?;
    Ok(if unheld.is_empty() { Ending::Done } else { Ending::Negative })
}

/// What was asked for. It is complete, and refused if it cannot be done, before anything is made.
fn plan(args: &ProveArgs) -> anyhow::Result<PlannedProof> {
    let seconds = args.seconds.unwrap_or(if args.quick { QUICK_S } else { FULL_S });
    if !(seconds.is_finite() && seconds > 0.0) {
        return Err(WrongUse(format!("--seconds {seconds}: expected more than 0")).into());
    }
    let deadline_s = args.deadline.unwrap_or(DEADLINE_S);
    let deadline = Duration::try_from_secs_f64(deadline_s)
        .map_err(|error| WrongUse(format!("--deadline {deadline_s}: {error}")))?;
    let (mix, trials) = trials(args, seconds)?;
    let defaults = DiagnosisOptions::default();
    let options = DiagnosisOptions {
        seed: args.seed,
        n_pixels: args.pixels.map_or(defaults.n_pixels, NonZeroUsize::get),
        ..defaults
    };
    let family = trials.family();
    let drawn: &[ConcealedTrial] = match &trials {
        TrialSource::Made(_, drawn) => drawn,
        TrialSource::Prepared(_) => &[],
    };
    let plan = ProofPlan {
        schema: "evrig.proof-plan/2".into(),
        family,
        mix,
        seed: args.seed,
        seconds: (family == Family::World).then_some(seconds),
        options,
        trials_sha256: sha256(&serde_json::to_vec(drawn)?),
    };
    Ok(PlannedProof { plan, trials, deadline })
}

/// The trials, and of how many kinds they were drawn.
fn trials(args: &ProveArgs, seconds: f64) -> anyhow::Result<(Option<TrialMix>, TrialSource)> {
    if let Some(sessions) = &args.sessions {
        return Ok((None, TrialSource::Prepared(PreparedTrials::find(sessions)?)));
    }
    let maker = match &args.recording {
        Some(recording) => SessionMaker::plasmode(recording)?,
        None => SessionMaker::world(Span::from_secs_f64(seconds))?,
    };
    if args.quick {
        return Ok((None, TrialSource::Made(maker, quick(args.seed))));
    }
    let mix = mix(args, maker.family());
    Ok((Some(mix), TrialSource::Made(maker, draw(mix, args.seed))))
}

fn prove(args: &ProveArgs, run: &PlannedProof, output: &Output) -> anyhow::Result<Proof> {
    let options = &run.plan.options;
    let numbers = [("--pixels", options.n_pixels as u64), ("--seed", options.seed)];
    let program = match &args.with {
        Some(program) => program.clone(),
        None => crate::program::program().context("cannot find this program's own file")?,
    };
    let ask = DiagnosisProcess {
        program,
        arguments: numbers.iter().flat_map(|(k, v)| [(*k).to_owned(), v.to_string()]).collect(),
        deadline: run.deadline,
    };
    let heading = heading(&run.plan);
    let bench = ProofRun {
        out: &args.out,
        ask: &|session| ask.diagnose(session),
        is_tidy: !args.keep,
        heading: &heading,
    };
    let bar = output.progress("proving", run.trials.count() as u64);
    let mut progress = |what: &str, done: usize| {
        bar.set_position(done as u64);
        bar.set_message(what.to_owned());
        output.detail(what);
    };
    let proof = match &run.trials {
        TrialSource::Made(maker, trials) => bench.run(maker, trials, &mut progress)?,
        TrialSource::Prepared(ready) => bench.run_prepared(ready, &mut progress)?,
    };
    bar.finish_and_clear();
    Ok(proof)
}

fn heading(plan: &ProofPlan) -> String {
    let DiagnosisOptions { n_pixels, .. } = plan.options;
    let seconds = plan.seconds.map_or(String::new(), |s| format!(", {s} s a session"));
    format!("Family `{}`, seed {}{seconds}, {n_pixels} pixels", plan.family.as_str(), plan.seed)
}

/// Number of trials of each kind: as given, else the default of the family.
fn mix(args: &ProveArgs, family: Family) -> TrialMix {
    let usual = match family {
        Family::Plasmode => [24, 0, 2, 2, 0],
        _ => [48, 12, 20, 9, 10],
    };
    let any = [args.single, args.double, args.clean, args.alien, args.local];
    let is_asked = any.iter().any(Option::is_some);
    let count = |i: usize| any[i].unwrap_or(if is_asked { 0 } else { usual[i] });
    let [single, double, clean, alien, local] = [0, 1, 2, 3, 4].map(count);
    TrialMix { family, single, double, clean, alien, local }
}
