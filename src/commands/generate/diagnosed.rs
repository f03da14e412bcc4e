//! `evrig generate --diagnosed`: events of a camera that a diagnosis found.

use super::result::speed;
use crate::cli::GenerateArgs;
use crate::commands::{Ending, Output, WrongUse, stream_name};
use crate::pipeline::{self, Baseline, By, CameraRequest, Freshness, Generated};
use evrig_session::Session;
use serde_json::json;
use std::path::Path;

/// How the session's own camera is named.
const OWN: &str = "own";

/// Name of the stream where none is given.
const NAME: &str = "diagnosed";

pub(super) fn run(
    session: &Session,
    camera: &Path,
    args: &GenerateArgs,
    output: &Output,
) -> anyhow::Result<Ending> {
    let request = CameraRequest {
        by: by(camera, args.from.as_deref())?,
        name: stream_name(args.name.as_deref().unwrap_or(NAME))?,
        seed: args.choice.seed,
        force: args.force,
    };
    let bar = output.progress("generate", 0);
    bar.set_message(format!("generate {}", request.name));
    let (made, cautions) = pipeline::generate_diagnosed(session, &request)?;
    bar.finish_and_clear();
    for caution in &cautions {
        output.warn(format!("the diagnosed camera: {caution}"));
    }
    output.result(&value(&request, &made, &cautions), text(&request, &made))?;
    Ok(Ending::Done)
}

/// Whose camera on which frames.
fn by(camera: &Path, from: Option<&str>) -> Result<By, WrongUse> {
    match (camera == Path::new(OWN), from) {
        (true, None) => Ok(By::Own),
        (true, Some(_)) => Err(WrongUse(
            "--diagnosed uses the signal of its diagnosis; leave --from out, or name the \
             camera.json to use another signal"
                .into(),
        )),
        (false, None) => Ok(By::Other(camera.to_owned(), None)),
        (false, Some("scene")) => Ok(By::Other(camera.to_owned(), Some(Baseline::Scene))),
        (false, Some(light)) => {
            Ok(By::Other(camera.to_owned(), Some(Baseline::Motion(light.to_owned()))))
        }
    }
}

fn value(request: &CameraRequest, made: &Generated, cautions: &[String]) -> serde_json::Value {
    json!({
        "schema": "evrig.generation/1",
        "stream": request.name.as_str(),
        "from": made.record.parameters.get("from"),
        "fresh": made.freshness == Freshness::Fresh,
        "frames": made.tally.n_frames,
        "events": made.tally.n_events,
        "on": made.tally.n_on,
        "first_us": made.tally.first_us,
        "last_us": made.tally.last_us,
        "named": made.record.parameters.get("named"),
        "parameters": made.record.parameters.get("camera"),
        "cautions": cautions,
        "speed": made.speed,
    })
}

fn text(request: &CameraRequest, made: &Generated) -> String {
    let from =
        made.record.parameters.get("from").and_then(|from| from.as_str()).unwrap_or_default();
    let named = made.record.parameters.get("named").and_then(|named| named.as_array());
    let named: Vec<&str> = named.into_iter().flatten().filter_map(|id| id.as_str()).collect();
    let with = if named.is_empty() { "no effect".to_owned() } else { named.join(", ") };
    let tally = &made.tally;
    let (events, instants) = (tally.n_events, tally.n_frames);
    let mut text = format!("{}: {events} events from {instants} instants of {from}", request.name);
    text += &format!(", by the diagnosed camera with {with}");
    text + &speed(made)
}
