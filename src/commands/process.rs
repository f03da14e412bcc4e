//! `evrig process`: every stage for which there is input, and what was left out and why.

mod target;

use super::{Ending, Output, compare, diagnose, generate};
use crate::cli::ProcessArgs;
use crate::pipeline::{self, CompareRequest, GenerateRequest};
use crate::session::{Session, StreamKind, StreamName};
use serde_json::{Value, json};

pub(super) fn run(args: &ProcessArgs, output: &Output) -> anyhow::Result<Ending> {
    let session = Session::open(&args.session)?;
    let mut stages = Vec::new();
    let mut left_out = Vec::new();
    let mut text = String::new();
    let mut n_lost = session.manifest().losses.len();

    let steps = target::clocks_and_tracks(&session, args, output)?;
    let mut targeted = vec![
        steps,
        target::scene(&session, args, output)?,
        target::generate_from_pi(&session, args, output)?,
    ];

    match pipeline::default_light(&session) {
        Some(light) => {
            let request = GenerateRequest {
                from: light.to_owned(),
                name: StreamName::new(light)?,
                parameters: generate::parameters(&args.choice)?,
                force: args.force,
            };
            let made = generate::generate(&session, &request, output)?;
            n_lost += usize::from(made.tally.n_frames_not_later > 0);
            text += &format!("generate  {}\n", generate::text(&request, &made));
            stages.push(json!({ "stage": "generate", "result": generate::value(&request, &made) }));
        }
        None => left_out.push(("generate", "the session has no frames to generate events from")),
    }

    targeted.push(target::filter_all(&session, args)?);
    let mut left_out_before: Vec<Value> = Vec::new();
    for steps in targeted {
        text += &steps.text;
        stages.extend(steps.stages);
        left_out_before.extend(steps.left_out);
        n_lost += steps.n_lost;
    }
    let simulated = compare::simulated(&session, "real");
    match session.stream(StreamKind::Events, "real") {
        Err(_) => left_out.push(("compare", "the session has no real events")),
        Ok(_) if simulated.is_empty() => left_out.push(("compare", "there is no simulated stream")),
        Ok(_) => {
            for name in simulated {
                match compare_one(&session, name, args) {
                    Ok((words, stage)) => {
                        text += &words;
                        stages.push(stage);
                    }
                    // Streams of two cameras that were not cut to one picture have no common grid.
                    Err(error) if is_missing(&error) => {
                        text += &format!("compare   left out: {error}\n");
                        let because = error.to_string();
                        left_out_before.push(json!({ "stage": "compare", "because": because }));
                    }
                    Err(error) => return Err(error),
                }
            }
        }
    }
    let mut because_of = None;
    match (session.stream(StreamKind::Events, "real"), pipeline::default_baseline(&session)) {
        (Ok(_), Some(baseline)) => match diagnose::stage(&session, baseline, args, output) {
            Ok((words, stage)) => {
                text += &words;
                stages.push(stage);
            }
            // A session too poor to be diagnosed is no failure of the other stages.
            Err(error) => because_of = Some(error.to_string()),
        },
        _ => left_out.push(("diagnose", "it takes real events and frames on their pixel grid")),
    }
    if let Some(because) = &because_of {
        left_out.push(("diagnose", because));
    }
    for (stage, because) in &left_out {
        text += &format!("{stage:<9} left out: {because}\n");
    }
    text += &format!("next: evrig report {}", args.session.display());
    let left_out: Vec<Value> = left_out
        .into_iter()
        .map(|(stage, because)| json!({ "stage": stage, "because": because }))
        .chain(left_out_before)
        .collect();
    let value = json!({
        "schema": "evrig.process/1",
        "session": session.manifest().name,
        "stages": stages,
        "left_out": left_out,
        "losses": session.manifest().losses,
    });
    output.result(&value, text)?;
    Ok(if n_lost == 0 { Ending::Done } else { Ending::WithLosses })
}

fn is_missing(error: &anyhow::Error) -> bool {
    matches!(error.downcast_ref(), Some(pipeline::PipelineError::Missing { .. }))
}

fn compare_one(
    session: &Session,
    simulated: StreamName,
    args: &ProcessArgs,
) -> anyhow::Result<(String, Value)> {
    let request = CompareRequest {
        real: "real".into(),
        simulated,
        seed: args.choice.seed,
        force: args.force,
    };
    let (comparison, freshness) = pipeline::compare(session, &request)?;
    let words = format!(
        "compare   {}{}",
        if freshness == pipeline::Freshness::Fresh { "(fresh) " } else { "" },
        compare::table(&request, &comparison)
    );
    let stage =
        json!({ "stage": "compare", "result": compare::value(&request, &comparison, freshness)? });
    Ok((words, stage))
}
