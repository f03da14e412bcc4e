//! The recorder under full load: 12 million events a second, 120 raw and RGB frames a second of
//! 692 x 520, through the engine into a session on a disk; then a plain copy of the same files.
//!
//! `cargo bench --bench record -- [SECONDS] [FOLDER]` (10, the system's folder for temporary files).
//! Prints what was dropped, CPU of the recorder alone (the process without the threads that make
//! samples), peak memory, bytes a second, and the time of the recording over that of the copy.

#![allow(
    clippy::expect_used,
    clippy::unwrap_used,
    clippy::print_stdout,
    missing_docs,
    unreachable_pub
)]

use evrig::device::dobot::{ArmError, TimedPose};
use evrig::device::recorder::{
    Outlet, Prepared, Recorder, RecorderError, Sample, Tally, host_time,
};
use evrig::device::{Arm, Finding, Progress, host_clock};
use evrig::event::{Event, Events};
use evrig::format::aedat4::{Content, StreamSpec};
use evrig::format::raw10;
use evrig::geometry::Size;
use evrig::record::{Devices, Dwells, Request, StopToken, record};
use evrig::rig::{Pose, Rig};
use evrig::session::{FrameMetadata, PiFrame};
use evrig::time::{Span, Stamp};
use evrig::trajectory::{Optional, Path as Trace, Trajectory};
use rustix::time::{ClockId, clock_gettime};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicI64, AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

const EVENTS_PER_S: u64 = 12_000_000;
const PACKET: Duration = Duration::from_millis(10);
const FRAMES_PER_S: u32 = 120;
const PI: Size = Size::new(692, 520);

fn cpu_ns(clock: ClockId) -> i64 {
    let time = clock_gettime(clock);
    time.tv_sec * 1_000_000_000 + time.tv_nsec
}

/// A device that makes one sample an interval from the number of the sample.
struct Source {
    name: &'static str,
    streams: Vec<StreamSpec>,
    interval: Duration,
    make: Arc<dyn Fn(u64) -> Sample + Send + Sync>,
    is_ending: Arc<AtomicBool>,
    counts: Arc<[AtomicU64; 2]>,
    cpu: Arc<AtomicI64>,
    thread: Option<JoinHandle<()>>,
}

impl Source {
    fn tally(&self) -> Tally {
        let [n_samples, n_dropped] = [0, 1].map(|i: usize| self.counts[i].load(Ordering::Relaxed));
        Tally { n_samples, n_dropped, ..Tally::default() }
    }
}

impl Recorder for Source {
    fn name(&self) -> &'static str {
        self.name
    }

    fn check(&mut self) -> Vec<Finding> {
        Vec::new()
    }

    fn prepare(&mut self) -> Result<Prepared, RecorderError> {
        Ok(Prepared { says: serde_json::json!({}), streams: self.streams.clone() })
    }

    fn start(&mut self, outlet: Outlet) -> Result<(), RecorderError> {
        let (make, interval) = (Arc::clone(&self.make), self.interval);
        let (is_ending, counts, cpu) =
            (Arc::clone(&self.is_ending), Arc::clone(&self.counts), Arc::clone(&self.cpu));
        self.thread = Some(std::thread::spawn(move || {
            let began = Instant::now();
            for n in 0.. {
                if is_ending.load(Ordering::Relaxed) {
                    break;
                }
                let is_taken = outlet.offer(make(n));
                counts[usize::from(!is_taken)].fetch_add(1, Ordering::Relaxed);
                let due = interval.mul_f64((n + 1) as f64);
                std::thread::sleep(due.saturating_sub(began.elapsed()));
            }
            cpu.fetch_add(cpu_ns(ClockId::ThreadCPUTime), Ordering::Relaxed);
        }));
        Ok(())
    }

    fn progress(&mut self) -> Result<Tally, RecorderError> {
        Ok(self.tally())
    }

    fn finish(&mut self) -> Result<Tally, RecorderError> {
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

/// An arm that rests for the time of the recording.
struct Resting {
    length: Duration,
    began: Instant,
    pose: Pose,
}

impl Arm for Resting {
    fn check(&mut self, _: Option<&Trace>) -> Vec<Finding> {
        Vec::new()
    }
    fn prepare(&mut self, _: &Trace) -> Result<Vec<String>, ArmError> {
        Ok(Vec::new())
    }
    fn start(&mut self, _: Range<usize>) -> Result<(), ArmError> {
        self.began = Instant::now();
        Ok(())
    }
    fn progress(&mut self) -> Result<Progress, ArmError> {
        let now = host_clock::now();
        let pose = TimedPose {
            pose: self.pose,
            joints: evrig::rig::Joints::default(),
            asked: now,
            answered: now,
        };
        let is_done = self.began.elapsed() >= self.length;
        Ok(Progress { pose, step: 0, is_done, n_dry: 0 })
    }
    fn finish(&mut self) -> Result<(), ArmError> {
        Ok(())
    }
    fn abort(&mut self) -> Result<(), ArmError> {
        Ok(())
    }
}

fn source(
    name: &'static str,
    streams: Vec<StreamSpec>,
    interval: Duration,
    cpu: &Arc<AtomicI64>,
    make: impl Fn(u64) -> Sample + Send + Sync + 'static,
) -> Box<Source> {
    Box::new(Source {
        name,
        streams,
        interval,
        make: Arc::new(make),
        is_ending: Arc::default(),
        counts: Arc::default(),
        cpu: Arc::clone(cpu),
        thread: None,
    })
}

fn davis(cpu: &Arc<AtomicI64>) -> Box<Source> {
    let n_events = EVENTS_PER_S * PACKET.as_millis() as u64 / 1000;
    let size = Size::DAVIS346;
    let make = move |packet: u64| {
        let first = packet as i64 * PACKET.as_micros() as i64;
        let event = |i: u64| Event {
            t: first + (i * 1_000_000 / EVENTS_PER_S) as i64,
            x: (i * 7 % u64::from(size.width)) as u16,
            y: (i * 3 % u64::from(size.height)) as u16,
            on: i.is_multiple_of(2),
        };
        let events: Events = (0..n_events).map(event).collect();
        Sample::Packet { stream: 0, arrived: host_time(), content: Content::Events(events) }
    };
    source("davis", vec![StreamSpec::events(size, "bench")], PACKET, cpu, make)
}

fn pi(cpu: &Arc<AtomicI64>) -> Box<Source> {
    let samples: Vec<u16> = (0..PI.n_pixels()).map(|i| (i % 1024) as u16).collect();
    let raw = raw10::pack(&samples, PI).unwrap();
    let rgb: Vec<u8> = (0..PI.n_pixels() * 3).map(|i| i as u8).collect();
    let make = move |sequence: u64| {
        let arrived = host_time();
        let metadata = FrameMetadata {
            sequence,
            sensor_timestamp: Stamp::from_micros(sequence as i64 * 8_333),
            frame_wall_clock: None,
            real_time: arrived.unix,
            exposure: Span::from_micros(4_000),
            analogue_gain: 1.0,
            digital_gain: 1.0,
            lens_position: None,
            black_levels: [64; 4],
            size: PI,
            bayer: "RGGB".to_owned(),
            n_dropped: 0,
        };
        let frame = PiFrame { metadata, raw10: Some(raw.clone()), rgb: Some(rgb.clone()) };
        Sample::Frame { arrived, frame: Box::new(frame) }
    };
    source("pi", Vec::new(), Duration::from_secs(1) / FRAMES_PER_S, cpu, make)
}

/// Kilobytes in a line of this process's status.
fn status_kb(key: &str) -> u64 {
    let text = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = text.lines().find_map(|line| line.strip_prefix(key)).unwrap_or_default();
    line.trim().trim_end_matches(" kB").parse().unwrap_or(0)
}

/// Copies files as the recorder leaves them, on the disk, and says how long that took.
fn copy(files: &[PathBuf], to: &Path) -> (u64, Duration) {
    std::fs::create_dir_all(to).unwrap();
    let began = Instant::now();
    let mut n_bytes = 0;
    for file in files {
        let mut from = std::fs::File::open(file).unwrap();
        let mut copy = std::fs::File::create(to.join(file.file_name().unwrap())).unwrap();
        n_bytes += std::io::copy(&mut from, &mut copy).unwrap();
        copy.sync_all().unwrap();
    }
    (n_bytes, began.elapsed())
}

fn main() {
    let mut arguments = std::env::args().skip(1).filter(|argument| !argument.starts_with("--"));
    let seconds: f64 = arguments.next().map_or(10.0, |text| text.parse().expect("seconds"));
    let folder = arguments.next().map_or_else(std::env::temp_dir, PathBuf::from);
    let work = tempfile::tempdir_in(folder).unwrap();
    let out = work.path().join("session");
    let rig = Rig::simulated().unwrap();
    let trajectory = Trajectory::find("circle").unwrap();
    let path = trajectory.path(&rig, Optional::Included).unwrap();
    let cpu: Arc<AtomicI64> = Arc::default();
    let arm = Resting {
        length: Duration::from_secs_f64(seconds),
        began: Instant::now(),
        pose: rig.arm.home,
    };
    let mut devices = Devices { arm: Box::new(arm), recorders: vec![davis(&cpu), pi(&cpu)] };
    let no_dwells = Dwells { lead_in: Duration::ZERO, tail: Duration::ZERO };
    let request =
        Request { rig: &rig, trajectory: &trajectory, path: &path, out: &out, dwells: no_dwells };
    let mut sealing: Option<(Instant, i64)> = None;
    let began = Instant::now();
    let mut watch = |state, _| {
        if state == evrig::record::State::Seal {
            sealing.get_or_insert((Instant::now(), cpu_ns(ClockId::ProcessCPUTime)));
        }
    };
    let outcome = record(request, &mut devices, &StopToken::default(), &mut watch).unwrap();
    let (sealed_at, cpu_then) = sealing.unwrap();
    let wall = (sealed_at - began).as_secs_f64();
    let recorder = (cpu_then - cpu.load(Ordering::Relaxed)) as f64 * 1e-9;
    let peak = status_kb("VmHWM:") as f64 / 1024.0;
    let files: Vec<_> = ["davis.aedat4", "rig.mcap"].map(|name| out.join(name)).to_vec();
    let (n_bytes, copied) = copy(&files, &work.path().join("copy"));
    let mega = n_bytes as f64 * 1e-6;
    for device in &outcome.manifest.recording.as_ref().unwrap().devices {
        println!("{:<6} {} samples, {} dropped", device.name, device.n_samples, device.n_dropped);
    }
    println!("recorded   {mega:.0} MB in {wall:.2} s, {:.0} MB/s, on the disk", mega / wall);
    println!("recorder   {:.2} cores, peak memory {peak:.0} MB", recorder / wall);
    let copied = copied.as_secs_f64();
    println!(
        "plain copy {copied:.2} s, {:.0} MB/s; recording / copy = {:.2}",
        mega / copied,
        wall / copied
    );
}
