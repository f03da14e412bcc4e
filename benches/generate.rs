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

/// Log brightness of the print: waves of several lengths and directions, a few sharp edges.
fn texture(x: f32, y: f32) -> f32 {
    let waves = [(0.05, 0.3), (0.11, 1.9), (0.23, 2.6), (0.31, 0.8), (0.47, 4.1)];
    let smooth: f32 = waves
        .iter()
        .map(|&(k, angle): &(f32, f32)| (k * (x * angle.cos() + y * angle.sin()) + angle).sin())
        .sum();
    let edges = (0.06 * x + 0.4 * (0.05 * y).sin()).sin().signum();
    0.12 * smooth + 0.35 * edges
}

/// One revolution on a circle of 20 pixels (at 346 x 260) in a second.
fn clip(size: Size) -> Vec<Vec<f32>> {
    let scale = 346.0 / f32::from(size.width);
    let frame = |i: usize| {
        let phase = TAU * i as f32 / N_FRAMES as f32;
        let (dx, dy) = (20.0 * phase.cos(), 20.0 * phase.sin());
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
}

impl<'a> Run<'a> {
    fn new(model: &Case, size: Size, clip: &'a [Vec<f32>], threads: usize) -> Self {
        let choice = Choice { seed: 1, ..model.choice };
        let parameters = GenerateParameters::from_choice(&choice).unwrap();
        let generator = build(&parameters, NonZeroUsize::new(threads)).unwrap();
        let frame = Luminance { t_us: 1_700_000_000_000_000, size, values: Vec::new() };
        let mut run = Self { generator, clip, frame, next: 0, out: Events::new(), n_events: 0 };
        // A round to reach the steady state.
        (0..N_FRAMES).for_each(|_| drop(run.step()));
        run.n_events = 0;
        run
    }

    /// Takes in the next frame; the time that took.
    fn step(&mut self) -> Duration {
        self.frame.values.clone_from(&self.clip[self.next % N_FRAMES]);
        self.frame.t_us += SPAN_US;
        self.next += 1;
        self.out.clear();
        let start = Instant::now();
        self.generator.push(black_box(&self.frame), &mut self.out).unwrap();
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
    vec![
        Case { name: "voltmeter", choice: voltmeter },
        Case {
            name: "voltmeter-reference",
            choice: Choice { law: Some("reference"), ..voltmeter },
        },
    ]
}

/// Median time to read a frame once and to read and write the least state once.
fn bandwidth_limit(clip: &[Vec<f32>]) -> Duration {
    let mut before = clip[0].clone();
    let mut state = vec![0.0_f64; before.len()];
    let pass = |after: &Vec<f32>| {
        let start = Instant::now();
        for ((before, state), &after) in before.iter_mut().zip(&mut state).zip(after) {
            *state += f64::from(after - *before);
            *before = after;
        }
        black_box((&mut before, &mut state));
        start.elapsed()
    };
    let mut times: Vec<Duration> = clip.iter().chain(clip).map(pass).collect();
    times.sort();
    times[times.len() / 2]
}

fn table() {
    println!(
        "| model | size | threads | events/frame | frames/s | Mevents/s | ns/px-frame | x memory |"
    );
    println!("| --- | --- | --- | --- | --- | --- | --- | --- |");
    for size in SIZES {
        let clip = clip(size);
        let limit = bandwidth_limit(&clip);
        for case in cases() {
            for threads in [1, 2] {
                let mut run = Run::new(&case, size, &clip, threads);
                let n = 3 * N_FRAMES;
                let mut times: Vec<Duration> = (0..n).map(|_| run.step()).collect();
                times.sort();
                let total: f64 = times.iter().map(Duration::as_secs_f64).sum();
                let mean = total / n as f64;
                let events = run.n_events as f64 / n as f64;
                println!(
                    "| {} | {size} | {threads} | {events:.0} | {:.0} | {:.2} | {:.2} | {:.1} |",
                    case.name,
                    1.0 / mean,
                    events / mean / 1e6,
                    mean * 1e9 / size.n_pixels() as f64,
                    times[n / 2].as_secs_f64() / limit.as_secs_f64(),
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
