//! How fast generators turn frames into events: `cargo bench --bench generate`.
//!
//! The clip is made here: a textured plane on a circle, 120 frames a second, 10 bits, one
//! revolution that closes on itself. Its contrast is set so that the Raw2DVS346 preset makes
//! about 16,000 events a frame at 346 x 260. Per model, size and number of threads a
//! table gives frames/s, events/s, ns per pixel-frame and the ratio to the time it takes to
//! read the frame and read and write the least state (brightness and one f64) once.

#![allow(missing_docs, clippy::unwrap_used, clippy::print_stdout)]

use criterion::{BenchmarkId, Criterion, Throughput};
use evrig::event::Events;
use evrig::frame::Luminance;
use evrig::generate::{Choice, GenerateParameters, Generator, build};
use evrig::geometry::Size;
use std::f32::consts::TAU;
use std::hint::black_box;
use std::num::NonZeroUsize;
use std::time::{Duration, Instant};

const N_FRAMES: usize = 120;
const SPAN_US: i64 = 8_333;
const SIZES: [Size; 2] = [Size::DAVIS346, Size::new(692, 520)];

/// Contrast of the waves and of the edges, in log units.
const SMOOTH: f32 = 0.245;
const EDGES: f32 = 0.6;

/// Log brightness of the print: waves of several lengths and directions, a few sharp edges.
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

/// A generator fed with the clip round and round.
struct Run<'a> {
    generator: Box<dyn Generator>,
    clip: &'a [Vec<f32>],
    frame: Luminance,
    next: usize,
    out: Events,
    n_events: usize,
    cpu: Duration,
}

impl<'a> Run<'a> {
    fn new(model: &Case, size: Size, clip: &'a [Vec<f32>], threads: usize) -> Self {
        let choice = Choice { seed: 1, ..model.choice };
        let parameters = GenerateParameters::from_choice(&choice).unwrap();
        let generator = build(&parameters, NonZeroUsize::new(threads)).unwrap();
        let frame = Luminance { t_us: 1_700_000_000_000_000, size, values: Vec::new() };
        let mut run = Self {
            generator,
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

    /// Takes in the next frame; the time that took.
    fn step(&mut self) -> Duration {
        self.frame.values.clone_from(&self.clip[self.next % N_FRAMES]);
        self.frame.t_us += SPAN_US;
        self.next += 1;
        self.out.clear();
        let (start, cpu_start) = (Instant::now(), cpu_time());
        self.generator.push(black_box(&self.frame), &mut self.out).unwrap();
        self.cpu += cpu_time() - cpu_start;
        let took = start.elapsed();
        self.n_events += black_box(&self.out).len();
        took
    }
}

struct Case {
    name: &'static str,
    choice: Choice<'static>,
}

fn cases() -> Vec<Case> {
    let voltmeter = Choice { preset: Some("Raw2DVS346"), ..Choice::default() };
    let of =
        |preset| Choice { preset: Some(preset), full_scale_dn: Some(1023.0), ..Choice::default() };
    vec![
        Case { name: "voltmeter", choice: voltmeter },
        Case {
            name: "voltmeter-reference",
            choice: Choice { law: Some("reference"), ..voltmeter },
        },
        Case { name: "esim", choice: of("ESIM") },
        Case { name: "v2e-clean", choice: of("v2e-clean") },
        Case { name: "v2e-noisy", choice: of("v2e-noisy") },
    ]
}

/// CPU time of all threads of this process so far.
fn cpu_time() -> Duration {
    let now = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    Duration::new(now.tv_sec as u64, now.tv_nsec as u32)
}

/// Median time to read a frame once and to read and write the least state once.
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

/// CPU time, unlike time on the wall, hardly depends on what else the machine does.
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
                let mut run = Run::new(&case, size, &clip, threads);
                let n = 3 * N_FRAMES;
                let wall: Duration = (0..n).map(|_| run.step()).sum();
                let (wall, cpu) = (wall.as_secs_f64() / n as f64, run.cpu.as_secs_f64() / n as f64);
                let events = run.n_events as f64 / n as f64;
                println!(
                    "| {} | {size} | {threads} | {events:.0} | {:.0} | {:.2} | {:.2} | {:.0} | {:.1} |",
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

fn main() {
    table();
    if std::env::args().any(|argument| argument == "--table") {
        return;
    }
    let mut criterion = Criterion::default().configure_from_args().sample_size(20);
    for size in SIZES {
        let clip = clip(size);
        let mut group = criterion.benchmark_group(format!("generate {size}"));
        group.throughput(Throughput::Elements(size.n_pixels() as u64));
        for case in cases() {
            for threads in [1, 2] {
                let mut run = Run::new(&case, size, &clip, threads);
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
