//! One motion seen by two cameras, with the truth: rows, exposures, noise, offset and skew.

use super::{Davis, PiSensor, Pixels, RowTiming, Span, Stamp, TrackSample};
use rand::rngs::StdRng;
use rand::{Rng, SeedableRng};
use rand_distr::StandardNormal;
use std::f64::consts::TAU;

/// What the tag does in the reference camera's image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Path {
    /// A circle at constant speed in one direction.
    OneWay,
    /// The same circle, half of the time in each direction.
    BothWays,
    /// A figure of eight.
    Lissajous,
}

#[derive(Debug, Clone, Copy)]
pub(super) struct Scene {
    pub(super) path: Path,
    pub(super) duration_s: f64,
    /// What the second camera's stamps lack to the reference's, seconds.
    pub(super) tau_s: f64,
    pub(super) skew: f64,
    pub(super) roll_deg: f64,
    /// Standard error of a detected coordinate in either camera, pixels.
    pub(super) noise_px: f64,
}

pub(super) struct Tracks {
    pub(super) pi: Vec<TrackSample<PiSensor>>,
    pub(super) davis: Vec<TrackSample<Davis>>,
}

pub(super) const RADIUS_PX: f64 = 20.0;
pub(super) const FREQUENCY_HZ: f64 = 0.5;
pub(super) const SCALE: f64 = 0.8;
pub(super) const PI_FPS: f64 = 120.0;
pub(super) const DAVIS_FPS: f64 = 40.0;
const PI_NS: i64 = 7_000_000_000_000;
const DAVIS_NS: i64 = 1_760_000_000_000_000_000;
/// The time in which the direction turns.
const TURN_S: f64 = 0.2;

impl Scene {
    pub(super) fn new(path: Path, duration_s: f64) -> Self {
        Self { path, duration_s, tau_s: 0.0123, skew: 20e-6, roll_deg: 3.0, noise_px: 0.1 }
    }

    /// Position in the reference at true time, pixels about the middle.
    fn position(&self, t: f64) -> [f64; 2] {
        let turn = TAU * FREQUENCY_HZ;
        let since = t - 0.5 * self.duration_s;
        let angle = match self.path {
            Path::OneWay | Path::Lissajous => turn * t,
            Path::BothWays if since.abs() < TURN_S => -turn * since * since / (2.0 * TURN_S),
            Path::BothWays => -turn * (since.abs() - 0.5 * TURN_S),
        };
        let double = if self.path == Path::Lissajous { 2.0 } else { 1.0 };
        [RADIUS_PX * angle.cos(), RADIUS_PX * (double * angle).sin()]
    }

    /// Position in the second camera.
    fn other(&self, t: f64) -> [f64; 2] {
        let [x, y] = self.position(t);
        let (sin, cos) = self.roll_deg.to_radians().sin_cos();
        [170.0 + SCALE * (cos * x - sin * y), 130.0 + SCALE * (sin * x + cos * y)]
    }

    /// The Cramér-Rao limit with known geometry, from the formula: both tracks noisy, the speed
    /// that of the true path. Seconds.
    pub(super) fn limit_s(&self, n_pi: usize, n_davis: usize) -> f64 {
        let n = 20_000;
        let step = self.duration_s / f64::from(n);
        let speed2: f64 = (0..n)
            .map(|i| self.duration_s * (f64::from(i) + 0.5) / f64::from(n))
            .map(|t| (self.position(t - step), self.position(t + step)))
            .map(|(a, b)| ((b[0] - a[0]).powi(2) + (b[1] - a[1]).powi(2)) / (4.0 * step * step))
            .sum::<f64>()
            / f64::from(n);
        let noise2 = self.noise_px.powi(2);
        let sum = noise2 / n_pi as f64 + (noise2 / SCALE.powi(2)) / n_davis as f64;
        (sum / speed2).sqrt()
    }

    /// The second camera's stamp at true time, nanoseconds after its own zero.
    fn davis_ns(&self, t: f64) -> i64 {
        let middle = 0.5 * self.duration_s;
        // Inverse of a = b + tau + skew (b - middle), to first order in the skew.
        let b = t - self.tau_s;
        ((b - self.skew * (b - middle)) * 1e9).round() as i64
    }

    /// What the reference's clock shows when the second camera's shows `davis`, ns.
    pub(super) fn pi_from_davis(&self, davis: Stamp<Davis>) -> i64 {
        let b = (davis.as_nanos() - DAVIS_NS) as f64 * 1e-9;
        PI_NS + ((b + self.tau_s + self.skew * (b - 0.5 * self.duration_s)) * 1e9).round() as i64
    }

    /// Both zeros at once: the map one would start from without any knowledge of the offset.
    pub(super) fn zeros() -> (Stamp<PiSensor>, Stamp<Davis>) {
        (Stamp::from_nanos(PI_NS), Stamp::from_nanos(DAVIS_NS))
    }

    pub(super) fn film(&self, seed: u64) -> Tracks {
        let mut rng = StdRng::seed_from_u64(seed);
        let rolling = RowTiming {
            row_time: Span::from_nanos(9_209),
            exposure: Span::from_micros(4_000),
            ..RowTiming::default()
        };
        let error = Pixels(self.noise_px);
        let mut noisy = |value: f64| value + self.noise_px * rng.sample::<f64, _>(StandardNormal);
        let n_pi = (self.duration_s * PI_FPS) as i64;
        let pi = (0..n_pi).map(|frame| {
            let stamp = Stamp::from_nanos(PI_NS + (frame as f64 * 1e9 / PI_FPS) as i64);
            // The row on which the tag lies depends on when that row is read.
            let mut at = stamp;
            for _ in 0..4 {
                let [_, y] = self.position((at.as_nanos() - PI_NS) as f64 * 1e-9);
                at = rolling.middle(stamp, 260.0 + y);
            }
            let [x, y] = self.position((at.as_nanos() - PI_NS) as f64 * 1e-9);
            let (x, y) = (noisy(346.0 + x), noisy(260.0 + y));
            TrackSample { at: rolling.middle(stamp, y), x: Pixels(x), y: Pixels(y), error }
        });
        let pi: Vec<_> = pi.collect();
        let n_davis = (self.duration_s * DAVIS_FPS) as i64;
        let davis = (0..n_davis).map(|frame| {
            let t = frame as f64 / DAVIS_FPS + 0.003;
            let [x, y] = self.other(t);
            let at = Stamp::from_nanos(DAVIS_NS + self.davis_ns(t));
            TrackSample { at, x: Pixels(noisy(x)), y: Pixels(noisy(y)), error }
        });
        Tracks { davis: davis.collect(), pi }
    }
}
