//! The files of a recording while it runs: a thread a recorder takes samples and writes them.

use super::disk_sync::DiskSync;
use crate::recorder::{
    PreparedRecorder, Received, RecorderSample, SampleReceiver, SampleSender, channel,
};
use evrig_core::time::Span;
use evrig_core::units::Hertz;
use evrig_format::Destination;
use evrig_format::aedat4::{Compression, Content, StreamSpec, WriteError, Writer};
use evrig_session::trajectory::ToolPath as Trace;
use evrig_session::{
    HostTime, PacketArrival, RigLogError, RigLogWriter, SessionError, SessionLayout, Severity,
    Topic,
};
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Bytes that wait for the disk at most, for each recorder.
pub(super) const QUEUE_BYTES: usize = 512 << 20;
/// Between two checks of an idle writer.
const POLL_INTERVAL: Duration = Duration::from_millis(100);
/// Between two flushes of a file of packets.
const BETWEEN_FLUSHES: Duration = Duration::from_millis(200);

/// The AEDAT4 file of a session under way.
pub type EventFile = Writer<BufWriter<Destination>>;

/// The directory of a session that is to be recorded: missing or empty.
pub fn take_directory(root: &Path) -> Result<SessionLayout, SessionError> {
    let io = |source| SessionError::Io { path: root.to_owned(), source };
    std::fs::create_dir_all(root).map_err(io)?;
    if std::fs::read_dir(root).map_err(io)?.next().is_some() {
        return Err(SessionError::OutputTaken { path: root.to_owned() });
    }
    Ok(SessionLayout::new(root))
}

/// The file of packets.
pub fn create_event_file(
    layout: &SessionLayout,
    compression: Compression,
    streams: &[StreamSpec],
) -> Result<EventFile, SessionError> {
    create_synced_event_file(layout, compression, streams).map(|(file, _)| file)
}

/// The same, with a second handle for syncing.
fn create_synced_event_file(
    layout: &SessionLayout,
    compression: Compression,
    streams: &[StreamSpec],
) -> Result<(EventFile, File), SessionError> {
    let path = layout.davis();
    let made = File::create(&path).and_then(|file| Ok((file.try_clone()?, file)));
    let (beside, file) =
        made.map_err(|source| WriteError::Create { path: path.clone(), source })?;
    let file = event_file(Destination::File(file), &path, compression, streams)?;
    Ok((file, beside))
}

fn event_file(
    destination: Destination,
    path: &Path,
    compression: Compression,
    streams: &[StreamSpec],
) -> Result<EventFile, SessionError> {
    let name = path.display().to_string();
    Ok(Writer::as_recorded(destination, &name, compression, streams)?)
}

/// Ends the file of packets and syncs it to the disk.
pub fn finish_event_file(file: EventFile, path: &Path) -> Result<(), SessionError> {
    file.finish()?;
    let synced = File::open(path).and_then(|file| file.sync_all());
    synced.map_err(|source| SessionError::Io { path: path.to_owned(), source })
}

/// The rig's log, shared by all threads.
#[derive(Debug, Clone)]
pub struct SharedRigLog {
    writer: Arc<Mutex<Option<RigLogWriter>>>,
    disk_sync: Arc<Mutex<DiskSync>>,
}

impl SharedRigLog {
    pub(super) fn create(layout: &SessionLayout) -> Result<Self, SessionError> {
        Self::flushed_by(layout, flush)
    }

    /// A log in virtual time, whose chunks end by its own time only: the same
    /// bytes whatever the pace.
    pub fn in_virtual_time(layout: &SessionLayout) -> Result<Self, SessionError> {
        Self::flushed_by(layout, |log| log.strong_count() > 0)
    }

    fn flushed_by(
        layout: &SessionLayout,
        flush: fn(&Weak<Mutex<Option<RigLogWriter>>>) -> bool,
    ) -> Result<Self, SessionError> {
        let path = layout.rig_log();
        let writer = RigLogWriter::create(&path)?;
        Self::over(writer, &path, flush)
    }

    /// A log into a pipe, flushed as often as one on a disk.
    pub(super) fn to_pipe(pipe: Box<dyn Write + Send>) -> Result<Self, SessionError> {
        let path = SessionLayout::new(Path::new("")).rig_log();
        Self::over(RigLogWriter::to_pipe(pipe, &path)?, &path, flush)
    }

    fn over(
        writer: RigLogWriter,
        path: &Path,
        flush: fn(&Weak<Mutex<Option<RigLogWriter>>>) -> bool,
    ) -> Result<Self, SessionError> {
        let io = |source| SessionError::Io { path: path.to_owned(), source };
        let handle = writer.handle()?;
        let writer = Arc::new(Mutex::new(Some(writer)));
        let flushed = Arc::downgrade(&writer);
        let disk_sync = DiskSync::start(move || flush(&flushed)).map_err(io)?;
        if let Some(handle) = handle {
            disk_sync.keep(path, handle).map_err(io)?;
        }
        Ok(Self { writer, disk_sync: Arc::new(Mutex::new(disk_sync)) })
    }

    fn lock(&self) -> MutexGuard<'_, Option<RigLogWriter>> {
        self.writer.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Syncs another file beside the log's.
    fn keep(&self, path: &Path, file: File) -> Result<(), SessionError> {
        let disk_sync = self.disk_sync.lock().unwrap_or_else(PoisonError::into_inner);
        disk_sync
            .keep(path, file)
            .map_err(|source| SessionError::Io { path: path.to_owned(), source })
    }

    /// Writes, unless the log was finished.
    pub fn write(
        &self,
        write: impl FnOnce(&mut RigLogWriter) -> Result<(), RigLogError>,
    ) -> Result<(), SessionError> {
        self.lock().as_mut().map_or(Ok(()), |log| write(log).map_err(Into::into))
    }

    /// The commanded poses of a part of the path, `from` to `to`, at the rate of the poses;
    /// it was begun at `began`.
    pub fn commanded(
        &self,
        path: &Trace,
        [from, to]: [Span; 2],
        rate: Hertz,
        began: HostTime,
    ) -> Result<(), SessionError> {
        let step = Span::from_secs_f64(1.0 / rate.0);
        let mut since = Span::ZERO;
        while from + since <= to {
            let at = HostTime { monotonic: began.monotonic + since, unix: began.unix + since };
            self.write(|log| log.pose(Topic::Commanded, at, path.pose_at(from + since)))?;
            since = since + step;
        }
        Ok(())
    }

    /// Writes what is buffered and closes the log.
    pub fn finish(&self) -> Result<(), SessionError> {
        let writer = self.lock().take();
        let finished = writer.map_or(Ok(()), |log| log.finish().map_err(Into::into));
        let unsynced = self.disk_sync.lock().unwrap_or_else(PoisonError::into_inner).finish();
        match unsynced {
            Some(what) => finished.and(Err(SessionError::Unsynced { what })),
            None => finished,
        }
    }
}

/// Hands the log to the system; false once the log is no more.
fn flush(log: &Weak<Mutex<Option<RigLogWriter>>>) -> bool {
    let Some(log) = log.upgrade() else { return false };
    let mut log = log.lock().unwrap_or_else(PoisonError::into_inner);
    // A disk that refuses now refuses the next message, and is reported there.
    log.as_mut().is_some_and(|log| log.flush().is_ok())
}

/// One recorder's thread.
#[derive(Debug)]
pub(super) struct SampleWriter {
    thread: Option<JoinHandle<Result<(), SessionError>>>,
}

impl SampleWriter {
    /// Makes the recorder's file, if it delivers packets, and starts to take its samples.
    pub(super) fn start(
        layout: &SessionLayout,
        compression: Compression,
        prepared: &PreparedRecorder,
        log: &SharedRigLog,
    ) -> Result<(Self, SampleSender), SessionError> {
        if prepared.streams.is_empty() {
            return Self::take_from(QUEUE_BYTES, None, log);
        }
        let path = layout.davis();
        let (file, beside) = create_synced_event_file(layout, compression, &prepared.streams)?;
        log.keep(&path, beside)?;
        Self::take_from(QUEUE_BYTES, Some((file, FileEnd::Synced(path))), log)
    }

    /// The same into a pipe.
    pub(super) fn into_pipe(
        pipe: Box<dyn Write + Send>,
        prepared: &PreparedRecorder,
        log: &SharedRigLog,
        (queue_bytes, compression): (usize, Compression),
    ) -> Result<(Self, SampleSender), SessionError> {
        if prepared.streams.is_empty() {
            return Self::take_from(queue_bytes, None, log);
        }
        let path = SessionLayout::new(Path::new("")).davis();
        let file = event_file(Destination::pipe(pipe), &path, compression, &prepared.streams)?;
        Self::take_from(queue_bytes, Some((file, FileEnd::Flushed)), log)
    }

    fn take_from(
        queue_bytes: usize,
        file: Option<(EventFile, FileEnd)>,
        log: &SharedRigLog,
    ) -> Result<(Self, SampleSender), SessionError> {
        let (outlet, inlet) = channel(queue_bytes);
        let log = log.clone();
        let thread = std::thread::Builder::new()
            .name("writer".to_owned())
            .spawn(move || take_all(&inlet, file, &log))
            .map_err(|source| SessionError::Io { path: PathBuf::new(), source })?;
        Ok((Self { thread: Some(thread) }, outlet))
    }

    /// Whether it gave up before the recorder did.
    pub(super) fn has_ended(&self) -> bool {
        self.thread.as_ref().is_some_and(JoinHandle::is_finished)
    }

    /// Waits until everything is written; the recorder must have let go of its outlet.
    pub(super) fn finish(&mut self) -> Result<(), SessionError> {
        match self.thread.take().map(JoinHandle::join) {
            Some(Ok(written)) => written,
            // A panic there was reported by its own hook.
            Some(Err(_)) | None => Ok(()),
        }
    }
}

/// How a file of packets ends.
#[derive(Debug)]
enum FileEnd {
    /// With its data table, on the disk at this place.
    Synced(PathBuf),
    /// With its last packet, flushed.
    Flushed,
}

fn take_all(
    inlet: &SampleReceiver,
    file: Option<(EventFile, FileEnd)>,
    log: &SharedRigLog,
) -> Result<(), SessionError> {
    let (mut file, end) = file.unzip();
    let mut flushed = Instant::now();
    loop {
        match inlet.take(POLL_INTERVAL) {
            Received::Sample(sample) => write(sample, file.as_mut(), log)?,
            Received::Nothing => {}
            Received::Closed => break,
        }
        // In a quiet scene a buffer fills slowly, and what is in it dies with the program.
        if let Some(file) = file.as_mut().filter(|_| flushed.elapsed() >= BETWEEN_FLUSHES) {
            file.flush()?;
            flushed = Instant::now();
        }
    }
    match (file, end) {
        (Some(file), Some(FileEnd::Synced(path))) => finish_event_file(file, &path),
        (Some(mut file), Some(FileEnd::Flushed)) => Ok(file.flush()?),
        _ => Ok(()),
    }
}

/// Writes one sample where it belongs.
pub fn write(
    sample: RecorderSample,
    file: Option<&mut EventFile>,
    log: &SharedRigLog,
) -> Result<(), SessionError> {
    match sample {
        RecorderSample::Clock(reading) => log.write(|log| log.clock(&reading)),
        RecorderSample::Frame { arrived, frame } => log.write(|log| log.frame(&frame, arrived)),
        RecorderSample::LateRgb { arrived, frame } => {
            log.write(|log| log.late_rgb(&frame, arrived))
        }
        RecorderSample::Note { at, text } => log.write(|log| log.log(at, Severity::Info, &text)),
        RecorderSample::Packet { stream, arrived, content } => {
            if let Some(file) = file {
                content.write(file, stream)?;
            }
            let Some((count, first_us, last_us)) = extent(&content) else { return Ok(()) };
            let arrival = PacketArrival { stream, count, first_us, last_us, arrived };
            log.write(|log| log.arrival(&arrival))
        }
    }
}

/// Number, first and last stamp of what a packet holds; none for an empty one.
fn extent(content: &Content) -> Option<(u64, i64, i64)> {
    let of = |n: usize, first: Option<i64>, last: Option<i64>| Some((n as u64, first?, last?));
    match content {
        Content::Events(events) => {
            let t = events.as_slice().t;
            of(t.len(), t.first().copied(), t.last().copied())
        }
        Content::Frame(frame) => {
            let t = frame.timing.stamp.as_micros();
            of(1, Some(t), Some(t))
        }
        Content::Imu(samples) => {
            let at = |sample: &evrig_core::imu::ImuSample| sample.stamp.as_micros();
            of(samples.len(), samples.first().map(at), samples.last().map(at))
        }
        Content::Triggers(marks) => {
            let at = |mark: &evrig_core::imu::Trigger| mark.stamp.as_micros();
            of(marks.len(), marks.first().map(at), marks.last().map(at))
        }
        Content::Unknown { .. } => None,
    }
}
