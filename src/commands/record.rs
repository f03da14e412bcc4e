//! `record`: the engine over the devices that a rig file names.

mod images;

use super::plan::refused;
use super::{Ending, Output, WrongUse};
use crate::cli::RecordArgs;
use crate::device::davis::Pace;
use crate::device::sim::world::WorldDescription;
use crate::record::{self, Bench, Dwells, Opening, RecordError, Request, State, Stop, StopToken};
use crate::rig::Rig;
use crate::session::{Session, verify};
use crate::trajectory::{Optional, Path, Plan, Trajectory};
use serde_json::{Value, json};
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM, SIGUSR1};
use std::fmt::Write;

pub(super) fn record(args: &RecordArgs, output: &Output) -> anyhow::Result<Ending> {
    if !(args.replay_pace > 0.0 && args.replay_pace.is_finite()) {
        return Err(
            WrongUse(format!("--replay-pace is {}; expected above 0", args.replay_pace)).into()
        );
    }
    let optional = if args.without_optional { Optional::LeftOut } else { Optional::Included };
    let (rig, trajectory, path) = described(&args.rig, &args.trajectory, optional)?;
    let world = world(args.world.as_deref())?;
    let opening = Opening {
        pace: Pace::Times(args.replay_pace),
        home: args.home,
        start: path.start(),
        world: &world,
        seed: args.seed,
    };
    let mut bench = Bench::open(&rig, &opening)?;
    let stop = StopToken::default();
    listen_for_signals(&stop, &bench)?;
    let request = Request {
        rig: &rig,
        trajectory: &trajectory,
        path: &path,
        out: &args.out,
        dwells: Dwells::default(),
    };
    if let Some(images) = &args.images {
        return images::record(images, args, request, &mut bench, &stop, output);
    }
    let taken = take(request, &mut bench, &stop, output)?;
    output.result(&taken.value, taken.text)?;
    Ok(taken.ending)
}

/// One recording, told.
struct Taken {
    ending: Ending,
    value: Value,
    text: String,
}

/// Records one session and verifies it.
fn take(
    request: Request<'_>,
    bench: &mut Bench,
    stop: &StopToken,
    output: &Output,
) -> anyhow::Result<Taken> {
    let bar = output.progress("recording", 1000);
    let mut said = None;
    let mut watch = |state: State, share: f64| {
        bar.set_position((share * 1000.0) as u64);
        if said != Some(state) {
            said = Some(state);
            bar.set_message(state.to_string());
            output.detail(state);
        }
    };
    let outcome = match record::record(request, &mut bench.devices, stop, &mut watch) {
        Ok(outcome) => outcome,
        Err(error @ (RecordError::NotReady(_) | RecordError::Session(_))) => {
            return Err(error.into());
        }
    };
    bar.finish_and_clear();
    let holds = verify(&Session::open(request.out)?)?.holds();
    let manifest = &outcome.manifest;
    let mut text = String::new();
    for stream in &manifest.streams {
        let _ = writeln!(text, "{:<16} {:>12} {}", stream.name, stream.count, stream.kind);
    }
    for loss in &manifest.losses {
        output.warn(format_args!("{}: {} ({})", loss.stream, loss.what, loss.count));
    }
    let verdict = if holds { "verified" } else { "does NOT verify" };
    let _ = write!(text, "{}: {:?}, {verdict}", request.out.display(), manifest.status);
    let value = json!({
        "schema": "evrig.record/1", "session": request.out, "status": manifest.status, "holds": holds,
        "cut_short": outcome.cut_short, "streams": manifest.streams, "losses": manifest.losses,
    });
    let ending = match (&outcome.cut_short, holds) {
        (_, false) => Ending::Negative,
        (Some(_), _) if outcome.is_asked_for => Ending::Aborted,
        (Some(_), _) => Ending::Failed,
        (None, _) if manifest.losses.is_empty() => Ending::Done,
        (None, _) => Ending::WithLosses,
    };
    Ok(Taken { ending, value, text })
}

/// Ctrl-C and every other wish to end stand the arm at once; SIGUSR1 ends at the next corner.
fn listen_for_signals(stop: &StopToken, bench: &Bench) -> std::io::Result<()> {
    let mut signals = signal_hook::iterator::Signals::new([SIGINT, SIGTERM, SIGHUP, SIGUSR1])?;
    let (stop, stopper) = (stop.clone(), bench.stopper.clone());
    std::thread::Builder::new().name("signals".to_owned()).spawn(move || {
        for signal in signals.forever() {
            if signal == SIGUSR1 {
                stop.ask(Stop::AfterStep);
                continue;
            }
            if let Some(stopper) = &stopper {
                // A guard that is gone has stopped the arm already.
                let _ = stopper.halt();
            }
            stop.ask(Stop::AtOnce);
        }
    })?;
    Ok(())
}

/// The world of a description file, or the nominal one.
fn world(path: Option<&std::path::Path>) -> anyhow::Result<WorldDescription> {
    let Some(path) = path else { return Ok(WorldDescription::default()) };
    let file = path.display().to_string();
    let text =
        std::fs::read_to_string(path).map_err(|error| WrongUse(format!("{file}: {error}")))?;
    Ok(WorldDescription::parse(&file, &text).map_err(|error| WrongUse(error.to_string()))?)
}

fn described(
    rig: &str,
    trajectory: &str,
    optional: Optional,
) -> anyhow::Result<(Rig, Trajectory, Path)> {
    let found = Rig::find(rig).map_err(refused)?;
    let described = Trajectory::find(trajectory).map_err(refused)?;
    let plan = Plan::new(&described, &found, optional)
        .map_err(|error| WrongUse(format!("{trajectory} on rig {rig}: {error}")))?;
    if !plan.is_feasible {
        let text =
            format!("the arm cannot run {trajectory}; see `evrig plan {trajectory} --rig {rig}`");
        return Err(WrongUse(text).into());
    }
    Ok((found, described, plan.path))
}
