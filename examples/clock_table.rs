//! Comparison of the clock methods on simulated recordings; the tables are in
//! `docs/reference/clock-accuracy.md`.
//!
//! `cargo run --release --example clock_table [TRIALS]` (60 s recordings; twice as many of
//! 5 s, a quarter of 600 s).

#![allow(clippy::print_stdout)]

use evrig::clock::{
    ClockError, ClockEstimate, EnvelopeOptions, FramePair, FramePairs, MinimumLatency, PairOptions,
    PaperUnit, RateModel, TwoSidedReading, clock_pair, envelope, hull, olson2, paper_interval,
    paper_window,
};
use evrig::clock::{MotionOptions, RowTiming, TrackSample, motion};
use evrig::time::{ClockMap, Davis, PiSensor, Span, Stamp, Unix};
use evrig::units::Pixels;
use seen_motion::{DAVIS_FPS, PI_FPS, Path, Scene};
use simulation::{Clocks, Family, Recording, SMALLEST_S, Scenario, record};

#[path = "../crates/evrig-reconstruct/src/clock/tests/seen_motion.rs"]
mod seen_motion;
#[path = "../crates/evrig-reconstruct/src/clock/tests/simulation.rs"]
mod simulation;

const METHODS: [&str; 6] =
    ["paper-interval", "paper-window", "hull", "olson2", "envelope", "clock-pair"];

/// Errors of one method over the trials of one scenario.
#[derive(Default)]
struct Score {
    sum_of_squares: f64,
    /// The same over frames that are not marked as doubtful.
    sure_squares: f64,
    n_sure: u64,
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
            if !estimate.is_doubtful(pair.sensor) {
                self.sure_squares += error_us * error_us;
                self.n_sure += 1;
            }
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
        let sure_us = (self.sure_squares / self.n_sure as f64).sqrt();
        let worst_us = self.worst_us;
        print!("{name:15} {:10.1} {sure_us:10.1} {worst_us:10.0} {ratio:10.1}", self.rms_us());
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

/// Knowledge of the minimum latency: the readout of 864 rows as a lower bound, or a calibration.
fn known_latencies() -> [(&'static str, MinimumLatency); 2] {
    let smallest = Span::from_secs_f64(SMALLEST_S);
    [
        ("+ readout", MinimumLatency::ReadoutFloor { floor: Span::from_micros(7_957) }),
        ("+ calibrated", MinimumLatency::Calibrated { low: smallest, high: smallest }),
    ]
}

/// The envelope with a known latency, which places the instant of a step.
fn run_known(scenario: Scenario, trials: u64, paper_rms_us: f64) {
    for (name, latency) in known_latencies() {
        let mut score = Score::default();
        for trial in 0..trials {
            let recording = record(scenario, 1_000 + trial);
            let options = EnvelopeOptions { latency, ..EnvelopeOptions::default() };
            let found = FramePairs::check(&recording.pairs).and_then(|p| envelope(&p, &options));
            match found {
                Ok(estimate) => score.take(&recording, &estimate, latency.subtracted()),
                Err(error) => println!("{name} failed: {error}"),
            }
        }
        score.print(name, paper_rms_us);
    }
}

fn run(scenario: Scenario, trials: u64) {
    let mut scores: Vec<Score> = METHODS.iter().map(|_| Score::default()).collect();
    for trial in 0..trials {
        let recording = record(scenario, 1_000 + trial);
        for (number, estimate) in estimates(&recording, scenario.clocks).into_iter().enumerate() {
            // Two-sided readings do not contain the minimum latency.
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
    println!(
        "method              rms us    sure us   worst us  paper/own   in 95%   in 90%   width us"
    );
    let paper = scores[0].rms_us();
    let is_drifting = matches!(scenario.clocks, Clocks::Device | Clocks::DeviceSlew);
    for (name, score) in METHODS.iter().zip(&mut scores) {
        if *name != "clock-pair" || !is_drifting {
            score.print(name, paper);
        }
    }
    if scenario.clocks == Clocks::KernelStep {
        run_known(scenario, trials, paper);
    }
}

/// The offset from motion: its scatter over the Cramér-Rao limit, and how often it is refused.
fn run_motion(path: Path, duration_s: f64, trials: u64) {
    let scene = Scene::new(path, duration_s);
    let (mut squares, mut sum, mut in95, mut in90, mut answered) = (0.0, 0.0, 0_u64, 0_u64, 0_u64);
    let (mut claimed_us, mut limit_us) = (0.0, f64::NAN);
    for trial in 0..trials {
        let tracks = scene.film(5_000 + trial);
        let (pi, davis) = Scene::zeros();
        let initial = ClockMap::from_anchor(pi, davis);
        let found = motion(&tracks.pi, &tracks.davis, initial, &MotionOptions::default());
        let Ok(found) = found else { continue };
        let at = tracks.davis[tracks.davis.len() / 2].at;
        let Some(mapped) = found.clock.map(at) else { continue };
        let error_us = (mapped.as_nanos() - scene.pi_from_davis(at)) as f64 * 1e-3;
        let sigma_us = found.correction_us.standard_error;
        answered += 1;
        sum += error_us;
        squares += error_us * error_us;
        claimed_us += sigma_us;
        in95 += u64::from(error_us.abs() < 1.96 * sigma_us);
        in90 += u64::from(found.correction_us.covers(found.correction_us.value - error_us));
        // What the reference saw in the same time counts; the rest has no counterpart.
        let n_davis = found.clock.tally.n_kept as usize;
        let n_pi = (n_davis as f64 * PI_FPS / DAVIS_FPS) as usize;
        limit_us = 1e6 * scene.limit_s(n_pi, n_davis);
    }
    let n = answered as f64;
    println!(
        "{:10} {duration_s:6.0} s {trials:5} {answered:8} {:8.1} {:8.1} {:8.1} {limit_us:8.1} \
         {:7.2} {:7.0} {:7.0}",
        format!("{path:?}"),
        sum / n,
        (squares / n).sqrt(),
        claimed_us / n,
        (squares / n).sqrt() / limit_us,
        100.0 * in95 as f64 / n,
        100.0 * in90 as f64 / n
    );
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
    println!(
        "\nmotion       time  tracks answered  bias us   rms us  claimed    limit rms/lim  in \
         95%  in 90%"
    );
    for path in [Path::BothWays, Path::Lissajous, Path::OneWay] {
        run_motion(path, 5.0, 2 * trials);
        run_motion(path, 60.0, trials);
        run_motion(path, 600.0, (trials / 5).max(1));
    }
}
