//! The steps of `process` that put a session on one clock and one target.

use super::own_light;
use super::steps::Steps;
use crate::cli::{ModelArgs, ProcessArgs};
use crate::commands::{Output, filter, generate, sync, track};
use crate::pipeline::{
    self, AlignProgress, Conditions, FilterRequest, FilterSettings, GenerateRequest, PipelineError,
    SceneMade, Synced, TrackOutcome,
};
use evrig_session::{Session, StreamName};

/// Clocks, tracks and scene.
pub(super) fn align(
    session: &Session,
    args: &ProcessArgs,
    output: &Output,
) -> anyhow::Result<Steps> {
    let n_frames = track::n_frames(session, pipeline::frame_streams(session).iter());
    let (tracking, mapping) = (output.progress("track", n_frames), output.progress("scene", 0));
    let aligned = pipeline::align(session, args.force, &|progress| match progress {
        AlignProgress::Tracked => tracking.inc(1),
        AlignProgress::Mapped(done, all) => {
            mapping.set_length(all);
            mapping.set_position(done);
        }
    });
    tracking.finish_and_clear();
    mapping.finish_and_clear();
    let mut steps = clocks(aligned.clocks)?;
    steps.append(tracks(aligned.tracks)?);
    steps.append(scene(aligned.scene)?);
    Ok(steps)
}

fn clocks(clocks: Option<Result<Synced, PipelineError>>) -> anyhow::Result<Steps> {
    let mut steps = Steps::default();
    match clocks {
        None => steps.leave_out("sync", "the session has no frames of the Pi's camera"),
        Some(Ok(synced)) => steps.did("sync", &sync::text(&synced), &sync::value(&synced)),
        Some(Err(error @ PipelineError::Clock { .. })) => {
            steps.leave_out("sync", &error.to_string());
            steps.n_lost += 1;
        }
        Some(Err(error)) => return Err(error.into()),
    }
    Ok(steps)
}

fn tracks(tracks: Result<Vec<TrackOutcome>, &'static str>) -> anyhow::Result<Steps> {
    let mut steps = Steps::default();
    let tracks = match tracks {
        Ok(tracks) => tracks,
        Err(because) => {
            steps.leave_out("track", because);
            Vec::new()
        }
    };
    for (request, tracked) in tracks {
        match tracked {
            Ok(tracked) => {
                let words = track::words(&request, &tracked);
                steps.did("track", &words, &track::value(&request, &tracked));
            }
            Err(error @ PipelineError::Track { .. }) => {
                steps.leave_out("track", &error.to_string());
                steps.n_lost += 1;
            }
            Err(error) => return Err(error.into()),
        }
    }
    Ok(steps)
}

fn scene(made: Result<SceneMade, PipelineError>) -> anyhow::Result<Steps> {
    let mut steps = Steps::default();
    match made {
        Ok(made) => {
            let words = crate::commands::scene::text(&made);
            steps.did("scene", &words, &crate::commands::scene::value(&made));
        }
        Err(error @ PipelineError::Missing { .. }) => steps.leave_out("scene", &error.to_string()),
        Err(error @ PipelineError::Scene(_)) => {
            steps.leave_out("scene", &error.to_string());
            steps.n_lost += 1;
        }
        Err(error) => return Err(error.into()),
    }
    Ok(steps)
}

/// Events from what the event pixels saw, with constants told on that light unless the user chose.
pub(super) fn generate_from_scene(
    session: &Session,
    args: &ProcessArgs,
    output: &Output,
) -> anyhow::Result<Steps> {
    const SCENE: &str = "scene";
    let mut steps = Steps::default();
    // Why there is none was said when it was to be made.
    if pipeline::white_of(session, SCENE)?.is_none() {
        return Ok(steps);
    }
    let is_calibrated = own_light::calibrate_on(session, SCENE, args, output, &mut steps)?;
    let mut choice = args.choice.clone();
    if !choice.is_given() {
        let preset = if is_calibrated { "tuned" } else { "Raw2DVS346" };
        choice.preset = Some(preset.to_owned());
    }
    let request = GenerateRequest {
        from: SCENE.to_owned(),
        name: StreamName::new(SCENE)?,
        parameters: generate::tuned_parameters(session, SCENE, &choice)?,
        conditions: Conditions::default(),
        force: args.force,
    };
    match generate::generate(session, &request, output) {
        Ok(made) => {
            let words = generate::text(&request, &made);
            steps.did("generate", &words, &generate::value(&request, &made));
        }
        // Constants told from the session may be beyond what a generator can do.
        Err(error) => steps.leave_out("generate", &error.to_string()),
    }
    Ok(steps)
}

/// Events from the Pi's frames, each light with its published constants unless the user chose.
pub(super) fn generate_from_pi(
    session: &Session,
    args: &ProcessArgs,
    output: &Output,
) -> anyhow::Result<Steps> {
    let mut steps = Steps::default();
    let streams = pipeline::pi_streams(session);
    let has_clock = pipeline::read_clocks(session)?.is_some();
    for light in streams {
        if !has_clock {
            steps.leave_out("generate", &format!("`{light}` has no way to the events' clock"));
            continue;
        }
        let chosen = &args.choice;
        let published = if light == "raw" { "Raw2DVS346" } else { "RGB2DVS346" };
        let choice = if chosen.is_given() {
            chosen.clone()
        } else {
            ModelArgs { preset: Some(published.into()), ..chosen.clone() }
        };
        let request = GenerateRequest {
            from: light.to_owned(),
            name: StreamName::new(light)?,
            parameters: generate::parameters(&choice)?,
            conditions: Conditions::default(),
            force: args.force,
        };
        let made = generate::generate(session, &request, output)?;
        let words = generate::text(&request, &made);
        steps.did("generate", &words, &generate::value(&request, &made));
    }
    Ok(steps)
}

/// How streams of any camera are cut to one grid: the picture as wide as the event camera sees it.
/// None where no track says where that is.
pub(in crate::commands) fn cut_alike(session: &Session) -> Option<FilterSettings> {
    let tracked = pipeline::tracked(session);
    let of_davis = tracked.iter().find(|name| !session.is_from_pi(name).unwrap_or(true))?;
    let summary = pipeline::read_summary(session, of_davis)?;
    let plain = FilterSettings::default();
    let crop = (summary.picture_px * (1.0 + 2.0 * plain.margin)).round().clamp(1.0, 4096.0);
    Some(FilterSettings { crop_px: Some(crop as u16), ..plain })
}

/// Every event stream cut to the picture, all to one grid: as wide as the event camera sees it.
pub(super) fn filter_all(session: &Session, args: &ProcessArgs) -> anyhow::Result<Steps> {
    let mut steps = Steps::default();
    let Some(settings) = cut_alike(session) else {
        steps.leave_out("filter", "no track of the event camera says where the picture is");
        return Ok(steps);
    };
    for stream in filter::event_streams(session) {
        if let Err(error) = pipeline::track_for(session, &stream) {
            steps.leave_out("filter", &error.to_string());
            continue;
        }
        let request = FilterRequest { stream, settings, force: args.force };
        let filtered = pipeline::filter(session, &request)?;
        let words = filter::words(&request, &filtered);
        steps.did("filter", &words, &filter::value(&request, &filtered));
    }
    Ok(steps)
}
