//! A recording, played as if its camera were here.

use super::streams::{describe, spec};
use evrig_format::aedat4::{Content, Packet, PayloadKind, ReadError, Reader};
use evrig_record::Finding;
use evrig_record::recorder::{
    PreparedRecorder, Recorder, RecorderError, RecorderMonitor, RecorderSample, RecorderTally,
    SampleSender, host_time,
};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// How fast a recording is played.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ReplaySpeed {
    /// So many times as fast as it was recorded; packets that do not fit the queue are dropped.
    Times(f64),
    /// As fast as it is taken; nothing is dropped.
    Unpaced,
}

/// Longest time to the first packet, and for which a reading thread is waited for.
const PATIENCE: Duration = Duration::from_secs(10);

/// A recording in the camera's place.
#[derive(Debug)]
pub struct ReplayDavis {
    path: PathBuf,
    pace: ReplaySpeed,
    monitor: Arc<RecorderMonitor>,
    thread: Option<JoinHandle<()>>,
}

impl ReplayDavis {
    /// Will play a file.
    #[must_use]
    pub fn new(path: &Path, pace: ReplaySpeed) -> Self {
        Self { path: path.to_owned(), pace, monitor: Arc::default(), thread: None }
    }

    fn failed(&self, because: impl ToString) -> RecorderError {
        failed(&self.path, because)
    }

    fn stop(&mut self) {
        self.monitor.end();
        if let Some(thread) = self.thread.take() {
            // A panic there was reported by its own hook.
            let _ = thread.join();
        }
    }
}

impl Recorder for ReplayDavis {
    fn name(&self) -> &'static str {
        "davis"
    }

    fn check(&mut self) -> Vec<Finding> {
        vec![match Reader::open(&self.path) {
            Ok(reader) => Finding::good(
                "davis",
                format!("plays {} of {} streams", self.path.display(), reader.streams().len()),
            ),
            Err(error) => Finding::bad("davis", error.to_string()),
        }]
    }

    fn prepare(&mut self) -> Result<PreparedRecorder, RecorderError> {
        let reader = Reader::open(&self.path).map_err(|error| self.failed(error))?;
        let streams: Vec<_> = reader.streams().iter().map(spec).collect();
        Ok(PreparedRecorder {
            description: describe(&self.path.display().to_string(), &streams),
            streams,
        })
    }

    fn start(&mut self, outlet: SampleSender) -> Result<(), RecorderError> {
        let reader = Reader::open(&self.path).map_err(|error| self.failed(error))?;
        let (path, pace) = (self.path.clone(), self.pace);
        let work = move |outlet: &SampleSender, monitor: &RecorderMonitor| {
            play(reader, pace, outlet, monitor).map_err(|error| failed(&path, error))
        };
        let thread = self.monitor.spawn("davis", outlet, work);
        self.thread = Some(thread.map_err(|error| self.failed(error))?);
        if self.monitor.wait_for_first(PATIENCE)? {
            return Ok(());
        }
        Err(self.failed("no packet came out of it"))
    }

    fn progress(&mut self) -> Result<RecorderTally, RecorderError> {
        self.monitor.progress()
    }

    fn finish(&mut self) -> Result<RecorderTally, RecorderError> {
        self.stop();
        self.monitor.progress()
    }

    fn abort(&mut self) {
        self.stop();
    }
}

impl Drop for ReplayDavis {
    fn drop(&mut self) {
        self.stop();
    }
}

fn failed(path: &Path, because: impl ToString) -> RecorderError {
    RecorderError {
        device: format!("davis at file:{}", path.display()),
        because: because.to_string(),
        remedy: "give another recording in the rig's davis.transport",
    }
}

fn play<R: std::io::Read>(
    reader: Reader<R>,
    pace: ReplaySpeed,
    outlet: &SampleSender,
    monitor: &RecorderMonitor,
) -> Result<(), ReadError> {
    let ids: Vec<u32> = reader.streams().iter().map(|stream| stream.id).collect();
    let is_known: Vec<bool> = reader
        .streams()
        .iter()
        .map(|stream| !matches!(stream.kind, PayloadKind::Other(_)))
        .collect();
    let mut began: Option<(Instant, i64)> = None;
    for packet in reader {
        let packet = packet?;
        if monitor.is_ending() {
            return Ok(());
        }
        let Some(stream) = ids.iter().position(|id| *id == packet.stream) else { continue };
        if !is_known[stream] {
            continue;
        }
        if let (ReplaySpeed::Times(times), Some(t_us)) = (pace, last_us(&packet)) {
            let (instant, first_us) = *began.get_or_insert((Instant::now(), t_us));
            let since_us = t_us.saturating_sub(first_us).max(0) as f64 / times.max(1e-6);
            let due = Duration::from_micros(since_us as u64);
            // Woken early when the recording is to end.
            monitor.wait(due.saturating_sub(instant.elapsed()), |_| !monitor.is_ending());
            if monitor.is_ending() {
                return Ok(());
            }
        }
        let (stream, arrived, content) = (stream as u32, host_time(), packet.content);
        let sample = RecorderSample::Packet { stream, arrived, content };
        match pace {
            ReplaySpeed::Unpaced => monitor.put(outlet, sample),
            ReplaySpeed::Times(_) => monitor.offer(outlet, sample),
        }
    }
    monitor.change(|state| state.tally.is_over = true);
    Ok(())
}

/// When a packet was complete on the camera's clock, µs.
fn last_us(packet: &Packet) -> Option<i64> {
    match &packet.content {
        Content::Events(events) => events.as_slice().t.last().copied(),
        Content::Frame(frame) => Some(frame.timing.stamp.as_micros()),
        Content::Imu(samples) => samples.last().map(|sample| sample.stamp.as_micros()),
        Content::Triggers(marks) => marks.last().map(|mark| mark.stamp.as_micros()),
        Content::Unknown { .. } => None,
    }
}
