//! `evrig process`: every stage for which there is input, and what was left out and why.

use super::{Ending, Output, calibrate, compare, generate};
use crate::cli::{ModelArgs, ProcessArgs};
use crate::pipeline::{self, CompareRequest, Conditions, GenerateRequest, PipelineError};
use crate::session::{Session, StreamKind, StreamName};
use serde_json::{Value, json};

pub(super) fn run(args: &ProcessArgs, output: &Output) -> anyhow::Result<Ending> {
    let session = Session::open(&args.session)?;
    let mut stages = Vec::new();
    let mut left_out = Vec::new();
    let mut text = String::new();
    let mut n_lost = session.manifest().losses.len();

    let light = pipeline::default_light(&session);
    let is_calibrated = match calibrate_light(&session, light, args, output)? {
        Ok((words, stage)) => {
            text += &words;
            stages.push(stage);
            true
        }
        Err(because) => {
            left_out.push(("calibrate", because));
            false
        }
    };
    match light {
        Some(light) => {
            let plain =
                (light.to_owned(), generate::tuned_parameters(&session, light, &args.choice)?);
            let mut streams = vec![plain];
            // Beside the user's choice, the session's own constants; not when they are the choice.
            if is_calibrated && !args.choice.is_given() {
                let tuned = ModelArgs { preset: Some("tuned".into()), ..args.choice.clone() };
                let parameters = generate::tuned_parameters(&session, light, &tuned)?;
                streams.push((format!("{light}-tuned"), parameters));
            }
            for (name, parameters) in streams {
                let request = GenerateRequest {
                    from: light.to_owned(),
                    name: StreamName::new(&name)?,
                    parameters,
                    conditions: Conditions::default(),
                    force: args.force,
                };
                let made = generate::generate(&session, &request, output)?;
                n_lost += usize::from(made.tally.n_frames_not_later > 0);
                text += &format!("generate  {}\n", generate::text(&request, &made));
                stages.push(
                    json!({ "stage": "generate", "result": generate::value(&request, &made) }),
                );
            }
        }
        None => left_out
            .push(("generate", "the session has no frames to generate events from".to_owned())),
    }

    let simulated = compare::simulated(&session, "real");
    match session.stream(StreamKind::Events, "real") {
        Err(_) => left_out.push(("compare", "the session has no real events".to_owned())),
        Ok(_) if simulated.is_empty() => {
            left_out.push(("compare", "there is no simulated stream".to_owned()));
        }
        Ok(_) => {
            for name in simulated {
                let (words, stage) = compare_one(&session, name, args)?;
                text += &words;
                stages.push(stage);
            }
        }
    }
    for (stage, because) in &left_out {
        text += &format!("{stage:<9} left out: {because}\n");
    }
    text += &format!("next: evrig report {}", args.session.display());
    let left_out: Vec<Value> = left_out
        .into_iter()
        .map(|(stage, because)| json!({ "stage": stage, "because": because }))
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

/// Calibrates on a light; or why the session cannot be calibrated on.
fn calibrate_light(
    session: &Session,
    light: Option<&str>,
    args: &ProcessArgs,
    output: &Output,
) -> anyhow::Result<Result<(String, Value), String>> {
    let Some(light) = light else { return Ok(Err("the session has no frames".to_owned())) };
    if session.stream(StreamKind::Events, "real").is_err() {
        return Ok(Err("the session has no real events".to_owned()));
    }
    let request = pipeline::CalibrateRequest {
        from: light.to_owned(),
        real: "real".into(),
        objective: pipeline::ObjectiveKind::Score,
        n_evaluations: calibrate::EVALUATIONS,
        seed: args.choice.seed,
        force: args.force,
    };
    match calibrate::calibrate(session, &request, output) {
        Ok((calibration, freshness)) => {
            let words = format!("calibrate {}\n", calibrate::line(&calibration, freshness));
            let result = calibrate::value(&request, &calibration, freshness)?;
            Ok(Ok((words, json!({ "stage": "calibrate", "result": result }))))
        }
        Err(PipelineError::Calibrate { source, .. }) => Ok(Err(source.to_string())),
        Err(error) => Err(error.into()),
    }
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
