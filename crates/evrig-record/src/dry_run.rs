//! A dry run: cameras run and are recorded by the threads, queues and writers of a recording, but
//! into two pipes, at whose other ends everything is read back and discarded ([`RecordingCheck`]).
//!
//! It shows that a machine keeps up for any length of time without a disk that holds it all.
//! Nothing moves, and no session is made.

use super::files::{QUEUE_BYTES, SampleWriter, SharedRigLog};
use super::{StopRequest, StopToken};
use crate::recorder::{Recorder, RecorderError, RecorderTally, host_time};
use evrig_core::time::Span;
use evrig_format::aedat4::Compression;
use evrig_session::{RecordingCheck, SessionError, Severity};
use rustix::time::{ClockId, clock_gettime};
use std::io::{PipeReader, PipeWriter, Write, pipe};
use std::time::{Duration, Instant};

/// Length and limits of a dry run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DryRun {
    /// The cameras run so long.
    pub length: Duration,
    /// Bytes queued for a writer at most, for each camera; samples beyond are dropped and counted.
    pub queue_bytes: usize,
    /// How the events are compressed, as a rig states it for its recordings.
    pub compression: Compression,
}

impl DryRun {
    /// With the queue of a recording, without compression.
    #[must_use]
    pub const fn of(length: Duration) -> Self {
        Self { length, queue_bytes: QUEUE_BYTES, compression: Compression::None }
    }
}

/// The result of a dry run.
#[derive(Debug, Clone)]
pub struct DryRunResult {
    /// What each camera delivered and lost, in the order of the cameras.
    pub tallies: Vec<RecorderTally>,
    /// What was read back.
    pub check: RecordingCheck,
    /// Processor time of reading it back, which no recording needs.
    pub check_cpu: Span,
}

/// Why a dry run failed.
#[derive(Debug, thiserror::Error)]
pub enum DryRunError {
    /// A camera cannot run, or was lost.
    #[error(transparent)]
    Recorder(#[from] RecorderError),
    /// A writer failed.
    #[error(transparent)]
    Session(#[from] SessionError),
    /// The system has no pipe or no thread left.
    #[error("no pipe or thread for the dry run: {0}; close other programs")]
    System(#[from] std::io::Error),
}

/// Between two polls of the cameras.
const POLL_INTERVAL: Duration = Duration::from_millis(100);
/// The system keeps so much of a pipe, where it lets us: fewer, longer turns of writer and reader.
const PIPE_BYTES: usize = 1 << 20;

/// Makes a dry run of these cameras, of which at most one delivers packets. `watch` gets the time
/// since the start and the cameras' tallies.
///
/// # Errors
/// When a camera cannot run or is lost, or the system refuses pipes or threads.
pub fn dry_run(
    recorders: &mut [Box<dyn Recorder>],
    rehearsal: DryRun,
    stop: &StopToken,
    watch: &mut dyn FnMut(Duration, &[RecorderTally]),
) -> Result<DryRunResult, DryRunError> {
    let (davis_end, davis) = wide_pipe()?;
    let (log_end, log) = wide_pipe()?;
    std::thread::scope(|scope| {
        let davis_heard = std::thread::Builder::new()
            .name("check".to_owned())
            .spawn_scoped(scope, move || timed(|| RecordingCheck::of_davis(davis_end)))?;
        let log_heard = std::thread::Builder::new()
            .name("check".to_owned())
            .spawn_scoped(scope, move || timed(|| RecordingCheck::of_rig_log(log_end)))?;
        let ran = run(recorders, rehearsal, [davis, log], stop, watch);
        // Every writing end is closed by now, so both end.
        let ((davis, its_cpu), (log, logs_cpu)) = match (davis_heard.join(), log_heard.join()) {
            (Ok(davis), Ok(log)) => (davis, log),
            // A panic there was reported by its own hook.
            _ => return Err(std::io::Error::other("the reading end failed").into()),
        };
        let (check, check_cpu) = (RecordingCheck::joined(davis, log), its_cpu + logs_cpu);
        ran.map(|tallies| DryRunResult { tallies, check, check_cpu })
    })
}

fn wide_pipe() -> std::io::Result<(PipeReader, PipeWriter)> {
    let (reader, writer) = pipe()?;
    // A system that allows less keeps what it gave.
    let _ = rustix::pipe::fcntl_setpipe_size(&writer, PIPE_BYTES);
    Ok((reader, writer))
}

/// What comes of some work, and this thread's processor time for it.
fn timed<T>(work: impl FnOnce() -> T) -> (T, Span) {
    let cpu = || {
        let time = clock_gettime(ClockId::ThreadCPUTime);
        Span::from_nanos(time.tv_sec * 1_000_000_000 + time.tv_nsec)
    };
    let before = cpu();
    let done = work();
    (done, cpu() - before)
}

fn run(
    recorders: &mut [Box<dyn Recorder>],
    rehearsal: DryRun,
    [davis, log]: [PipeWriter; 2],
    stop: &StopToken,
    watch: &mut dyn FnMut(Duration, &[RecorderTally]),
) -> Result<Vec<RecorderTally>, DryRunError> {
    let log = SharedRigLog::to_pipe(Box::new(log))?;
    let mut writers = Vec::new();
    let ran = start(recorders, rehearsal, davis, &log, &mut writers)
        .and_then(|()| look_on(recorders, rehearsal.length, stop, watch));
    if ran.is_err() {
        recorders.iter_mut().for_each(|recorder| recorder.abort());
    }
    let ends: Vec<_> = recorders.iter_mut().map(|recorder| recorder.finish()).collect();
    let written: Vec<_> = writers.iter_mut().map(SampleWriter::finish).collect();
    let logged = log.finish();
    ran?;
    written.into_iter().chain([logged]).collect::<Result<(), _>>()?;
    Ok(ends.into_iter().collect::<Result<Vec<_>, _>>()?)
}

fn start(
    recorders: &mut [Box<dyn Recorder>],
    rehearsal: DryRun,
    davis: PipeWriter,
    log: &SharedRigLog,
    writers: &mut Vec<SampleWriter>,
) -> Result<(), DryRunError> {
    let mut davis = Some(davis);
    let limits = (rehearsal.queue_bytes, rehearsal.compression);
    for recorder in recorders {
        let prepared = recorder.prepare()?;
        let pipe: Box<dyn Write + Send> = if prepared.streams.is_empty() {
            Box::new(std::io::sink())
        } else {
            Box::new(davis.take().ok_or_else(|| two_of_packets(recorder.name()))?)
        };
        let (writer, outlet) = SampleWriter::into_pipe(pipe, &prepared, log, limits)?;
        writers.push(writer);
        recorder.start(outlet)?;
    }
    Ok(log.write(|log| log.log(host_time(), Severity::Info, "rehearsal"))?)
}

fn look_on(
    recorders: &mut [Box<dyn Recorder>],
    length: Duration,
    stop: &StopToken,
    watch: &mut dyn FnMut(Duration, &[RecorderTally]),
) -> Result<(), DryRunError> {
    let began = Instant::now();
    while began.elapsed() < length && stop.wait(POLL_INTERVAL) == StopRequest::No {
        let mut tallies = Vec::new();
        for recorder in &mut *recorders {
            tallies.push(recorder.progress()?);
        }
        watch(began.elapsed(), &tallies);
    }
    Ok(())
}

fn two_of_packets(name: &str) -> DryRunError {
    RecorderError {
        device: name.to_owned(),
        because: "two cameras deliver packets, and a session holds those of one".to_owned(),
        remedy: "dry_run them one after the other",
    }
    .into()
}
