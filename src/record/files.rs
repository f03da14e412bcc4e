//! The files of a recording while it runs: a thread a recorder takes samples and writes them.

use crate::device::recorder::{Inlet, Outlet, Prepared, Sample, Taken, channel};
use crate::format::aedat4::{Compression, Content, StreamSpec, WriteError, Writer};
use crate::session::{Layout, PacketArrival, RigLogError, RigLogWriter, SessionError, Severity};
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

/// Bytes that wait for the disk at most, for each recorder.
const QUEUE_BYTES: usize = 512 << 20;
/// A writer looks up so often when nothing comes.
const TICK: Duration = Duration::from_millis(100);

pub(super) type EventFile = Writer<BufWriter<File>>;

/// The directory of a session that is to be recorded: missing or empty.
pub(super) fn take_directory(root: &Path) -> Result<Layout, SessionError> {
    let io = |source| SessionError::Io { path: root.to_owned(), source };
    std::fs::create_dir_all(root).map_err(io)?;
    if std::fs::read_dir(root).map_err(io)?.next().is_some() {
        return Err(SessionError::OutputTaken { path: root.to_owned() });
    }
    Ok(Layout::new(root))
}

/// The file of packets. It is not compressed: a core cannot compress as fast as a camera can send.
pub(super) fn create_event_file(
    layout: &Layout,
    streams: &[StreamSpec],
) -> Result<EventFile, SessionError> {
    Ok(Writer::create(layout.davis(), Compression::None, streams)?)
}

/// Ends the file of packets and sees it to the disk.
pub(super) fn finish_event_file(file: EventFile, path: &Path) -> Result<(), SessionError> {
    file.finish()?;
    let synced = File::open(path).and_then(|file| file.sync_all());
    synced.map_err(|source| SessionError::Io { path: path.to_owned(), source })
}

/// The rig's log, written by every thread.
#[derive(Debug, Clone)]
pub(super) struct Log(Arc<Mutex<Option<RigLogWriter>>>);

impl Log {
    pub(super) fn create(layout: &Layout) -> Result<Self, SessionError> {
        let writer = RigLogWriter::create(&layout.rig_log())?;
        Ok(Self(Arc::new(Mutex::new(Some(writer)))))
    }

    fn lock(&self) -> MutexGuard<'_, Option<RigLogWriter>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Writes, unless the log was finished.
    pub(super) fn write(
        &self,
        write: impl FnOnce(&mut RigLogWriter) -> Result<(), RigLogError>,
    ) -> Result<(), SessionError> {
        self.lock().as_mut().map_or(Ok(()), |log| write(log).map_err(Into::into))
    }

    pub(super) fn finish(&self) -> Result<(), SessionError> {
        let writer = self.lock().take();
        writer.map_or(Ok(()), |log| log.finish().map_err(Into::into))
    }
}

/// One recorder's thread.
#[derive(Debug)]
pub(super) struct SampleWriter {
    thread: Option<JoinHandle<Result<(), SessionError>>>,
}

impl SampleWriter {
    /// Makes the recorder's file, if it delivers packets, and starts to take its samples.
    pub(super) fn start(
        layout: &Layout,
        prepared: &Prepared,
        log: &Log,
    ) -> Result<(Self, Outlet), SessionError> {
        let path = layout.davis();
        let file = if prepared.streams.is_empty() {
            None
        } else {
            Some((create_event_file(layout, &prepared.streams)?, path.clone()))
        };
        let (outlet, inlet) = channel(QUEUE_BYTES);
        let log = log.clone();
        let thread = std::thread::Builder::new()
            .name("writer".to_owned())
            .spawn(move || take_all(&inlet, file, &log))
            .map_err(|source| SessionError::Io { path, source })?;
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

fn take_all(
    inlet: &Inlet,
    file: Option<(EventFile, PathBuf)>,
    log: &Log,
) -> Result<(), SessionError> {
    let (mut file, path) = file.unzip();
    loop {
        match inlet.take(TICK) {
            Taken::Sample(sample) => write(sample, file.as_mut(), log)?,
            Taken::Nothing => {}
            Taken::Closed => break,
        }
    }
    if let (Some(file), Some(path)) = (file, path) {
        finish_event_file(file, &path)?;
    }
    Ok(())
}

/// Writes one sample where it belongs.
pub(super) fn write(
    sample: Sample,
    file: Option<&mut EventFile>,
    log: &Log,
) -> Result<(), SessionError> {
    match sample {
        Sample::Clock(reading) => log.write(|log| log.clock(&reading)),
        Sample::Frame { arrived, frame } => log.write(|log| log.frame(&frame, arrived)),
        Sample::LateRgb { arrived, frame } => log.write(|log| log.late_rgb(&frame, arrived)),
        Sample::Note { at, text } => log.write(|log| log.log(at, Severity::Info, &text)),
        Sample::Packet { stream, arrived, content } => {
            if let Some(file) = file {
                put(file, stream, &content)?;
            }
            let Some((count, first_us, last_us)) = extent(&content) else { return Ok(()) };
            let arrival = PacketArrival { stream, count, first_us, last_us, arrived };
            log.write(|log| log.arrival(&arrival))
        }
    }
}

fn put(file: &mut EventFile, stream: u32, content: &Content) -> Result<(), WriteError> {
    match content {
        Content::Events(events) => file.write_events(stream, events.as_slice()),
        Content::Frame(frame) => file.write_frame(stream, frame),
        Content::Imu(samples) => file.write_imu(stream, samples),
        Content::Triggers(marks) => file.write_triggers(stream, marks),
        Content::Unknown { .. } => Ok(()),
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
            let at = |sample: &crate::imu::ImuSample| sample.stamp.as_micros();
            of(samples.len(), samples.first().map(at), samples.last().map(at))
        }
        Content::Triggers(marks) => {
            let at = |mark: &crate::imu::Trigger| mark.stamp.as_micros();
            of(marks.len(), marks.first().map(at), marks.last().map(at))
        }
        Content::Unknown { .. } => None,
    }
}
