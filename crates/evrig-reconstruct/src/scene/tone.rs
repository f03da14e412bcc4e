//! Tone curve of the Pi's frames relative to the event camera's.
//!
//! Where the map is smooth, `v_k = g_k (1 - c r^2) (m^q - o)`: frame `k` of the event camera reads
//! `v` where the map is `m` of white. The gains `g_k` belong to the frames, the pedestal `o` of
//! either camera is free, `r` is the distance from the image centre over that of the corners, and
//! `q` is 1 where both cameras are linear. Frames with gamma `g` make a map with `q = 1 / g`.

use super::clustered_covariance::clustered_covariance;
use super::pi_camera::squared_radius;
use nalgebra::{SMatrix, SVector};
use serde::{Deserialize, Serialize};

/// Unknowns of all frames: `q`, `o` and `c`.
const TONE_UNKNOWNS: usize = 3;
const ITERATIONS: usize = 12;
/// Huber threshold in standard deviations.
const HUBER_SIGMAS: f64 = 2.5;
/// Clusters of target positions.
const CLUSTERS: usize = 24;
/// Side of a cluster's cell on the target, millimetres.
const CLUSTER_MM: f64 = 6.0;
/// Fewest samples.
const MIN_SAMPLES: usize = 2_000;
/// Systematic model error of the exponent and of the corner loss.
const MODEL_ERROR: [f64; 2] = [0.01, 0.005];

/// Tone of both cameras, estimated from the event camera's frames.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ToneFit {
    /// Gamma of the Pi's frames relative to the event camera's, with its standard error.
    pub gamma: [f64; 2],
    /// Vignetting of the event camera's lens at the corners, as a share of the light, with its
    /// standard error.
    pub corner_loss: [f64; 2],
}

/// Least deviation of gamma from one, and least number of standard errors, of a nonlinear camera.
const MIN_NONLINEARITY: f64 = 0.03;
const MIN_SIGMAS: f64 = 5.0;

impl ToneFit {
    /// Standard errors by which gamma differs from one, if the Pi's frames are nonlinear.
    #[must_use]
    pub fn nonlinear_sigmas(&self) -> Option<f64> {
        let [gamma, error] = self.gamma;
        let z = (gamma - 1.0).abs() / error;
        ((gamma - 1.0).abs() > MIN_NONLINEARITY && z > MIN_SIGMAS).then_some(z)
    }

    /// Exponent that linearises the Pi's frames.
    #[must_use]
    pub fn power(&self) -> f64 {
        self.nonlinear_sigmas().map_or(1.0, |_| 1.0 / self.gamma[0])
    }
}

/// A pixel of the event camera that views a smooth point of the map.
#[derive(Debug, Clone, Copy)]
pub(super) struct ToneSample {
    /// Reading, DN.
    pub(super) value: f64,
    pub(super) mapped: f64,
    /// Squared distance from the image centre over that of the corners.
    pub(super) squared_radius: f64,
    pub(super) place_mm: [f64; 2],
}

impl ToneSample {
    pub(super) fn new(
        size: evrig_core::geometry::Size,
        pixel: [usize; 2],
        value: f64,
        mapped: f64,
        place_mm: [f64; 2],
    ) -> Self {
        let squared_radius = squared_radius(size, pixel.map(|p| p as f64 + 0.5));
        Self { value, mapped, squared_radius, place_mm }
    }

    /// Expected light at unit gain, and its derivatives by the shared unknowns.
    fn expected(&self, [q, o, c]: [f64; TONE_UNKNOWNS]) -> (f64, [f64; TONE_UNKNOWNS]) {
        let passed = 1.0 - c * self.squared_radius;
        let power = self.mapped.powf(q);
        let light = power - o;
        let slopes = [passed * power * self.mapped.ln(), -passed, -self.squared_radius * light];
        (passed * light, slopes)
    }
}

/// Normal equations with the frame gains eliminated.
struct ToneEquations {
    normal: SMatrix<f64, TONE_UNKNOWNS, TONE_UNKNOWNS>,
    right: SVector<f64, TONE_UNKNOWNS>,
    /// Right sides by frame and by cluster of positions.
    by_frame: Vec<SVector<f64, TONE_UNKNOWNS>>,
    by_cluster: Vec<SVector<f64, TONE_UNKNOWNS>>,
    /// Mean squared residual, DN².
    residual: f64,
}

/// Tone fitted to samples of several frames; None with too few.
pub(super) fn fit_tone(frames: &[Vec<ToneSample>]) -> Option<ToneFit> {
    if frames.iter().map(Vec::len).sum::<usize>() < MIN_SAMPLES {
        return None;
    }
    let mut at = [1.0, 0.0, 0.0];
    let mut noise = f64::INFINITY;
    let mut last = None;
    for _ in 0..ITERATIONS {
        let equations = ToneEquations::at(frames, at, noise)?;
        let inverse = equations.normal.try_inverse()?;
        let change = inverse * equations.right;
        at = std::array::from_fn(|i| at[i] + change[i]);
        at[0] = at[0].clamp(0.2, 5.0);
        at[2] = at[2].clamp(-0.5, 0.9);
        noise = equations.residual;
        last = Some((equations, inverse));
    }
    let (equations, inverse) = last?;
    let [frames, clusters] =
        [&equations.by_frame, &equations.by_cluster].map(|s| clustered_covariance(&inverse, s));
    let error = |i: usize| frames[(i, i)].max(clusters[(i, i)]).max(0.0).sqrt();
    let gamma = 1.0 / at[0];
    let found = ToneFit {
        gamma: [gamma, (error(0) * gamma * gamma).hypot(MODEL_ERROR[0])],
        corner_loss: [at[2], error(2).hypot(MODEL_ERROR[1])],
    };
    found.gamma.iter().chain(&found.corner_loss).all(|v| v.is_finite()).then_some(found)
}

impl ToneEquations {
    fn at(frames: &[Vec<ToneSample>], at: [f64; TONE_UNKNOWNS], noise: f64) -> Option<Self> {
        let mut all = Self {
            normal: SMatrix::zeros(),
            right: SVector::zeros(),
            by_frame: Vec::new(),
            by_cluster: vec![SVector::zeros(); CLUSTERS],
            residual: 0.0,
        };
        let mut n = 0.0;
        for samples in frames.iter().filter(|samples| !samples.is_empty()) {
            all.residual += all.add(samples, at, noise)?;
            n += samples.len() as f64;
        }
        all.residual /= n;
        Some(all)
    }

    /// Adds a frame; returns its weighted sum of squared residuals.
    fn add(&mut self, samples: &[ToneSample], at: [f64; TONE_UNKNOWNS], noise: f64) -> Option<f64> {
        let (mut square, mut across) = (0.0, 0.0);
        for sample in samples {
            let light = sample.expected(at).0;
            (square, across) = (square + light * light, across + light * sample.value);
        }
        let gain = across / square;
        if !gain.is_finite() || gain <= 0.0 {
            return None;
        }
        let (mut own, mut own_right) = (0.0, 0.0);
        let mut joint = SVector::<f64, TONE_UNKNOWNS>::zeros();
        let mut rows = Vec::with_capacity(samples.len());
        let mut squares = 0.0;
        for sample in samples {
            let (light, slopes) = sample.expected(at);
            let residual = sample.value - gain * light;
            let sigmas = residual.abs() / noise.sqrt();
            let weight = if sigmas > HUBER_SIGMAS { HUBER_SIGMAS / sigmas } else { 1.0 };
            let slopes = SVector::from(slopes) * gain;
            own += weight * light * light;
            own_right += weight * light * residual;
            joint += weight * light * slopes;
            squares += weight * residual * residual;
            rows.push((weight, residual, light, slopes));
        }
        let mut right = SVector::<f64, TONE_UNKNOWNS>::zeros();
        for ((weight, residual, light, slopes), sample) in rows.into_iter().zip(samples) {
            // Projects out the frame's own gain.
            let slopes = slopes - joint * (light / own);
            let score = weight * (residual - own_right / own * light) * slopes;
            self.normal += weight * slopes * slopes.transpose();
            right += score;
            let cluster = sample.place_mm.map(|mm| (mm / CLUSTER_MM).floor() as i64);
            self.by_cluster[(cluster[0] * 5 + cluster[1]).rem_euclid(CLUSTERS as i64) as usize] +=
                score;
        }
        self.right += right;
        self.by_frame.push(right);
        Some(squares)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use evrig_core::geometry::Size;
    use evrig_core::stats::SplitMix;

    /// Frames of a linear camera with vignetting `loss`, over a map with `gamma`.
    fn frames(gamma: f64, pedestal: f64, loss: f64) -> Vec<Vec<ToneSample>> {
        let mut random = SplitMix::new(2, 6);
        let size = Size::new(346, 260);
        (0..20)
            .map(|k| {
                (0..800)
                    .map(|_| {
                        let pixel = [random.below(346), random.below(260)];
                        let light = 0.08 + 0.92 * random.uniform();
                        let place = [0, 1].map(|i| pixel[i] as f64 * 0.5 + f64::from(k));
                        let mapped = pedestal + light.powf(gamma);
                        let mut sample = ToneSample::new(size, pixel, 0.0, mapped, place);
                        let passed = 1.0 - loss * sample.squared_radius;
                        sample.value = 180.0 * passed * light + 1.5 * random.normal();
                        sample
                    })
                    .collect()
            })
            .collect()
    }

    #[test]
    fn a_curve_is_distinguished_from_a_pedestal_and_from_dark_corners() {
        for (gamma, pedestal, loss) in
            [(1.0, 0.0, 0.0), (1.0, 0.04, 0.3), (0.85, 0.0, 0.0), (1.3, 0.0, 0.15)]
        {
            let found = fit_tone(&frames(gamma, pedestal, loss)).unwrap();
            let is = |[value, error]: [f64; 2], truth: f64| (value - truth).abs() < 3.0 * error;
            assert!(is(found.gamma, gamma) && is(found.corner_loss, loss), "{found:?}");
            assert!(found.gamma[1] < 0.03 && found.corner_loss[1] < 0.02, "{found:?}");
        }
    }

    #[test]
    fn few_samples_tell_nothing() {
        let few: Vec<_> = frames(1.0, 0.0, 0.0).into_iter().take(2).collect();
        assert_eq!(fit_tone(&few), None);
    }
}
