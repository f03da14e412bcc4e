//! The recorder under full load: 12 million events a second, and 120 raw and RGB frames a second of
//! 692 x 520.
//!
//! `cargo bench --bench record -- disk [SECONDS] [FOLDER]` (10, the system's folder for temporary
//! files): through the engine into a session, then a plain copy of the same files. Two minutes take
//! 49 GB, compressed by LZ4 35 GB, and as much again for the copy; `--no-copy` leaves that out.
//!
//! `cargo bench --bench record -- sink [SECONDS]` (30): through queues and writers of a recording
//! into pipes, at whose other ends all is decoded, counted, held to its order, summed up, and
//! thrown away. The sums are compared with those of what the cameras made.
//!
//! Events are compressed as a rig's `davis.compression` states: `--compression=none` (unless
//! stated), `lz4` or `zstd`.
//!
//! Both print what was dropped, processor time of the recorder alone (the threads that make the
//! samples, and those that read them back, are not counted), and peak memory. Exit 1 when anything
//! was dropped or is not what it was.

#![allow(
    clippy::expect_used,
    clippy::unwrap_used,
    clippy::print_stdout,
    missing_docs,
    unreachable_pub
)]

#[path = "record/load.rs"]
#[allow(dead_code)]
mod load;

use evrig::format::aedat4::Compression;
use evrig::record::DeviceError;
use evrig::record::PoseReading;
use evrig::record::{Arm, Finding, Progress, host_clock};
use evrig::record::{Devices, DryRun, Dwells, Prompts, RecordRequest, StopToken, dry_run, record};
use evrig::rig::{Pose, Rig};
use evrig::trajectory::{OptionalSegments, ToolPath as Trace, Trajectory};
use load::{Load, Pace, cpu_ns};
use rustix::time::ClockId;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant};

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
    fn prepare(&mut self, _: &Trace) -> Result<Vec<String>, DeviceError> {
        Ok(Vec::new())
    }
    fn start(&mut self, _: Range<usize>) -> Result<(), DeviceError> {
        self.began = Instant::now();
        Ok(())
    }
    fn progress(&mut self) -> Result<Progress, DeviceError> {
        let now = host_clock::now();
        let pose = PoseReading {
            pose: self.pose,
            joints: evrig::rig::Joints::default(),
            asked: now,
            answered: now,
        };
        let is_done = self.began.elapsed() >= self.length;
        Ok(Progress { pose, step: 0, is_done, n_dry: 0 })
    }
    fn finish(&mut self) -> Result<(), DeviceError> {
        Ok(())
    }
    fn abort(&mut self) -> Result<(), DeviceError> {
        Ok(())
    }
}

/// Kilobytes in a line of this process's status.
fn status_kb(key: &str) -> u64 {
    let text = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = text.lines().find_map(|line| line.strip_prefix(key)).unwrap_or_default();
    line.trim().trim_end_matches(" kB").parse().unwrap_or(0)
}

fn machine_load() -> String {
    let text = std::fs::read_to_string("/proc/loadavg").unwrap_or_default();
    text.split(' ').next().unwrap_or("?").to_owned()
}

/// Copies the recorder's files on the disk, and returns how long that took.
fn copy(files: &[PathBuf], to: &Path) -> Duration {
    std::fs::create_dir_all(to).unwrap();
    let began = Instant::now();
    for file in files {
        let mut from = std::fs::File::open(file).unwrap();
        let mut copy = std::fs::File::create(to.join(file.file_name().unwrap())).unwrap();
        std::io::copy(&mut from, &mut copy).unwrap();
        copy.sync_all().unwrap();
    }
    began.elapsed()
}

/// What the recorder took of the processor besides the making of samples, in cores.
fn cores(load: &Load, before: i64, others: i64, wall: f64) -> f64 {
    let all = cpu_ns(ClockId::ProcessCPUTime) - before;
    (all - load.cpu_ns() - others) as f64 * 1e-9 / wall
}

fn to_disk(seconds: f64, folder: &Path, compression: Compression, copies: bool) -> bool {
    let work = tempfile::tempdir_in(folder).unwrap();
    let out = work.path().join("session");
    let mut rig = Rig::simulated().unwrap();
    rig.davis.compression = compression;
    let trajectory = Trajectory::find("circle").unwrap();
    let path = trajectory.path(&rig, OptionalSegments::Included).unwrap();
    let (load, recorders) = Load::new(Pace::Real);
    let length = Duration::from_secs_f64(seconds);
    let arm = Resting { length, began: Instant::now(), pose: rig.arm.home };
    let mut devices = Devices { arm: Box::new(arm), recorders };
    let no_dwells = Dwells { lead_in: Duration::ZERO, tail: Duration::ZERO };
    let request = RecordRequest {
        rig: &rig,
        trajectory: &trajectory,
        path: &path,
        out: &out,
        dwells: no_dwells,
        prompts: Prompts::default(),
    };
    // The recording ends when its last byte is on the disk; what seals it reads everything once
    // more.
    let mut ended: Option<(f64, f64, u64)> = None;
    let (began, before) = (Instant::now(), cpu_ns(ClockId::ProcessCPUTime));
    let mut watch = |state, _| {
        if state == evrig::record::RecordState::Seal {
            let wall = began.elapsed().as_secs_f64();
            let peak = status_kb("VmHWM:");
            ended.get_or_insert_with(|| (wall, cores(&load, before, 0, wall), peak));
        }
    };
    let outcome = record(request, &mut devices, &StopToken::default(), &mut watch).unwrap();
    let (wall, cores, peak_kb) = ended.unwrap();
    let files: Vec<_> = ["davis.aedat4", "rig.mcap"].map(|name| out.join(name)).to_vec();
    let n_bytes: u64 = files.iter().map(|file| std::fs::metadata(file).unwrap().len()).sum();
    let mega = n_bytes as f64 * 1e-6;
    let mut n_dropped = 0;
    for device in &outcome.manifest.recording.as_ref().unwrap().devices {
        println!("{:<6} {} samples, {} dropped", device.name, device.n_samples, device.n_dropped);
        n_dropped += device.n_dropped;
    }
    println!("recorded   {mega:.0} MB in {wall:.2} s, {:.0} MB/s, synced", mega / wall);
    println!("recorder   {cores:.2} cores, peak memory {:.0} MB", peak_kb as f64 / 1024.0);
    let counted: u64 = outcome.manifest.streams.iter().map(|stream| stream.count).sum();
    println!("sealed     {counted} elements counted from the files");
    if copies {
        let copied = copy(&files, &work.path().join("copy")).as_secs_f64();
        println!(
            "plain copy {copied:.2} s, {:.0} MB/s; recording / copy = {:.2}",
            mega / copied,
            wall / copied
        );
    }
    let expected = load.made();
    let found = |name: &str| {
        let mut streams = outcome.manifest.streams.iter();
        streams.find(|stream| stream.name == name).map_or(0, |stream| stream.count)
    };
    let same = [found("real"), found("raw"), found("rgb")]
        == [expected.n_events, expected.n_raw, expected.n_rgb];
    println!("counts     {}", if same { "as made" } else { "NOT as made" });
    same && n_dropped == 0
}

fn to_sink(seconds: f64, compression: Compression) -> bool {
    let (load, mut recorders) = Load::new(Pace::Real);
    let rehearsal = DryRun { compression, ..DryRun::of(Duration::from_secs_f64(seconds)) };
    let (began, before) = (Instant::now(), cpu_ns(ClockId::ProcessCPUTime));
    let mut last_report = Duration::ZERO;
    let mut after_start_kb = None;
    let mut watch = |since: Duration, tallies: &[evrig::record::recorder::RecorderTally]| {
        // Every queue and buffer has been used by then.
        if since.as_secs() >= 10 {
            after_start_kb.get_or_insert_with(|| status_kb("VmHWM:"));
        }
        if since - last_report >= Duration::from_secs(60) {
            last_report = since;
            let n_dropped: u64 = tallies.iter().map(|tally| tally.n_dropped).sum();
            let resident = status_kb("VmRSS:") / 1024;
            println!("{:>5} s: {n_dropped} dropped, {resident} MB resident", since.as_secs());
        }
    };
    let stop = StopToken::default();
    let rehearsed = dry_run(&mut recorders, rehearsal, &stop, &mut watch).unwrap();
    let wall = began.elapsed().as_secs_f64();
    let check = &rehearsed.check;
    let n_dropped: u64 = rehearsed.tallies.iter().map(|tally| tally.n_dropped).sum();
    let mega = check.n_bytes as f64 * 1e-6;
    println!("verified   {mega:.0} MB in {wall:.1} s, {:.0} MB/s", mega / wall);
    println!(
        "           {} events, {} raw and {} RGB frames, {n_dropped} samples dropped",
        check.n_events, check.n_raw, check.n_rgb
    );
    println!(
        "recorder   {:.2} cores (and {:.2} to read it back), peak memory {} MB, {} MB of it \
         within 10 s",
        cores(&load, before, rehearsed.check_cpu.as_nanos(), wall),
        rehearsed.check_cpu.as_secs_f64() / wall,
        status_kb("VmHWM:") / 1024,
        after_start_kb.unwrap_or(0) / 1024,
    );
    let made = load.made();
    let same = check.n_events == made.n_events
        && check.event_sum == made.event_sum
        && (check.n_raw, check.raw_sum) == (made.n_raw, made.raw_sum)
        && (check.n_rgb, check.rgb_sum) == (made.n_rgb, made.rgb_sum);
    println!("sums       {}", if same { "as made" } else { "NOT as made" });
    check.problems.iter().for_each(|problem| println!("problem    {problem}"));
    same && check.problems.is_empty() && n_dropped == 0
}

fn main() -> ExitCode {
    let arguments: Vec<String> =
        std::env::args().skip(1).filter(|argument| argument != "--bench").collect();
    let copies = !arguments.iter().any(|argument| argument == "--no-copy");
    let word = arguments.iter().find_map(|argument| argument.strip_prefix("--compression="));
    let compression =
        word.map_or(Compression::None, |word| word.parse().expect("--compression=none|lz4|zstd"));
    let mut places = arguments.iter().filter(|argument| !argument.starts_with("--"));
    let mode = places.next().map_or("sink", String::as_str);
    let mut seconds = |otherwise: f64| {
        places.next().map_or(otherwise, |text| text.parse().expect("SECONDS is a number"))
    };
    println!("load of the machine before: {}", machine_load());
    let is_good = match mode {
        "disk" => {
            let seconds = seconds(10.0);
            let folder = places.next().map_or_else(std::env::temp_dir, PathBuf::from);
            to_disk(seconds, &folder, compression, copies)
        }
        "sink" => to_sink(seconds(30.0), compression),
        other => panic!("{other}: expected `disk` or `sink`"),
    };
    println!("load of the machine after: {}", machine_load());
    if is_good { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}
