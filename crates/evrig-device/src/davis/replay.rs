//! A recording, played as if its camera were here.

use super::{says, spec};
use evrig_format::aedat4::{Content, Packet, PayloadKind, ReadError, Reader};
use evrig_record::Finding;
use evrig_record::recorder::{
    Account, Outlet, Prepared, Recorder, RecorderError, Sample, Tally, host_time,
};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// How fast a recording is played.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Pace {
    /// So many times as fast as it was recorded; packets for which there is no room are dropped.
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
    pace: Pace,
    account: Arc<Account>,
    thread: Option<JoinHandle<()>>,
}

impl ReplayDavis {
    /// Will play a file.
    #[must_use]
    pub fn new(path: &Path, pace: Pace) -> Self {
        Self { path: path.to_owned(), pace, account: Arc::default(), thread: None }
    }

    fn failed(&self, because: impl ToString) -> RecorderError {
        failed(&self.path, because)
    }

    fn stop(&mut self) {
        self.account.end();
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

    fn prepare(&mut self) -> Result<Prepared, RecorderError> {
        let reader = Reader::open(&self.path).map_err(|error| self.failed(error))?;
        let streams: Vec<_> = reader.streams().iter().map(spec).collect();
        Ok(Prepared { says: says(&self.path.display().to_string(), &streams), streams })
    }

    fn start(&mut self, outlet: Outlet) -> Result<(), RecorderError> {
        let reader = Reader::open(&self.path).map_err(|error| self.failed(error))?;
        let (path, pace) = (self.path.clone(), self.pace);
        let work = move |outlet: &Outlet, account: &Account| {
            play(reader, pace, outlet, account).map_err(|error| failed(&path, error))
        };
        let thread = self.account.spawn("davis", outlet, work);
        self.thread = Some(thread.map_err(|error| self.failed(error))?);
        if self.account.wait_for_first(PATIENCE)? {
            return Ok(());
        }
        Err(self.failed("no packet came out of it"))
    }

    fn progress(&mut self) -> Result<Tally, RecorderError> {
        self.account.progress()
    }

    fn finish(&mut self) -> Result<Tally, RecorderError> {
        self.stop();
        self.account.progress()
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
    pace: Pace,
    outlet: &Outlet,
    account: &Account,
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
        if account.is_ending() {
            return Ok(());
        }
        let Some(stream) = ids.iter().position(|id| *id == packet.stream) else { continue };
        if !is_known[stream] {
            continue;
        }
        if let (Pace::Times(times), Some(t_us)) = (pace, last_us(&packet)) {
            let (instant, first_us) = *began.get_or_insert((Instant::now(), t_us));
            let since_us = t_us.saturating_sub(first_us).max(0) as f64 / times.max(1e-6);
            let due = Duration::from_micros(since_us as u64);
            // Woken early when the recording is to end.
            account.wait(due.saturating_sub(instant.elapsed()), |_| !account.is_ending());
            if account.is_ending() {
                return Ok(());
            }
        }
        let (stream, arrived, content) = (stream as u32, host_time(), packet.content);
        let sample = Sample::Packet { stream, arrived, content };
        match pace {
            Pace::Unpaced => account.put(outlet, sample),
            Pace::Times(_) => account.offer(outlet, sample),
        }
    }
    account.change(|state| state.tally.is_over = true);
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
