//! The steps of `process` on frames that lie on the events' own pixel grid.

use super::steps::Steps;
use crate::cli::{ModelArgs, ProcessArgs};
use crate::commands::{Output, calibrate, generate};
use crate::pipeline::{self, Conditions, GenerateRequest, PipelineError};
use evrig_session::{Session, StreamKind, StreamName};

/// Evaluations of the search over k: none, since regressions and passages take seconds and the
/// search minutes; `evrig calibrate` runs it.
const EVALUATIONS: usize = 0;

/// Constants told from the session, and events generated with the published ones and with those.
pub(super) fn calibrate_and_generate(
    session: &Session,
    args: &ProcessArgs,
    output: &Output,
) -> anyhow::Result<Steps> {
    let mut steps = Steps::default();
    let Some(light) = pipeline::default_light(session) else {
        let because = "the session has no frames on the events' pixel grid";
        steps.leave_out("calibrate", because);
        steps.leave_out("generate", because);
        return Ok(steps);
    };
    let is_calibrated = calibrate_on(session, light, args, output, &mut steps)?;
    let plain = (light.to_owned(), generate::tuned_parameters(session, light, &args.choice)?);
    let mut streams = vec![plain];
    // Beside the user's choice, the session's own constants; not when they are the choice.
    if is_calibrated && !args.choice.is_given() {
        let tuned = ModelArgs { preset: Some("tuned".into()), ..args.choice.clone() };
        let parameters = generate::tuned_parameters(session, light, &tuned)?;
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
        let made = match generate::generate(session, &request, output) {
            Ok(made) => made,
            // Constants told from the session may be beyond what a generator can do with its
            // frames; the published ones are not.
            Err(error) if request.name.as_str() != light => {
                steps.leave_out("generate", &error.to_string());
                continue;
            }
            Err(error) => return Err(error),
        };
        steps.n_lost += usize::from(made.tally.n_frames_not_later > 0);
        let words = generate::text(&request, &made);
        steps.did("generate", &words, &generate::value(&request, &made));
    }
    Ok(steps)
}

/// Whether constants could be told from the session.
pub(super) fn calibrate_on(
    session: &Session,
    light: &str,
    args: &ProcessArgs,
    output: &Output,
    steps: &mut Steps,
) -> anyhow::Result<bool> {
    if session.stream(StreamKind::Events, "real").is_err() {
        steps.leave_out("calibrate", "the session has no real events");
        return Ok(false);
    }
    let request = pipeline::CalibrateRequest {
        from: light.to_owned(),
        real: "real".into(),
        objective: pipeline::ObjectiveKind::Score,
        n_evaluations: EVALUATIONS,
        seed: args.choice.seed,
        force: args.force,
    };
    match calibrate::calibrate(session, &request, output) {
        Ok((calibration, freshness)) => {
            let result = calibrate::value(&request, &calibration, freshness)?;
            steps.did("calibrate", &calibrate::line(&calibration, freshness), &result);
            Ok(true)
        }
        Err(PipelineError::Calibrate { source, .. }) => {
            steps.leave_out("calibrate", &source.to_string());
            Ok(false)
        }
        Err(error) => Err(error.into()),
    }
}
