//! The steps of `process` that hold simulated events against real ones and explain the difference.

use super::steps::Steps;
use crate::cli::{ModelArgs, ProcessArgs};
use crate::commands::{Output, compare, diagnose as verb, variants as list_of};
use crate::pipeline::{self, CompareRequest, Freshness, PipelineError};
use evrig_session::{Session, StreamKind};

/// The list of streams that was asked for beside the path's own.
pub(super) fn variants(session: &Session, args: &ProcessArgs, output: &Output) -> Steps {
    let mut steps = Steps::default();
    let Some(list) = &args.variants else { return steps };
    let (keeping, kept) = output.keeping();
    let choice = ModelArgs { seed: args.choice.seed, ..ModelArgs::default() };
    match list_of::run(session, list, &choice, args.force, &keeping) {
        Ok(_) => {
            let result = kept.borrow_mut().pop().unwrap_or_default();
            let n = result["variants"].as_array().map_or(0, Vec::len);
            steps.did("variants", &format!("{list}: {n} streams asked for"), &result);
        }
        Err(error) => {
            steps.leave_out("variants", &format!("{error:#}"));
            steps.n_lost += 1;
        }
    }
    steps
}

/// Every simulated stream against the real one.
pub(super) fn compare_all(session: &Session, args: &ProcessArgs) -> anyhow::Result<Steps> {
    let mut steps = Steps::default();
    let simulated = compare::simulated(session, "real");
    if session.stream(StreamKind::Events, "real").is_err() {
        steps.leave_out("compare", "the session has no real events");
    } else if simulated.is_empty() {
        steps.leave_out("compare", "there is no simulated stream");
    } else {
        let mut reference = pipeline::Reference::new(session, "real");
        for simulated in simulated {
            let (real, seed) = ("real".to_owned(), args.choice.seed);
            let request = CompareRequest { real, simulated, seed, force: args.force };
            match pipeline::compare_with(&mut reference, &request) {
                Ok((comparison, freshness)) => {
                    let mark = if freshness == Freshness::Fresh { "(fresh) " } else { "" };
                    let words = format!("{mark}{}", compare::table(&request, &comparison));
                    let result = compare::value(&request, &comparison, freshness)?;
                    steps.did("compare", words.trim_end(), &result);
                }
                // Streams of two cameras that were not cut to one picture have no common grid.
                Err(error @ PipelineError::Missing { .. }) => {
                    steps.leave_out("compare", &error.to_string());
                }
                Err(error) => return Err(error.into()),
            }
        }
    }
    Ok(steps)
}

/// The diagnosis. A session too poor to be diagnosed is no failure of the other stages.
pub(super) fn diagnose(session: &Session, args: &ProcessArgs, output: &Output) -> Steps {
    let mut steps = Steps::default();
    match (session.stream(StreamKind::Events, "real"), pipeline::default_baseline(session)) {
        (Ok(_), Some(baseline)) => match verb::stage(session, baseline, args, output) {
            Ok((words, result)) => steps.did("diagnose", &words, &result),
            Err(error) => steps.leave_out("diagnose", &error.to_string()),
        },
        _ => steps.leave_out("diagnose", "it takes real events and frames on their pixel grid"),
    }
    steps
}
