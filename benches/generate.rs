//! Speed of generating events from frames: `cargo bench --bench generate`.
//!
//! The synthetic clip shows a textured plane on a circle, 120 frames per second, 10 bits, one
//! periodic revolution. Its contrast is set so that the Raw2DVS346 preset generates about 16,000
//! events per frame at 346 x 260. Per model, size and number of threads a table gives frames/s,
//! events/s, ns per pixel-frame and the ratio to the time of reading the frame and of reading and
//! writing the minimal state (brightness and one f64) once.
//!
//! `cargo bench --bench generate -- --clip FILE WIDTH HEIGHT` times the voltmeter alone on other
//! frames: little-endian 16-bit samples, 120 frames per second, one thread.
//!
//! The table includes eventcv-core, a third-party compiled and parallel v2e pixel, with the
//! parameters of `v2e-clean` and `v2e-noisy` and without its own upsampling.

#![allow(missing_docs, clippy::unwrap_used, clippy::print_stdout)]

use criterion::{BenchmarkId, Criterion, Throughput};
use eventcv_core::simulate::{Simulator, SimulatorConfig};
use evrig::event::Events;
use evrig::frame::Luminance;
use evrig::generate::{GenerateParameters, Generator, GeneratorChoice, build};
use evrig::geometry::Size;
use std::f32::consts::TAU;
use std::hint::black_box;
use std::num::NonZeroUsize;
use std::time::{Duration, Instant};

const N_FRAMES: usize = 120;
const SPAN_US: i64 = 8_333;
const START_US: i64 = 1_700_000_000_000_000;
const SIZES: [Size; 2] = [Size::DAVIS346, Size::new(692, 520)];

/// Contrast of the waves and of the edges, in log units.
const SMOOTH: f32 = 0.245;
const EDGES: f32 = 0.6;

/// Log brightness of the texture: waves of several lengths and directions, a few sharp edges.
fn texture(x: f32, y: f32) -> f32 {
    let waves = [(0.05, 0.3), (0.11, 1.9), (0.23, 2.6), (0.31, 0.8), (0.47, 4.1)];
    let smooth: f32 = waves
        .iter()
        .map(|&(k, angle): &(f32, f32)| (k * (x * angle.cos() + y * angle.sin()) + angle).sin())
        .sum();
    let edges = (0.12 * x + 0.8 * (0.05 * y).sin()).sin().signum();
    SMOOTH * smooth + EDGES * edges
}

/// One revolution on a circle of 30 pixels (at 346 x 260) in a second.
fn clip(size: Size) -> Vec<Vec<f32>> {
    let scale = 346.0 / f32::from(size.width);
    let frame = |i: usize| {
        let phase = TAU * i as f32 / N_FRAMES as f32;
        let (dx, dy) = (30.0 * phase.cos(), 30.0 * phase.sin());
        let pixels = (0..size.height).flat_map(|y| (0..size.width).map(move |x| (x, y)));
        pixels
            .map(|(x, y)| {
                let log = texture(f32::from(x) * scale + dx, f32::from(y) * scale + dy);
                (260.0 * log.exp()).round().clamp(0.0, 1023.0)
            })
            .collect()
    };
    (0..N_FRAMES).map(frame).collect()
}

/// A generator of this project or the third-party one.
enum BenchedGenerator {
    Own(Box<dyn Generator>),
    Peer { simulator: Box<Simulator>, pool: rayon::ThreadPool, frame: Vec<f32> },
}

impl BenchedGenerator {
    fn new(case: &BenchCase, size: Size, threads: usize) -> Self {
        match &case.made {
            GeneratorSource::Own(choice) => {
                let choice = GeneratorChoice { seed: 1, ..*choice };
                let parameters = GenerateParameters::from_choice(&choice).unwrap();
                Self::Own(build(&parameters, NonZeroUsize::new(threads)).unwrap())
            }
            GeneratorSource::Peer(config) => {
                let (width, height) = (usize::from(size.width), usize::from(size.height));
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                let simulator = Box::new(Simulator::new(width, height, *config));
                Self::Peer { simulator, pool, frame: vec![0.0; width * height] }
            }
        }
    }

    /// Converts a frame to the units of the engine; not timed.
    fn prepare(&mut self, frame: &Luminance) {
        if let Self::Peer { frame: own, .. } = self {
            own.iter_mut().zip(&frame.values).for_each(|(own, value)| *own = value / 1023.0);
        }
    }

    /// Number of events.
    fn push(&mut self, frame: &Luminance, out: &mut Events) -> usize {
        match self {
            Self::Own(generator) => {
                generator.push(black_box(frame), out).unwrap();
                black_box(&*out).len()
            }
            Self::Peer { simulator, pool, frame: own } => {
                // Its clock starts with the clip, so that its timestamps are small.
                let t_us = frame.t_us - START_US;
                pool.install(|| black_box(simulator.push_frame(black_box(own), t_us)).len())
            }
        }
    }
}

/// A generator fed with the repeated clip.
struct BenchRun<'a> {
    engine: BenchedGenerator,
    clip: &'a [Vec<f32>],
    frame: Luminance,
    next: usize,
    out: Events,
    n_events: usize,
    cpu: Duration,
}

impl<'a> BenchRun<'a> {
    fn new(case: &BenchCase, size: Size, clip: &'a [Vec<f32>], threads: usize) -> Self {
        let frame = Luminance { t_us: START_US, size, values: Vec::new() };
        let mut run = Self {
            engine: BenchedGenerator::new(case, size, threads),
            clip,
            frame,
            next: 0,
            out: Events::new(),
            n_events: 0,
            cpu: Duration::ZERO,
        };
        // A round to reach the steady state.
        for _ in 0..N_FRAMES {
            run.step();
        }
        (run.n_events, run.cpu) = (0, Duration::ZERO);
        run
    }

    /// Processes the next frame; returns the time taken.
    fn step(&mut self) -> Duration {
        self.frame.values.clone_from(&self.clip[self.next % N_FRAMES]);
        self.frame.t_us += SPAN_US;
        self.next += 1;
        self.out.clear();
        self.engine.prepare(&self.frame);
        let (start, cpu_start) = (Instant::now(), cpu_time());
        let n_events = self.engine.push(&self.frame, &mut self.out);
        self.cpu += cpu_time() - cpu_start;
        let took = start.elapsed();
        self.n_events += n_events;
        took
    }
}

struct BenchCase {
    name: &'static str,
    made: GeneratorSource,
}

enum GeneratorSource {
    Own(GeneratorChoice<'static>),
    Peer(SimulatorConfig),
}

fn voltmeter() -> GeneratorChoice<'static> {
    GeneratorChoice { preset: Some("Raw2DVS346"), ..GeneratorChoice::default() }
}

fn cases() -> Vec<BenchCase> {
    let of = |preset| GeneratorChoice {
        preset: Some(preset),
        full_scale_dn: Some(1023.0),
        ..GeneratorChoice::default()
    };
    let own = |name, choice| BenchCase { name, made: GeneratorSource::Own(choice) };
    let clean = SimulatorConfig { sigma_thres: 0.02, ..SimulatorConfig::ideal() };
    let noisy = SimulatorConfig {
        sigma_thres: 0.05,
        cutoff_hz: 30.0,
        leak_rate_hz: 0.1,
        shot_noise_rate_hz: 5.0,
        ..clean
    };
    vec![
        own("voltmeter", voltmeter()),
        own("voltmeter-reference", GeneratorChoice { law: Some("reference"), ..voltmeter() }),
        own("esim", of("ESIM")),
        own("v2e-clean", of("v2e-clean")),
        BenchCase { name: "eventcv-core, clean", made: GeneratorSource::Peer(clean) },
        own("v2e-noisy", of("v2e-noisy")),
        BenchCase { name: "eventcv-core, noisy", made: GeneratorSource::Peer(noisy) },
    ]
}

/// CPU time of all threads of this process so far.
fn cpu_time() -> Duration {
    let now = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    Duration::new(now.tv_sec as u64, now.tv_nsec as u32)
}

/// Median time to read a frame once and to read and write the minimal state once.
fn bandwidth_limit(clip: &[Vec<f32>]) -> Duration {
    let mut before = clip[0].clone();
    let mut state = vec![0.0_f64; before.len()];
    let mut pass = |after: &Vec<f32>| {
        let start = cpu_time();
        for ((before, state), &after) in before.iter_mut().zip(&mut state).zip(after) {
            *state += f64::from(after - *before);
            *before = after;
        }
        black_box((&mut before, &mut state));
        cpu_time() - start
    };
    let mut times: Vec<Duration> = clip.iter().chain(clip).map(&mut pass).collect();
    times.sort();
    times[times.len() / 2]
}

/// Reports CPU time because it depends less on the load of the machine than wall time.
fn table() {
    println!(
        "| model | size | threads | events/frame | frames/s | Mevents/s | CPU ns/px-frame \
         | CPU frames/s/core | x memory |"
    );
    println!("| --- | --- | --- | --- | --- | --- | --- | --- | --- |");
    for size in SIZES {
        let clip = clip(size);
        let limit = bandwidth_limit(&clip).as_secs_f64();
        for case in cases() {
            for threads in [1, 2] {
                let mut run = BenchRun::new(&case, size, &clip, threads);
                let n = 3 * N_FRAMES;
                let wall: Duration = (0..n).map(|_| run.step()).sum();
                let (wall, cpu) = (wall.as_secs_f64() / n as f64, run.cpu.as_secs_f64() / n as f64);
                let events = run.n_events as f64 / n as f64;
                println!(
                    "| {} | {size} | {threads} | {events:.0} | {:.0} | {:.2} | {:.2} | {:.0} | \
                     {:.1} |",
                    case.name,
                    1.0 / wall,
                    events / wall / 1e6,
                    cpu * 1e9 / size.n_pixels() as f64,
                    1.0 / cpu,
                    cpu / limit,
                );
            }
        }
    }
}

/// Seconds that the voltmeter takes for frames from a file, as JSON: with the memory of the events
/// reused from frame to frame, and with all events kept.
fn time_clip(path: &str, size: Size) {
    let bytes = std::fs::read(path).unwrap();
    let frames: Vec<Luminance> = bytes
        .chunks_exact(2 * size.n_pixels())
        .enumerate()
        .map(|(i, frame)| Luminance {
            t_us: (i as f64 * 1e6 / 120.0).round() as i64,
            size,
            values: frame.as_chunks().0.iter().map(|dn| u16::from_le_bytes(*dn).into()).collect(),
        })
        .collect();
    let time = |keeps_events: bool| {
        let parameters = GenerateParameters::from_choice(&voltmeter()).unwrap();
        let mut generator = build(&parameters, NonZeroUsize::new(1)).unwrap();
        let (mut out, mut n_events, start) = (Events::new(), 0, Instant::now());
        for frame in &frames {
            if !keeps_events {
                out.clear();
            }
            let before = out.len();
            generator.push(black_box(frame), &mut out).unwrap();
            n_events += out.len() - before;
        }
        black_box(&out);
        (n_events, start.elapsed().as_secs_f64())
    };
    let ((n_events, reused), (_, kept)) = (time(false), time(true));
    println!("{{\"n_events\": {n_events}, \"reused_s\": {reused}, \"kept_s\": {kept}}}");
}

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    if let Some(at) = arguments.iter().position(|argument| argument == "--clip") {
        let number = |i: usize| arguments[at + i].parse().unwrap();
        return time_clip(&arguments[at + 1], Size::new(number(2), number(3)));
    }
    table();
    if arguments.iter().any(|argument| argument == "--table") {
        return;
    }
    let mut criterion = Criterion::default().configure_from_args().sample_size(20);
    for size in SIZES {
        let clip = clip(size);
        let mut group = criterion.benchmark_group(format!("generate {size}"));
        group.throughput(Throughput::Elements(size.n_pixels() as u64));
        for case in cases() {
            for threads in [1, 2] {
                let mut run = BenchRun::new(&case, size, &clip, threads);
                let id = BenchmarkId::new(case.name, format!("{threads} threads"));
                group.bench_function(id, |bencher| {
                    bencher.iter_custom(|n| (0..n).map(|_| run.step()).sum());
                });
            }
        }
        group.finish();
    }
    criterion.final_summary();
}
