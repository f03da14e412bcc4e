//! What the recorder is loaded with: an event camera and a frame camera that make the same samples
//! every time, and know what they made.

use evrig::event::{Event, Events};
use evrig::format::aedat4::{Content, Reader, StreamSpec};
use evrig::geometry::Size;
use evrig::pi_camera::{FrameMetadata, PiFrame};
use evrig::raw10;
use evrig::record::Finding;
use evrig::record::recorder::{
    PreparedRecorder, Recorder, RecorderError, RecorderSample, RecorderTally, SampleSender,
    host_time,
};
use evrig::session::{EventChecksum, ImageChecksum};
use evrig::time::{Span, Stamp};
use rustix::time::{ClockId, clock_gettime};
use std::sync::atomic::{AtomicBool, AtomicI64, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

pub const EVENTS_PER_S: u64 = 12_000_000;
const PACKET: Duration = Duration::from_millis(10);
pub const FRAMES_PER_S: u32 = 120;
const PI: Size = Size::new(692, 520);

/// The cameras, as the engine takes them.
pub type Recorders = Vec<Box<dyn Recorder>>;

/// How samples come.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pace {
    /// At their rates, until the recording ends.
    Real,
    /// So many of each camera, as fast as they can be made.
    Unpaced(u64),
}

pub fn cpu_ns(clock: ClockId) -> i64 {
    let time = clock_gettime(clock);
    time.tv_sec * 1_000_000_000 + time.tv_nsec
}

/// What was made and taken by the recorder.
#[derive(Debug, Default, Clone, Copy)]
pub struct Made {
    pub n_events: u64,
    pub event_sum: u64,
    pub n_raw: u64,
    pub raw_sum: u64,
    pub n_rgb: u64,
    pub rgb_sum: u64,
}

/// Sums under way.
#[derive(Default)]
struct Sums {
    events: EventChecksum,
    raw: ImageChecksum,
    rgb: ImageChecksum,
    made: Made,
}

/// Both cameras' books.
#[derive(Clone, Default)]
pub struct Load {
    sums: Arc<Mutex<Sums>>,
    /// Processor time of the cameras' threads, written by each as it goes.
    cpu: Arc<[AtomicI64; 2]>,
    has_ended: Arc<[AtomicBool; 2]>,
}

impl Load {
    /// The books, and the cameras.
    pub fn new(pace: Pace) -> (Self, Recorders) {
        let load = Self::default();
        let recorders: Recorders = vec![davis(&load, pace), pi(&load, pace)];
        (load, recorders)
    }

    /// Whether both cameras have made all they were to make.
    pub fn has_ended(&self) -> bool {
        self.has_ended.iter().all(|has_ended| has_ended.load(Ordering::SeqCst))
    }

    /// Processor time that making the samples took so far.
    pub fn cpu_ns(&self) -> i64 {
        self.cpu.iter().map(|cpu| cpu.load(Ordering::Relaxed)).sum()
    }

    pub fn made(&self) -> Made {
        let sums = self.sums.lock().unwrap();
        Made {
            event_sum: sums.events.value(),
            raw_sum: sums.raw.value(),
            rgb_sum: sums.rgb.value(),
            ..sums.made
        }
    }
}

/// A sample, and how it goes into the books once it is taken.
type Make = dyn Fn(u64) -> (RecorderSample, Box<dyn FnOnce(&mut Sums)>) + Send + Sync;

/// A device that makes one sample an interval from the number of the sample.
struct Source {
    name: &'static str,
    number: usize,
    streams: Vec<StreamSpec>,
    interval: Duration,
    pace: Pace,
    make: Arc<Make>,
    is_ending: Arc<AtomicBool>,
    counts: Arc<[AtomicU64; 2]>,
    load: Load,
    thread: Option<JoinHandle<()>>,
}

impl Source {
    fn tally(&self) -> RecorderTally {
        let [n_samples, n_dropped] = [0, 1].map(|i: usize| self.counts[i].load(Ordering::Relaxed));
        RecorderTally { n_samples, n_dropped, ..RecorderTally::default() }
    }
}

impl Recorder for Source {
    fn name(&self) -> &'static str {
        self.name
    }

    fn check(&mut self) -> Vec<Finding> {
        Vec::new()
    }

    fn prepare(&mut self) -> Result<PreparedRecorder, RecorderError> {
        Ok(PreparedRecorder { description: serde_json::json!({}), streams: self.streams.clone() })
    }

    fn start(&mut self, outlet: SampleSender) -> Result<(), RecorderError> {
        let (make, interval, number) = (Arc::clone(&self.make), self.interval, self.number);
        let (is_ending, counts) = (Arc::clone(&self.is_ending), Arc::clone(&self.counts));
        let (load, pace) = (self.load.clone(), self.pace);
        self.thread = Some(std::thread::spawn(move || {
            let began = Instant::now();
            let (n_most, interval) = match pace {
                Pace::Real => (u64::MAX, interval),
                Pace::Unpaced(n) => (n, Duration::ZERO),
            };
            for n in 0..n_most {
                if is_ending.load(Ordering::Relaxed) {
                    break;
                }
                let (sample, enter) = make(n);
                let is_taken = outlet.offer(sample);
                if is_taken {
                    enter(&mut load.sums.lock().unwrap());
                }
                counts[usize::from(!is_taken)].fetch_add(1, Ordering::Relaxed);
                load.cpu[number].store(cpu_ns(ClockId::ThreadCPUTime), Ordering::Relaxed);
                let due = interval.mul_f64((n + 1) as f64);
                std::thread::sleep(due.saturating_sub(began.elapsed()));
            }
            load.has_ended[number].store(true, Ordering::SeqCst);
        }));
        Ok(())
    }

    fn progress(&mut self) -> Result<RecorderTally, RecorderError> {
        Ok(self.tally())
    }

    fn finish(&mut self) -> Result<RecorderTally, RecorderError> {
        self.abort();
        Ok(self.tally())
    }

    fn abort(&mut self) {
        self.is_ending.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            thread.join().unwrap();
        }
    }
}

fn source(
    name: &'static str,
    streams: Vec<StreamSpec>,
    interval: Duration,
    (load, pace): (&Load, Pace),
    make: impl Fn(u64) -> (RecorderSample, Box<dyn FnOnce(&mut Sums)>) + Send + Sync + 'static,
) -> Box<Source> {
    Box::new(Source {
        name,
        number: usize::from(streams.is_empty()),
        streams,
        interval,
        pace,
        make: Arc::new(make),
        is_ending: Arc::default(),
        counts: Arc::default(),
        load: load.clone(),
        thread: None,
    })
}

/// Events of a real recording in their order, without their stamps.
fn seen() -> Vec<Event> {
    let packets = Reader::open("tests/data/davis346-street.aedat4").unwrap().map(Result::unwrap);
    let mut seen = Events::new();
    for packet in packets {
        if let Content::Events(events) = packet.content {
            seen.extend_from_slice(events.as_slice());
        }
    }
    seen.as_slice().iter().collect()
}

/// Events where a real camera saw some, which compress as such do, at an even rate; no two packets
/// are alike, since their stamps are not.
fn davis(load: &Load, pace: Pace) -> Box<Source> {
    let n_events = EVENTS_PER_S * PACKET.as_millis() as u64 / 1000;
    let size = Size::DAVIS346;
    let stamps = (0..n_events).map(|i| (i * 1_000_000 / EVENTS_PER_S) as i64);
    let pattern: Events =
        stamps.zip(seen().into_iter().cycle()).map(|(t, event)| Event { t, ..event }).collect();
    let make = move |packet: u64| {
        let first = packet as i64 * PACKET.as_micros() as i64;
        let slice = pattern.as_slice();
        let t: Vec<i64> = slice.t.iter().map(|t| t + first).collect();
        let columns = (slice.x.to_vec(), slice.y.to_vec(), slice.on.to_vec());
        let events = Events::from_columns(t, columns.0, columns.1, columns.2).unwrap();
        let again = events.clone();
        let enter = move |sums: &mut Sums| {
            sums.made.n_events += again.len() as u64;
            sums.events.take(again.as_slice());
        };
        let content = Content::Events(events);
        let sample = RecorderSample::Packet { stream: 0, arrived: host_time(), content };
        (sample, Box::new(enter) as Box<dyn FnOnce(&mut Sums)>)
    };
    source("davis", vec![StreamSpec::events(size, "bench")], PACKET, (load, pace), make)
}

/// Frames of a pattern that encodes the number of the frame.
fn pi(load: &Load, pace: Pace) -> Box<Source> {
    let samples: Vec<u16> = (0..PI.n_pixels()).map(|i| (i % 1024) as u16).collect();
    let packed = raw10::pack(&samples, PI).unwrap();
    let rgb: Vec<u8> = (0..PI.n_pixels() * 3).map(|i| i as u8).collect();
    let stored: Vec<u8> = samples.iter().flat_map(|sample| sample.to_le_bytes()).collect();
    let images = Arc::new(Mutex::new((stored, rgb.clone())));
    let make = move |sequence: u64| {
        let arrived = host_time();
        let metadata = metadata(sequence, arrived.unix);
        // The first sample's upper eight bits, and the first red: the number of the frame.
        let (mut packed, mut rgb) = (packed.clone(), rgb.clone());
        (packed[0], rgb[0]) = (sequence as u8, sequence as u8);
        let frame = PiFrame { metadata, raw10: Some(packed), rgb: Some(rgb) };
        let images = Arc::clone(&images);
        let enter = move |sums: &mut Sums| {
            let (stored, rgb) = &mut *images.lock().unwrap();
            let first = u16::from(sequence as u8) << 2;
            stored[..2].copy_from_slice(&first.to_le_bytes());
            rgb[0] = sequence as u8;
            sums.raw.take(stored);
            sums.rgb.take(rgb);
            sums.made.n_raw += 1;
            sums.made.n_rgb += 1;
        };
        let sample = RecorderSample::Frame { arrived, frame: Box::new(frame) };
        (sample, Box::new(enter) as Box<dyn FnOnce(&mut Sums)>)
    };
    source("pi", Vec::new(), Duration::from_secs(1) / FRAMES_PER_S, (load, pace), make)
}

fn metadata(sequence: u64, real_time: Stamp<evrig::time::Unix>) -> FrameMetadata {
    FrameMetadata {
        sequence,
        sensor_timestamp: Stamp::from_micros(sequence as i64 * 8_333),
        frame_wall_clock: None,
        real_time,
        exposure: Span::from_micros(4_000),
        analogue_gain: 1.0,
        digital_gain: 1.0,
        lens_position: None,
        black_levels: [64; 4],
        size: PI,
        bayer: "RGGB".to_owned(),
        n_dropped: 0,
    }
}
