//! `evrig generate`: one generation, its flags and its speed.

mod diagnosed;

use super::{Ending, Output, WrongUse};
use crate::cli::{ConditionArgs, GenerateArgs, ModelArgs};
use crate::pipeline::{self, Conditions, Freshness, GenerateRequest, Generated};
use anyhow::Context;
use evrig_analysis::calibrate::Calibration;
use evrig_generate::effect::EffectSet;
use evrig_generate::input::{Colour, FramePreparation};
use evrig_generate::{GenerateParameters, GeneratorChoice, KnobSetting, ParameterError};
use evrig_session::{Session, StreamName};
use serde_json::json;

pub(super) fn run(args: &GenerateArgs, output: &Output) -> anyhow::Result<Ending> {
    let session = Session::open(&args.session)?;
    if let Some(list) = &args.variants {
        return super::variants::run(&session, list, &args.choice, args.force, output);
    }
    if let Some(camera) = &args.diagnosed {
        return diagnosed::run(&session, camera, args, output);
    }
    let from = match (&args.from, pipeline::default_light(&session)) {
        (Some(from), _) => from.as_str(),
        (None, Some(light)) => light,
        (None, None) => anyhow::bail!(
            "{} has no frames to generate events from; import a recording that has some",
            args.session.display()
        ),
    };
    let name = args.name.as_deref().unwrap_or(from);
    let mut conditions = conditions(&args.conditions)?;
    let parameters = tuned_parameters(&session, from, &args.choice)?;
    prepare_as_tuned(&session, from, &args.choice, &mut conditions)?;
    let request = GenerateRequest {
        from: from.to_owned(),
        name: stream_name(name)?,
        parameters,
        conditions,
        force: args.force,
    };
    let made = generate(&session, &request, output)?;
    output.result(&value(&request, &made), text(&request, &made))?;
    Ok(if made.tally.n_frames_not_later == 0 { Ending::Done } else { Ending::WithLosses })
}

fn stream_name(name: &str) -> Result<StreamName, WrongUse> {
    StreamName::new(name).map_err(|error| WrongUse(error.to_string()))
}

/// What is done to the light and what acts beside the model, from what the user said.
pub(super) fn conditions(args: &ConditionArgs) -> anyhow::Result<Conditions> {
    let wrong_use = |error: &dyn std::fmt::Display| WrongUse(error.to_string());
    let mut effects = EffectSet::from_words(&args.effects).map_err(|e| wrong_use(&e))?;
    if let Some(path) = &args.effects_file {
        let text = std::fs::read_to_string(path)
            .with_context(|| format!("cannot read the effects in {}", path.display()))?;
        let more: EffectSet =
            toml::from_str(&text).map_err(|e| WrongUse(format!("{}: {e}", path.display())))?;
        effects = effects.and(&more);
    }
    let colour = args.colour.as_deref().map_or(Ok(Colour::default()), str::parse);
    let preparation = FramePreparation {
        colour: colour.map_err(|e| wrong_use(&e))?,
        subtract_black: args.subtract_black,
        divide_exposure: args.divide_exposure,
    };
    let (interpolate_us, in_plane) = (args.interpolate, args.in_plane);
    Ok(Conditions { preparation, interpolate_us, in_plane, effects })
}

/// The generator's parameters from what the user said, of which the session's own constants
/// (`--k @calibrated`, `--preset tuned`) are looked up.
pub(super) fn tuned_parameters(
    session: &Session,
    light: &str,
    args: &ModelArgs,
) -> anyhow::Result<GenerateParameters> {
    // The scene's light counts in units of its own white.
    let mut args = args.clone();
    args.full_scale_dn = args.full_scale_dn.or(pipeline::white_of(session, light)?);
    if !asks_for_tuned(&args) {
        return parameters(&args);
    }
    let k = Some(calibration(session, light)?.k.to_string());
    parameters(&ModelArgs { k, preset: None, ..args })
}

/// Whether the user wants the session's own constants.
pub(super) fn asks_for_tuned(args: &ModelArgs) -> bool {
    let asks = |given: &Option<String>, word: &str| {
        given.as_deref().is_some_and(|given| given.eq_ignore_ascii_case(word))
    };
    asks(&args.k, "@calibrated") || asks(&args.preset, "tuned")
}

/// Constants hold for frames that are prepared as those they were told from: where the user says
/// nothing else, the session's own constants bring their preparation with them.
pub(super) fn prepare_as_tuned(
    session: &Session,
    light: &str,
    args: &ModelArgs,
    conditions: &mut Conditions,
) -> anyhow::Result<()> {
    if asks_for_tuned(args) && conditions.preparation == FramePreparation::default() {
        conditions.preparation = calibration(session, light)?.preparation;
    }
    Ok(())
}

fn calibration(session: &Session, light: &str) -> anyhow::Result<Calibration> {
    let light = StreamName::new(light)?;
    let found = pipeline::read_calibration(session, &light)?;
    found.with_context(|| {
        let root = session.root().display();
        format!(
            "{root} has no constants for the light {light}; \
             run `evrig calibrate {root} --from {light}` first"
        )
    })
}

/// The generator's parameters from what the user said.
pub(super) fn parameters(args: &ModelArgs) -> anyhow::Result<GenerateParameters> {
    let wrong_use = |error: ParameterError| WrongUse(error.to_string());
    let knobs: Result<Vec<KnobSetting>, _> = args.knobs.iter().map(|knob| knob.parse()).collect();
    let choice = GeneratorChoice {
        model: args.model.as_deref(),
        law: args.law.as_deref(),
        preset: args.preset.as_deref(),
        k: args.k.as_deref(),
        knobs: &knobs.map_err(wrong_use)?,
        full_scale_dn: args.full_scale_dn,
        seed: args.seed,
    };
    GenerateParameters::from_choice(&choice).map_err(|error| wrong_use(error).into())
}

/// Runs the stage under a progress bar.
pub(super) fn generate(
    session: &Session,
    request: &GenerateRequest,
    output: &Output,
) -> anyhow::Result<Generated> {
    let bar = output.progress("generate", 0);
    bar.set_message(format!("generate {}", request.name));
    let made = pipeline::generate(session, request, &mut |done, all| {
        bar.set_length(all);
        bar.set_position(done);
    })?;
    bar.finish_and_clear();
    Ok(made)
}

/// The result as consumers of `--json` get it.
pub(super) fn value(request: &GenerateRequest, made: &Generated) -> serde_json::Value {
    json!({
        "schema": "evrig.generation/1",
        "stream": request.name.as_str(),
        "from": request.from,
        "fresh": made.freshness == Freshness::Fresh,
        "frames": made.tally.n_frames,
        "events": made.tally.n_events,
        "on": made.tally.n_on,
        "frames_not_later": made.tally.n_frames_not_later,
        "intervals_filled_in_place": made.tally.n_filled_in_place,
        "frame_rhythm": made.tally.frame_rhythm,
        "first_us": made.tally.first_us,
        "last_us": made.tally.last_us,
        "parameters": request.parameters,
        "conditions": request.conditions,
        "speed": made.speed,
    })
}

/// The result for people.
pub(super) fn text(request: &GenerateRequest, made: &Generated) -> String {
    let tally = &made.tally;
    let mut text = format!(
        "{}: {} events from {} frames of {}",
        request.name, tally.n_events, tally.n_frames, request.from
    );
    if tally.n_frames_not_later > 0 {
        text += &format!(", {} frames left out (not later)", tally.n_frames_not_later);
    }
    if tally.n_filled_in_place > 0 {
        text += &format!(
            ", {} intervals filled pixel by pixel (no track there)",
            tally.n_filled_in_place
        );
    }
    if let Some(rhythm) = tally.frame_rhythm {
        text += &format!(", frame rhythm {rhythm:.3}");
    }
    text + &speed(made)
}

/// How fast it went, in brackets.
fn speed(made: &Generated) -> String {
    match &made.speed {
        Some(speed) => format!(
            " ({:.0} frames/s, {:.1} ns per pixel and frame)",
            speed.frames_per_s, speed.ns_per_pixel_frame
        ),
        None => " (fresh)".to_owned(),
    }
}
