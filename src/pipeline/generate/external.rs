//! Events by a simulator of other software: a command that is run on a stream's frames.

mod process_group;
mod simulator;
mod work_folder;

pub use simulator::ExternalSimulator;

use super::output::{GenerateTally, Generated, open, refuse_recorded, stage};
use crate::pipeline::PipelineError;
use crate::pipeline::error::missing;
use crate::pipeline::luminance::{self, luminance};
use crate::pipeline::scene_source::is_scene;
use evrig_core::event::{Event, Events};
use evrig_generate::{PhaseLocking, RowShift, RowTimes};
use evrig_session::import::read_simulated_events;
use evrig_session::{Session, StreamKind, StreamName};
use process_group::GroupEnd;
use simulator::ResolvedCommand;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use work_folder::WorkFolder;

/// A request to generate events by a simulator of other software.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ExternalRequest {
    /// The simulator.
    pub simulator: ExternalSimulator,
    /// Folder of the list that describes it, absolute; relative files are found there.
    pub folder: PathBuf,
    /// Value of `{seed}` unless the simulator states its own.
    pub seed: u64,
    /// Run even when the result is fresh.
    pub force: bool,
}

impl ExternalRequest {
    /// Name of the stream to make.
    ///
    /// # Errors
    /// When it is no name of a stream.
    pub fn name(&self) -> Result<StreamName, PipelineError> {
        Ok(StreamName::new(&self.simulator.name)?)
    }

    fn seed(&self) -> u64 {
        self.simulator.seed.unwrap_or(self.seed)
    }
}

/// Runs a simulator on a stream's frames, unless its result is fresh: from the same frames, command
/// and files. `progress` takes frames written and in all.
///
/// The command runs in a folder of its own below `derived`, which is removed when it succeeds; when
/// it fails, its log is kept there.
///
/// # Errors
/// [`PipelineError::Request`] for a wrong description, [`PipelineError::External`] when the command
/// fails or its output is not events of these frames.
pub fn generate_external(
    session: &Session,
    request: &ExternalRequest,
    progress: &mut dyn FnMut(u64, u64),
) -> Result<Generated, PipelineError> {
    let simulator = &request.simulator;
    let name = request.name()?;
    let command = simulator.resolve(&request.folder)?;
    simulator.table_options()?;
    simulator.preparation()?;
    refuse_recorded(session, &name)?;
    if is_scene(session, &simulator.from) {
        let what = "a command takes frames, and the scene has none; choose a frame stream";
        return Err(missing(session, format!("variant `{name}`: {what}")));
    }
    let inputs = luminance::inputs_of(session, &simulator.from)?;
    let parameters = simulator.parameters(&command, request.seed());
    stage(session, &name, request.force, inputs, parameters, || {
        run(session, request, &name, &command, progress)
    })
}

fn run(
    session: &Session,
    request: &ExternalRequest,
    name: &StreamName,
    command: &ResolvedCommand,
    progress: &mut dyn FnMut(u64, u64),
) -> Result<(GenerateTally, Duration), PipelineError> {
    let from = &request.simulator.from;
    let n_frames = session.stream(StreamKind::Frames, from)?.count;
    let mut frames = luminance(session, from)?.prepared(request.simulator.preparation()?);
    let root = session.layout().derived("external", Some(name));
    // Absolute, since the command runs in another folder.
    let root =
        std::path::absolute(&root).map_err(|source| PipelineError::Io { path: root, source })?;
    let work = WorkFolder::make(root, session, from, &mut frames, &mut |n| progress(n, n_frames))?;
    let rows = frames.rows(work.size);
    let began = Instant::now();
    let made = simulate(request, command, &work, &mut || progress(n_frames, n_frames));
    let spent = began.elapsed();
    let made = made.map_err(|what| {
        work.keep_log();
        let (log, last_lines) = (work.log(), last_lines(&work.log()));
        PipelineError::External { stream: name.to_string(), what, log, last_lines }
    })?;
    let tally = write(session, name, &work, rows, &made)?;
    std::fs::remove_dir_all(work.root())
        .map_err(|source| PipelineError::Io { path: work.root().to_owned(), source })?;
    Ok((tally, spent))
}

/// Runs the command and reads its events, µs since the first frame.
fn simulate(
    request: &ExternalRequest,
    command: &ResolvedCommand,
    work: &WorkFolder,
    waiting: &mut dyn FnMut(),
) -> Result<Events, String> {
    let simulator = &request.simulator;
    let words = command.words(work, request.seed());
    let deadline = simulator.deadline();
    let end = process_group::run(&words, work.root(), &work.log(), deadline, waiting);
    match end {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
            return Err(format!("command not found: `{}`; install it or check PATH", words[0]));
        }
        Err(error) => return Err(format!("`{}` cannot be run: {error}", words[0])),
        Ok(GroupEnd::OutOfTime) => {
            let seconds = deadline.as_secs();
            return Err(format!(
                "the command was killed at its deadline of {seconds} s; state a longer one with \
                 the key deadline_s"
            ));
        }
        Ok(GroupEnd::Exited(status)) if !status.success() => {
            return Err(format!("the command failed: {status}"));
        }
        Ok(GroupEnd::Exited(_)) => {}
    }
    let path = work
        .event_file(simulator.output.as_deref())
        .map_err(|what| format!("the command ended without its output: {what}"))?;
    let options = simulator.table_options().map_err(|error| error.to_string())?;
    read_simulated_events(&path, work.size, work.last_us(), &options)
        .map_err(|error| format!("its output cannot be used: {error}"))
}

/// Places the events on the session's clock, each row at its own time, and writes the stream.
fn write(
    session: &Session,
    name: &StreamName,
    work: &WorkFolder,
    rows: RowTimes,
    made: &Events,
) -> Result<GenerateTally, PipelineError> {
    let [first_us, last_us] = [work.times_us[0], work.times_us[0] + work.last_us()];
    let placed: Events =
        made.as_slice().iter().map(|event| Event { t: event.t + first_us, ..event }).collect();
    let mut rhythm = PhaseLocking::default();
    rhythm.add_between(placed.as_slice(), &work.times_us);
    let (mut shift, mut events) = (RowShift::default(), Events::new());
    shift.push(rows, work.size, last_us, &placed, &mut events);
    shift.finish(&mut events);
    let mut writer = open(session, name, "external", work.size)?;
    writer.write_events(0, events.as_slice())?;
    writer.finish()?;
    Ok(GenerateTally {
        n_frames: work.times_us.len() as u64,
        n_frames_not_later: work.n_not_later,
        n_events: events.len() as u64,
        n_on: events.as_slice().count_on() as u64,
        first_us,
        last_us,
        n_pixels: work.size.n_pixels() as u64,
        n_filled_in_place: 0,
        frame_rhythm: Some(rhythm.strength()).filter(|strength| strength.is_finite()),
    })
}

/// Lines of a log that an error shows: a Python error with its last two calls has seven.
const N_LOG_LINES: usize = 8;
/// Bytes that hold them.
const LOG_END_BYTES: u64 = 16 << 10;

/// The last lines of a log, each on a line of its own; empty where it has none.
fn last_lines(log: &Path) -> String {
    let read = || -> std::io::Result<Vec<u8>> {
        let mut file = std::fs::File::open(log)?;
        let n_bytes = file.metadata()?.len();
        file.seek(SeekFrom::Start(n_bytes.saturating_sub(LOG_END_BYTES)))?;
        let mut end = Vec::new();
        file.read_to_end(&mut end)?;
        Ok(end)
    };
    // The error that is reported is the command's.
    let text = read().unwrap_or_default();
    let text = String::from_utf8_lossy(&text);
    let lines: Vec<&str> = text.lines().filter(|line| !line.trim().is_empty()).collect();
    let last = &lines[lines.len().saturating_sub(N_LOG_LINES)..];
    last.iter().map(|line| format!("\n    {line}")).collect()
}
