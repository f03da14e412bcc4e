//! `record`: the engine over the devices that a rig file names.

mod images;
mod lag;
mod prompt;

use super::plan::refused;
use super::{Ending, Output, WrongUse};
use crate::cli::RecordArgs;
use crate::drivers::{OpenOptions, OpenRig};
use evrig_record::recorder::Recorder;
use evrig_record::{
    Dwells, EmergencyStop, Prompts, RUNS_SCHEMA, RecordOutcome, RecordRequest, RecordState,
    RunList, RunsError, StopRequest, StopToken,
};
use evrig_report::number::counted;
use evrig_session::rig::{ArmPort, Rig};
use evrig_session::trajectory::{OptionalSegments, Plan, ToolPath, Trajectory};
use evrig_session::{Manifest, Session, verify};
use evrig_sim::world::WorldDescription;
use serde_json::{Value, json};
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM, SIGUSR1};
use std::fmt::Write;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

pub(super) fn record(args: &RecordArgs, output: &Output) -> anyhow::Result<Ending> {
    if !(args.replay_pace > 0.0 && args.replay_pace.is_finite()) {
        return Err(
            WrongUse(format!("--replay-pace is {}; expected above 0", args.replay_pace)).into()
        );
    }
    let optional =
        if args.without_optional { OptionalSegments::LeftOut } else { OptionalSegments::Included };
    let (rig, trajectory, path) = described(&args.rig, &args.trajectory, optional)?;
    let world = world(args.world.as_deref())?;
    let opening = OpenOptions {
        replay_speed: Some(args.replay_pace),
        home: args.home,
        start: path.start(),
        world: &world,
        seed: args.seed,
    };
    let work = RecordingRun::new((&rig, &trajectory, &path), args.yes, output)?;
    if !work.may_move() {
        return Ok(Ending::Aborted);
    }
    if let Some(images) = &args.images {
        return images::record(&work, images, args, &opening);
    }
    let list = match (args.repeat, args.resume) {
        (Some(n_runs), _) => RunList::begin(&args.out, n_runs, &rig, &trajectory),
        (None, true) => RunList::resume(&args.out, &rig, &trajectory),
        (None, false) => {
            let take = work.take(&args.out, &opening, None)?;
            output.result(&take.value, &take.text)?;
            return Ok(take.ending);
        }
    };
    let list = list.map_err(|error| match error {
        RunsError::Session(error) => anyhow::Error::from(error),
        error => WrongUse(error.to_string()).into(),
    })?;
    work.take_all(list, &opening)
}

/// What the runs of a series have in common.
struct RecordingRun<'a> {
    rig: &'a Rig,
    trajectory: &'a Trajectory,
    path: &'a ToolPath,
    operator: Operator,
    /// Where the operator is prompted; none without prompts.
    terminal: Option<prompt::Terminal>,
    output: &'a Output,
}

/// One recording that ended.
struct RecordedTake {
    ending: Ending,
    manifest: Manifest,
    value: Value,
    text: String,
}

impl<'a> RecordingRun<'a> {
    /// Listens to the operator; prompts are answered beforehand with `yes`.
    fn new(
        (rig, trajectory, path): (&'a Rig, &'a Trajectory, &'a ToolPath),
        yes: bool,
        output: &'a Output,
    ) -> anyhow::Result<Self> {
        let (operator, terminal) = (Operator::listen()?, prompt::Terminal::here(yes));
        Ok(Self { rig, trajectory, path, operator, terminal, output })
    }

    /// Records what a series still lacks; what the operator ends, or what fails, ends the series
    /// too.
    fn take_all(&self, mut list: RunList, opening: &OpenOptions<'_>) -> anyhow::Result<Ending> {
        let mut ending = Ending::Done;
        let mut text = String::new();
        while let Some(run) = list.next_run() {
            self.output.say(format_args!("run {run} of {}", list.n_runs()));
            let out = list.enter(run)?;
            // Each run draws its own noise, and the same when it is made again.
            let seed = opening.seed.wrapping_add(u64::from(run - 1));
            let take = self.take(&out, &OpenOptions { seed, ..*opening }, None)?;
            list.close(take.manifest.status)?;
            let _ = writeln!(text, "{}", take.text);
            match take.ending {
                Ending::Done => {}
                Ending::WithLosses => ending = Ending::WithLosses,
                other => {
                    ending = other;
                    break;
                }
            }
        }
        if text.is_empty() {
            text =
                format!("nothing left to record of {}", counted(u64::from(list.n_runs()), "run"));
        }
        let value = json!({
            "schema": RUNS_SCHEMA, "n_runs": list.n_runs(), "attempts": list.attempts(),
            "is_complete": list.next_run().is_none(),
        });
        self.output.result(&value, text.trim_end())?;
        Ok(ending)
    }

    /// Asks the operator before a real arm moves for the first time; false when the answer is
    /// Ctrl-C. The runs of a series follow by themselves: they are left alone overnight.
    fn may_move(&self) -> bool {
        let stop = &self.operator.stop;
        if let Some(terminal) = self.terminal.as_ref().filter(|_| self.rig.arm.port != ArmPort::Sim)
        {
            let text =
                format!("The arm will move along `{}`. Is its path clear?", self.trajectory.name);
            while stop.requested() == StopRequest::No && !terminal.is_answered(&text) {
                stop.wait(prompt::POLL_INTERVAL);
            }
        }
        stop.requested() == StopRequest::No
    }

    /// Records one session; `beside` is a recorder that the rig does not name.
    fn take(
        &self,
        out: &std::path::Path,
        opening: &OpenOptions<'_>,
        beside: Option<Box<dyn Recorder>>,
    ) -> anyhow::Result<RecordedTake> {
        let output = self.output;
        let mut open = OpenRig::open(self.rig, opening)?;
        open.devices.recorders.extend(beside);
        self.operator.can_halt(open.emergency_stop.clone());
        let bar = output.progress("recording", 1000);
        let ask = |text: &str| self.terminal.as_ref().is_none_or(|them| them.is_answered(text));
        let prompts = match self.terminal {
            Some(_) => Prompts::to(&ask),
            None => Prompts::default(),
        };
        let request = RecordRequest {
            rig: self.rig,
            trajectory: self.trajectory,
            path: self.path,
            out,
            dwells: Dwells::default(),
            prompts,
        };
        let mut message = None;
        let mut watch = |state: RecordState, share: f64| {
            bar.set_position((share * 1000.0) as u64);
            if message != Some(state) {
                message = Some(state);
                bar.set_message(state.to_string());
                output.detail(state);
            }
        };
        let outcome =
            evrig_record::record(request, &mut open.devices, &self.operator.stop, &mut watch)?;
        bar.finish_and_clear();
        for sentence in lag::slow_cameras(self.rig, &outcome.manifest) {
            output.warn(sentence);
        }
        let holds = verify(&Session::open(out)?)?.holds();
        Ok(summarise(out, outcome, holds, output))
    }
}

/// How a recording went, in words and as a value.
fn summarise(
    out: &std::path::Path,
    outcome: RecordOutcome,
    holds: bool,
    output: &Output,
) -> RecordedTake {
    let manifest = &outcome.manifest;
    let mut text = String::new();
    for stream in &manifest.streams {
        let _ = writeln!(text, "{:<16} {:>12} {}", stream.name, stream.count, stream.kind);
    }
    for loss in &manifest.losses {
        let count = if loss.count > 0 { format!(" ({})", loss.count) } else { String::new() };
        output.warn(format_args!("{}: {}{count}", loss.stream, loss.what));
    }
    let verdict = if holds { "verified" } else { "does NOT verify" };
    let _ = write!(text, "{}: {}, {verdict}", out.display(), manifest.status);
    let value = json!({
        "schema": "evrig.record/1", "session": out, "status": manifest.status, "holds": holds,
        "cut_short": outcome.cut_short, "streams": manifest.streams, "losses": manifest.losses,
    });
    let ending = match (&outcome.cut_short, holds) {
        (_, false) => Ending::Negative,
        (Some(_), _) if outcome.is_asked_for => Ending::Aborted,
        (Some(_), _) => Ending::Failed,
        (None, _) if manifest.losses.is_empty() => Ending::Done,
        (None, _) => Ending::WithLosses,
    };
    RecordedTake { ending, manifest: outcome.manifest, value, text }
}

/// Ends a recording: Ctrl-C and other termination signals stop the arm immediately; SIGUSR1 ends at
/// the next corner.
struct Operator {
    stop: StopToken,
    /// Halts the arm of the run under way.
    emergency_stop: Arc<Mutex<Option<Arc<dyn EmergencyStop>>>>,
    /// Nothing is recorded any more: signals do again what they do to any program.
    is_over: Arc<AtomicBool>,
}

impl Drop for Operator {
    fn drop(&mut self) {
        self.is_over.store(true, Ordering::SeqCst);
    }
}

impl Operator {
    fn listen() -> std::io::Result<Self> {
        let mut signals = signal_hook::iterator::Signals::new([SIGINT, SIGTERM, SIGHUP, SIGUSR1])?;
        let operator = Self {
            stop: StopToken::default(),
            emergency_stop: Arc::default(),
            is_over: Arc::default(),
        };
        let (stop, emergency_stop) = (operator.stop.clone(), Arc::clone(&operator.emergency_stop));
        let is_over = Arc::clone(&operator.is_over);
        std::thread::Builder::new().name("signals".to_owned()).spawn(move || {
            for signal in signals.forever() {
                if is_over.load(Ordering::SeqCst) {
                    // The processing behind a recording is ended by it; what it wrote is whole.
                    let _ = signal_hook::low_level::emulate_default_handler(signal);
                    continue;
                }
                if signal == SIGUSR1 {
                    stop.request(StopRequest::AfterStep);
                    continue;
                }
                // Held for a store or a load only, never while the arm is spoken to.
                let emergency_stop =
                    emergency_stop.lock().unwrap_or_else(PoisonError::into_inner).clone();
                if let Some(emergency_stop) = emergency_stop {
                    // A guard that is gone has stopped the arm already.
                    let _ = emergency_stop.halt();
                }
                stop.request(StopRequest::AtOnce);
            }
        })?;
        Ok(operator)
    }

    fn can_halt(&self, emergency_stop: Option<Arc<dyn EmergencyStop>>) {
        *self.emergency_stop.lock().unwrap_or_else(PoisonError::into_inner) = emergency_stop;
    }
}

/// The world of a description file, or the nominal one.
pub(super) fn world(path: Option<&std::path::Path>) -> anyhow::Result<WorldDescription> {
    let Some(path) = path else { return Ok(WorldDescription::default()) };
    let file = path.display().to_string();
    let text =
        std::fs::read_to_string(path).map_err(|error| WrongUse(format!("{file}: {error}")))?;
    Ok(WorldDescription::parse(&file, &text).map_err(|error| WrongUse(error.to_string()))?)
}

/// Rig, trajectory, and the feasible path of the trajectory on the rig.
pub(super) fn described(
    rig: &str,
    trajectory: &str,
    optional: OptionalSegments,
) -> anyhow::Result<(Rig, Trajectory, ToolPath)> {
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
