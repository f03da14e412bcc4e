//! The law against closed forms, and its smoothness.

use super::burst_window::BurstWindow;
use super::law::{ComparatorLaw, LOGISTIC_SD, softplus};
use super::pass::{HazardTerm, PixelPass, TermVisitor, visit};
use super::pixel_events::Spike;
use super::signal::SampledSignal;
use super::time_blocks::TimeBlocks;
use evrig_core::stats::SplitMix;

#[derive(Default)]
struct LogLikelihood {
    events: f64,
    silences: f64,
}

impl TermVisitor for LogLikelihood {
    fn silence(&mut self, _block: usize, compensator: f64) {
        self.silences += compensator;
    }
    fn event(&mut self, term: &HazardTerm) {
        self.events += term.log_hazard;
    }
}

fn score(law: &ComparatorLaw, signal: &[f64], spikes: &[Spike]) -> LogLikelihood {
    let level = vec![0.0; signal.len()];
    let darkness = vec![1.0; signal.len()];
    let sampled = SampledSignal {
        start_us: 0.0,
        step_us: 1_000.0,
        signal,
        level: &level,
        darkness: &darkness,
        bursts: &[],
    };
    let blocks = TimeBlocks::new(1_000 * signal.len() as i64, 3);
    let mut sum = LogLikelihood::default();
    visit(law, sampled, spikes, &blocks, &mut sum);
    sum
}

fn law() -> ComparatorLaw {
    ComparatorLaw {
        noise: 0.02,
        rest_share: 1.0,
        stored_share: 0.0,
        noise_rate_hz: 1.0,
        background_hz: [0.0; 2],
        ..ComparatorLaw::default()
    }
}

#[test]
fn a_steady_ramp_meets_logistic_thresholds() {
    // 2.5 per second: the ON threshold of 0.25 is met after 100 ms.
    let signal: Vec<f64> = (0..=120).map(|i| 2.5e-3 * f64::from(i)).collect();
    let start = Spike { t_us: 0, on: true };
    let silences = score(&law(), &signal, &[start]).silences;
    // Survival of a logistic threshold at u = 0.3 / 0.25, of scale 0.02 / 0.25.
    let expected = softplus((0.3 / 0.25 - 1.0) * 0.25 / 0.02);
    assert!((silences / expected - 1.0).abs() < 1e-3, "{silences}, not {expected}");
}

#[test]
fn the_score_has_no_cliff_where_the_signal_turns_at_the_threshold() {
    // The signal touches 0.25 at 100 ms and returns; the event comes just behind the extremum.
    let signal: Vec<f64> =
        (0..=200).map(|i| 0.25 * (1.0 - (f64::from(i) / 100.0 - 1.0).powi(2))).collect();
    let spikes = [Spike { t_us: 0, on: true }, Spike { t_us: 101_000, on: true }];
    let at = |theta: f64| {
        let sum = score(&ComparatorLaw { theta: [theta; 2], ..law() }, &signal, &spikes);
        sum.events - sum.silences
    };
    let scores: Vec<f64> = (0..=40).map(|i| at(0.24 + 5e-4 * f64::from(i))).collect();
    let steps: Vec<f64> = scores.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let bends = steps.windows(2).map(|pair| (pair[1] - pair[0]).abs());
    let largest = bends.fold(0.0, f64::max);
    assert!(largest < 5e-3, "slope changes by {largest} nats from one step to the next");
}

/// Events of a comparator whose signal carries noise of 0.03 and 1 kHz, to a hundredth of a
/// millisecond.
fn crossings_of_noise(light: impl Fn(f64) -> f64, seconds: f64, seed: u64) -> Vec<Spike> {
    const STEP_S: f64 = 1e-5;
    let kept = (-std::f64::consts::TAU * 1_000.0 * STEP_S).exp();
    let mut random = SplitMix::new(seed, 1);
    let (mut noise, mut reference) = (0.03 * random.normal(), light(0.0));
    let mut spikes = Vec::new();
    for i in 0..(seconds / STEP_S) as i64 {
        noise = kept * noise + 0.03 * (1.0 - kept * kept).sqrt() * random.normal();
        let change = light(i as f64 * STEP_S) + noise - reference;
        if change.abs() >= 0.25 {
            spikes.push(Spike { t_us: i * 10, on: change > 0.0 });
            reference += 0.25 * change.signum();
        }
    }
    spikes
}

#[test]
fn noise_that_leads_crossings_does_not_move_the_clock() {
    let wave = |seed: u64, t: f64| {
        let pitch = 5.0 + 0.37 * seed as f64;
        1.2 * (pitch * t + 0.7 * seed as f64).sin() + (1.7 * pitch * t).sin()
    };
    let pixels: Vec<_> =
        (0..40).map(|seed| crossings_of_noise(|t| wave(seed, t), 2.0, seed)).collect();
    let at = |noise_rate_hz: f64, offset_us: i32| {
        let noisy = ComparatorLaw {
            noise: 0.016,
            stored_share: 1.0,
            noise_rate_hz,
            background_hz: [0.01; 2],
            ..law()
        };
        let of = |(seed, spikes): (u64, &Vec<Spike>)| {
            let light = |i: i32| wave(seed, 1e-3 * f64::from(i) - 1e-6 * f64::from(offset_us));
            let signal: Vec<f64> = (0..2_000).map(light).collect();
            let sum = score(&noisy, &signal, spikes);
            sum.events - sum.silences
        };
        (0..).zip(&pixels).map(of).sum::<f64>()
    };
    // The rate that fits best, as a fit would find it.
    let rates = [7e3, 1e4, 1.4e4, 2e4, 2.8e4];
    let tried = rates.iter().flat_map(|rate| (-5..=5).map(|i| (at(*rate, 50 * i), 50 * i)));
    let (_, best_us) = tried.max_by(|a, b| a.0.total_cmp(&b.0)).unwrap();
    // Without the leads it is 250 us early.
    assert!(best_us.abs() <= 50, "{best_us}");
}

#[test]
fn a_refractory_period_takes_its_reference_at_its_end() {
    let signal: Vec<f64> = (0..=120).map(|i| 2.5e-3 * f64::from(i)).collect();
    let start = [Spike { t_us: 0, on: true }];
    let refractory = ComparatorLaw { refractory_s: 0.02, onset_s: 2e-4, ..law() };
    let with = score(&refractory, &signal, &start).silences;
    let expected = softplus((0.25 / 0.25 - 1.0) * 0.25 / 0.02);
    assert!((with / expected - 1.0).abs() < 1e-2, "{with}, not {expected}");
}

#[test]
fn lost_events_advance_the_reference_level() {
    // Two thresholds of change without a recorded event.
    let signal: Vec<f64> = (0..=220).map(|i| 2.5e-3 * f64::from(i)).collect();
    let start = [Spike { t_us: 0, on: true }];
    let lossy = ComparatorLaw { loss: 0.1, ..law() };
    let silences = score(&lossy, &signal, &start).silences;
    // A tenth of the first crossings is lost; of those, a tenth of the second ones, or the second
    // crossing is still to come at u = 0.3 / 0.25.
    let pending = (-softplus((0.3 / 0.25 - 1.0) * 0.25 / 0.02)).exp();
    let expected = -(0.1 * (pending + (1.0 - pending) * 0.1)).ln();
    assert!((silences - expected).abs() < 0.02, "{silences}, not {expected}");
}

/// Draws the event after each recorded one, many times.
struct RepeatedDraws {
    random: SplitMix,
    innovations: Vec<f64>,
}

impl TermVisitor for RepeatedDraws {
    fn silence(&mut self, _block: usize, _compensator: f64) {}
    fn event(&mut self, _term: &HazardTerm) {}
    fn after(&mut self, pass: &PixelPass<'_>, _index: usize) {
        for _ in 0..2_000 {
            let drawn = pass.draw_next(1e9, &mut self.random);
            self.innovations.extend(drawn.map(|drawn| drawn.change - 1.0));
        }
    }
}

#[test]
fn drawn_events_have_the_scatter_of_the_law_within_one_segment() {
    // 50 per second: the threshold lies in one step, and the noise in a hundredth of it.
    let signal: Vec<f64> = (0..=20).map(|i| 0.05 * f64::from(i)).collect();
    let sharp = ComparatorLaw { noise: 0.000_5, ..law() };
    let (level, darkness) = (vec![0.0; 21], vec![1.0; 21]);
    let sampled = SampledSignal {
        start_us: 0.0,
        step_us: 1_000.0,
        signal: &signal,
        level: &level,
        darkness: &darkness,
        bursts: &[],
    };
    let mut draws = RepeatedDraws { random: SplitMix::new(3, 1), innovations: Vec::new() };
    let blocks = TimeBlocks::new(20_000, 1);
    visit(&sharp, sampled, &[Spike { t_us: 0, on: true }], &blocks, &mut draws);
    let n = draws.innovations.len() as f64;
    let mean = draws.innovations.iter().sum::<f64>() / n;
    let sd = (draws.innovations.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n).sqrt();
    // A logistic distribution of scale 0.0005 / 0.25.
    let expected = LOGISTIC_SD * 0.000_5 / 0.25;
    assert!(mean.abs() < 4.0 * expected / n.sqrt(), "{mean}");
    assert!((sd / expected - 1.0).abs() < 0.1, "{sd}, not {expected}");
}

#[test]
fn bursts_add_their_rate_to_silences_and_events() {
    // A constant signal, and a burst within one step that ends 10 us after the event.
    let bursts = [BurstWindow { from_us: 50_400.0, to_us: 50_510.0, hz: [2_000.0, 0.0] }];
    let (signal, level, darkness) = (vec![0.0; 101], vec![0.0; 101], vec![1.0; 101]);
    let coupled = ComparatorLaw { burst_factor: 0.5, ..law() };
    let sampled = SampledSignal {
        start_us: 0.0,
        step_us: 1_000.0,
        signal: &signal,
        level: &level,
        darkness: &darkness,
        bursts: &bursts,
    };
    let spikes = [Spike { t_us: 0, on: true }, Spike { t_us: 50_500, on: true }];
    let mut sum = LogLikelihood::default();
    visit(&coupled, sampled, &spikes, &TimeBlocks::new(100_000, 3), &mut sum);
    // 1000 Hz for 110 us.
    assert!((sum.silences - 0.11).abs() < 1e-6, "{}", sum.silences);
    assert!((sum.events - 1_000.0_f64.ln()).abs() < 1e-6, "{}", sum.events);
}
