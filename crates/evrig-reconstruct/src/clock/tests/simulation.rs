//! Simulated frames, clocks and readings of which the truth is known.
//!
//! Latencies here are assumptions: a smallest latency of 12 ms plus one of three laws, stalls
//! of 50 to 500 ms behind which six frames wait and the rest are lost, 1 % of frames lost at
//! random, stamps in whole microseconds, an interrupt 1 us late.

use super::{FramePair, PiSensor, Stamp, TwoSidedReading, Unix};
use rand::rngs::StdRng;
use rand::{Rng, SeedableRng};
use rand_distr::{Exp1, StandardNormal};
use std::f64::consts::TAU;

/// Law of the latency above its smallest value.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Family {
    /// Shape 2, scale 0.5 ms.
    Gamma,
    /// Median 1 ms, sigma 0.8: the flattest lower tail of the three.
    Lognormal,
    /// A narrow law, 4 ms later in 30 % of frames.
    Bimodal,
}

/// How the two clocks run against each other.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Clocks {
    /// One host: a constant difference.
    Kernel,
    /// One host whose clock is set back by 20 ms once.
    KernelStep,
    /// A crystal within 50 ppm that swings by 1 ppm in 600 s.
    Device,
    /// The same, and the host slews by 100 ppm for a quarter of the time.
    DeviceSlew,
}

#[derive(Debug, Clone, Copy)]
pub(super) struct Scenario {
    pub(super) family: Family,
    pub(super) clocks: Clocks,
    pub(super) fps: f64,
    pub(super) duration_s: f64,
}

pub(super) struct Recording {
    pub(super) pairs: Vec<FramePair>,
    /// RealTime that each frame would have had with the smallest latency, by the true clocks.
    pub(super) truth: Vec<Stamp<Unix>>,
    /// Five sandwiches a frame.
    pub(super) readings: Vec<TwoSidedReading>,
}

/// The smallest latency, seconds.
pub(super) const SMALLEST_S: f64 = 0.012;
const BOOT_NS: i64 = 4_321_000_000_000;
const UNIX_NS: i64 = 1_760_000_000_000_000_000;
const QUEUE: usize = 6;

/// RealTime against the sensor's clock, seconds after the common beginning.
struct Truth {
    clocks: Clocks,
    duration_s: f64,
    event_s: f64,
    skew: f64,
    phase: f64,
}

impl Truth {
    fn new(scenario: Scenario, rng: &mut StdRng) -> Self {
        Self {
            clocks: scenario.clocks,
            duration_s: scenario.duration_s,
            event_s: scenario.duration_s * rng.random_range(0.35..0.65),
            skew: rng.random_range(-50e-6..50e-6),
            phase: rng.random_range(0.0..TAU),
        }
    }

    fn offset_s(&self, t: f64) -> f64 {
        let swing = |t: f64| 1e-6 * 600.0 / TAU * (TAU * t / 600.0 + self.phase).sin();
        let device = self.skew * t + swing(t) - swing(0.0);
        match self.clocks {
            Clocks::Kernel => 0.0,
            Clocks::KernelStep if t < self.event_s => 0.0,
            Clocks::KernelStep => -0.020,
            Clocks::Device => device,
            Clocks::DeviceSlew => {
                device + 100e-6 * (t - self.event_s).clamp(0.0, self.duration_s / 4.0)
            }
        }
    }

    fn real(&self, t: f64) -> i64 {
        UNIX_NS + ((t + self.offset_s(t)) * 1e9).round() as i64
    }
}

fn whole_us(ns: i64) -> i64 {
    ns.div_euclid(1_000) * 1_000
}

fn latency_s(family: Family, rng: &mut StdRng) -> f64 {
    let exponential = |rng: &mut StdRng| rng.sample::<f64, _>(Exp1);
    let above = match family {
        Family::Gamma => 0.5e-3 * (exponential(rng) + exponential(rng)),
        Family::Lognormal => 1e-3 * (0.8 * rng.sample::<f64, _>(StandardNormal)).exp(),
        Family::Bimodal => {
            let late = if rng.random_bool(0.3) { 4e-3 } else { 0.0 };
            late + 0.3e-3 * exponential(rng)
        }
    };
    SMALLEST_S + above
}

pub(super) fn record(scenario: Scenario, seed: u64) -> Recording {
    let mut rng = StdRng::seed_from_u64(seed);
    let truth = Truth::new(scenario, &mut rng);
    let period = 1.0 / scenario.fps;
    let n = (scenario.duration_s * scenario.fps) as usize;
    let (mut pairs, mut truths) = (Vec::with_capacity(n), Vec::with_capacity(n));
    let (mut stall_until, mut waiting, mut delivered) = (f64::NEG_INFINITY, 0, f64::NEG_INFINITY);
    for frame in 0..n {
        let t = frame as f64 * period;
        if t > stall_until && rng.random_bool(0.002 * period / (1.0 / 120.0)) {
            stall_until = t + rng.random_range(0.05..0.5);
            waiting = 0;
        }
        let late = 1e-6 * rng.sample::<f64, _>(StandardNormal).abs();
        let mut arrival = t + latency_s(scenario.family, &mut rng);
        let is_lost = rng.random_bool(0.01);
        if arrival < stall_until {
            waiting += 1;
            arrival = stall_until + 0.3e-3 * waiting as f64;
        }
        if is_lost || waiting > QUEUE && t < stall_until {
            continue;
        }
        // Frames are delivered one after the other.
        arrival = arrival.max(delivered + 20e-6);
        delivered = arrival;
        let sensor_ns = whole_us(BOOT_NS + ((t + late) * 1e9) as i64);
        let sensor_s = (sensor_ns - BOOT_NS) as f64 * 1e-9;
        let real = Stamp::from_nanos(whole_us(truth.real(arrival)));
        pairs.push(FramePair::new(Stamp::<PiSensor>::from_nanos(sensor_ns), real));
        truths.push(Stamp::from_nanos(truth.real(sensor_s) + (SMALLEST_S * 1e9) as i64));
    }
    let readings = readings(scenario, &truth, &mut rng);
    Recording { pairs, truth: truths, readings }
}

fn readings(scenario: Scenario, truth: &Truth, rng: &mut StdRng) -> Vec<TwoSidedReading> {
    let mut readings = Vec::new();
    for group in 0..(scenario.duration_s * scenario.fps) as u64 {
        for sandwich in 0..5 {
            let t = group as f64 / scenario.fps + f64::from(sandwich) * 1e-6;
            // Mostly 200 ns wide; now and then something gets in between.
            let width = 200e-9
                + 50e-9 * rng.sample::<f64, _>(Exp1)
                + if rng.random_bool(0.02) { 30e-6 } else { 0.0 };
            let at = t + width * rng.random_range(0.0..1.0);
            readings.push(TwoSidedReading {
                group,
                before: Stamp::from_nanos(BOOT_NS + (t * 1e9) as i64),
                real: Stamp::from_nanos(truth.real(at)),
                after: Stamp::from_nanos(BOOT_NS + ((t + width) * 1e9) as i64),
            });
        }
    }
    readings
}
