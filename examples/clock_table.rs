//! The clock methods against each other on simulated recordings; `docs/clock.md` reads the table.
//!
//! `cargo run --release --example clock_table [TRIALS]` (60 s recordings; twice as many of
//! 5 s, a quarter of 600 s).

#![allow(clippy::print_stdout)]

use evrig::clock::{
    ClockError, ClockEstimate, ClockReading, EnvelopeOptions, FramePair, FramePairs,
    MinimumLatency, PairOptions, PaperUnit, RateModel, clock_pair, envelope, hull, olson2,
    paper_interval, paper_window,
};
use evrig::time::{PiSensor, Span, Stamp, Unix};
use simulation::{Clocks, Family, Recording, SMALLEST_S, Scenario, record};

#[path = "../src/clock/tests/simulation.rs"]
mod simulation;

const METHODS: [&str; 6] =
    ["paper-interval", "paper-window", "hull", "olson2", "envelope", "clock-pair"];

/// Errors of one method over the trials of one scenario.
#[derive(Default)]
struct Score {
    sum_of_squares: f64,
    worst_us: f64,
    n_frames: u64,
    n_covered95: u64,
    n_covered90: u64,
    n_claimed: u64,
    widths_us: Vec<f64>,
}

impl Score {
    fn take(&mut self, recording: &Recording, estimate: &ClockEstimate, smallest: Span) {
        let middle = recording.pairs.len() / 2;
        for (index, (pair, truth)) in recording.pairs.iter().zip(&recording.truth).enumerate() {
            let Some(mapped) = estimate.map(pair.sensor) else { continue };
            let error = mapped - (*truth - smallest);
            let error_us = error.as_nanos() as f64 * 1e-3;
            self.sum_of_squares += error_us * error_us;
            self.n_frames += 1;
            self.worst_us = self.worst_us.max(error_us.abs());
            let error_of_segment = estimate.segment_at(pair.sensor).and_then(|s| s.error);
            if let (true, Some(claim)) = (index == middle, error_of_segment) {
                let [low, high] = claim.statistical95;
                self.n_claimed += 1;
                self.n_covered95 += u64::from(low <= -error && -error <= high);
                self.n_covered90 += u64::from(claim.offset_us.covers(-error_us));
                self.widths_us.push((high - low).as_nanos() as f64 * 1e-3);
            }
        }
    }

    fn rms_us(&self) -> f64 {
        (self.sum_of_squares / self.n_frames as f64).sqrt()
    }

    fn print(&mut self, name: &str, paper_rms_us: f64) {
        let ratio = paper_rms_us / self.rms_us();
        print!("{name:15} {:10.1} {:10.0} {ratio:10.1}", self.rms_us(), self.worst_us);
        self.widths_us.sort_by(f64::total_cmp);
        match self.widths_us.get(self.widths_us.len() / 2) {
            Some(width) => {
                let share = |n: u64| 100.0 * n as f64 / self.n_claimed as f64;
                let (in95, in90) = (share(self.n_covered95), share(self.n_covered90));
                println!(" {in95:8.0} {in90:8.0} {width:10.1}");
            }
            None => println!("        -        -          -"),
        }
    }
}

fn estimates(recording: &Recording, clocks: Clocks) -> Vec<Result<ClockEstimate, ClockError>> {
    let pairs = match FramePairs::check(&recording.pairs) {
        Ok(pairs) => pairs,
        Err(error) => return METHODS.iter().map(|_| Err(error.clone())).collect(),
    };
    let rate = match clocks {
        Clocks::Kernel | Clocks::KernelStep => RateModel::SameHost,
        Clocks::Device | Clocks::DeviceSlew => RateModel::Device,
    };
    vec![
        paper_interval(&recording.pairs, PaperUnit::Microseconds),
        paper_window(&pairs),
        hull(&pairs, MinimumLatency::Unknown),
        olson2(&pairs, 50.0, MinimumLatency::Unknown),
        envelope(&pairs, &EnvelopeOptions { rate, ..EnvelopeOptions::default() }),
        clock_pair(&recording.readings, &PairOptions::default()),
    ]
}

fn run(scenario: Scenario, trials: u64) {
    let mut scores: Vec<Score> = METHODS.iter().map(|_| Score::default()).collect();
    for trial in 0..trials {
        let recording = record(scenario, 1_000 + trial);
        for (number, estimate) in estimates(&recording, scenario.clocks).into_iter().enumerate() {
            // Two-sided readings have no smallest latency in them.
            let is_two_sided = METHODS[number] == "clock-pair";
            let smallest = Span::from_secs_f64(if is_two_sided { SMALLEST_S } else { 0.0 });
            match estimate {
                Ok(estimate) => scores[number].take(&recording, &estimate, smallest),
                Err(error) => println!("{} failed: {error}", METHODS[number]),
            }
        }
    }
    println!(
        "\n{:?}, {:?}, {:.0} fps, {:.0} s, {trials} trials",
        scenario.family, scenario.clocks, scenario.fps, scenario.duration_s
    );
    println!("method              rms us   worst us  paper/own   in 95%   in 90%   width us");
    let paper = scores[0].rms_us();
    let is_drifting = matches!(scenario.clocks, Clocks::Device | Clocks::DeviceSlew);
    for (name, score) in METHODS.iter().zip(&mut scores) {
        if *name != "clock-pair" || !is_drifting {
            score.print(name, paper);
        }
    }
}

fn main() {
    let trials = std::env::args().nth(1).and_then(|text| text.parse().ok()).unwrap_or(100);
    for clocks in [Clocks::Kernel, Clocks::KernelStep, Clocks::Device, Clocks::DeviceSlew] {
        for family in [Family::Gamma, Family::Lognormal, Family::Bimodal] {
            for (duration_s, trials) in [(5.0, 2 * trials), (60.0, trials), (600.0, trials / 4)] {
                run(Scenario { family, clocks, fps: 120.0, duration_s }, trials.max(1));
            }
        }
    }
    let slow = |family| Scenario { family, clocks: Clocks::Kernel, fps: 30.0, duration_s: 60.0 };
    run(slow(Family::Gamma), trials);
    run(slow(Family::Lognormal), trials);
}
