//! `evrig generate`: one generation, its flags and its speed.

mod diagnosed;
mod result;
mod variants;

pub(super) use result::{text, value};
pub(super) use variants::value as variants_value;

use super::progress::ProgressDisplay;
use super::{Ending, Output, WrongUse, stream_name};
use crate::cli::{ConditionArgs, GenerateArgs};
use crate::pipeline::{self, Conditions, GenerateRequest, PipelineProgress};
use anyhow::Context;
use evrig_generate::effect::EffectSet;
use evrig_generate::input::{Colour, FramePreparation};
use evrig_session::Session;

pub(super) fn run(args: &GenerateArgs, output: &Output) -> anyhow::Result<Ending> {
    let session = Session::open(&args.session)?;
    if let Some(list) = &args.variants {
        return variants::run(&session, list, args.choice.seed, args.force, output);
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
    let choice = args.choice.choice();
    let parameters = choice.parameters_on(&session, from)?;
    if let Some(doubt) = choice.doubt_of_scale(&session, from) {
        output.say(format_args!("doubtful: {doubt}"));
    }
    choice.prepare_on(&session, from, &mut conditions)?;
    let request = GenerateRequest {
        from: from.to_owned(),
        name: stream_name(name)?,
        parameters,
        conditions,
        force: args.force,
    };
    let display = ProgressDisplay::new(output);
    let made = pipeline::generate(&session, &request, &mut |done, total| {
        display.show(PipelineProgress::Stage { stage: "generate", stream: name, done, total });
    })?;
    drop(display);
    output.result(&value(&request, &made), text(&request, &made))?;
    Ok(if made.tally.n_frames_not_later == 0 { Ending::Done } else { Ending::WithLosses })
}

/// FramePreparation, interpolation and effects from the command line.
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
