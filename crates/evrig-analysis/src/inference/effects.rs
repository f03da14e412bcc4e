//! Effects that the calibrated camera does not have.

use super::view::ModelledPixel;
use crate::diagnose::ConfidenceInterval;
use crate::diagnose::Evidence;
use crate::diagnose::evidence::spectral_lines::lines;
use evrig_core::effect_id::EffectId;
use std::f64::consts::TAU;

/// A parameter in fitted coordinates.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ModelParameter {
    pub(crate) key: &'static str,
    pub(crate) is_log: bool,
    pub(crate) range: [f64; 2],
    /// Finite-difference step.
    pub(crate) step: f64,
    pub(crate) is_fixed: bool,
}

const fn log(key: &'static str, range: [f64; 2]) -> ModelParameter {
    ModelParameter { key, is_log: true, range, step: 3e-3, is_fixed: false }
}
const fn linear(key: &'static str, range: [f64; 2], step: f64) -> ModelParameter {
    ModelParameter { key, is_log: false, range, step, is_fixed: false }
}
const fn fixed(key: &'static str) -> ModelParameter {
    ModelParameter { key, is_log: false, range: [-1e9, 1e9], step: 0.0, is_fixed: true }
}

impl ModelParameter {
    pub(crate) fn natural(&self, v: f64) -> f64 {
        if self.is_log { v.exp() } else { v }
    }
    pub(crate) fn fitted_range(&self) -> [f64; 2] {
        if self.is_log { self.range.map(f64::ln) } else { self.range }
    }
}

/// An effect.
#[derive(Debug)]
pub(crate) struct ModelEffect {
    pub(crate) id: EffectId,
    pub(crate) parameters: &'static [ModelParameter],
    pub(crate) changes_signal: bool,
    /// Magnitude of the first parameter that an ordinary recording has.
    pub(crate) ordinary: fn(&Evidence) -> f64,
    /// Starting values, natural units.
    pub(crate) starts: fn(&Evidence) -> Vec<Vec<f64>>,
    /// Stage order.
    pub(crate) stage: u8,
    pub(crate) apply: fn(&[f64], &mut ModelledPixel<'_>),
    /// Reported parameters from the fitted ones.
    pub(crate) report: fn(&Evidence, Vec<KeyedInterval>) -> Vec<KeyedInterval>,
}

/// Skew that moves the ends of a recording by no more than the bound on the stated clock.
fn ordinary_skew_ppm(evidence: &Evidence) -> f64 {
    let facts = &evidence.facts;
    let bound_us = facts.clock_tie.map_or(facts.offset_bound_us, |tied| tied.statement_bound_us);
    bound_us / (0.5 * evidence.seconds())
}

/// A parameter's key and value.
pub(crate) type KeyedInterval = (&'static str, ConfidenceInterval);

/// Amplitude of a sine and a cosine part.
fn amplitude(sine: ConfidenceInterval, cosine: ConfidenceInterval) -> ConfidenceInterval {
    let value = sine.value.hypot(cosine.value);
    let half = |p: &ConfidenceInterval| p.ci90[1].map_or(f64::NAN, |high| high - p.value);
    let share = |p: &ConfidenceInterval| half(p) * p.value / value;
    let error = share(&sine).hypot(share(&cosine));
    let end = |end: f64| Some(end).filter(|v| v.is_finite());
    ConfidenceInterval { value, ci90: [end((value - error).max(0.0)), end(value + error)] }
}

pub(crate) static EFFECTS: &[ModelEffect] = &[
    ModelEffect {
        id: EffectId::PhotoreceptorBandwidth,
        parameters: &[
            log("cutoff_hz_at_white", [0.5, 3_000.0]),
            fixed("order"),
            log("floor", [1e-3, 0.3]),
        ],
        changes_signal: true,
        ordinary: |_| 0.0,
        starts: |_| {
            [[20.0, 1.0, 0.01], [80.0, 1.0, 0.01], [400.0, 1.0, 0.01], [80.0, 2.0, 0.01]]
                .iter()
                .map(|s| s.to_vec())
                .collect()
        },
        stage: 1,
        apply: |v, view| {
            let (white, order, floor) = (v[0], v[1], v[2]);
            let step = view.step_us * 1e-6;
            for _ in 0..(order.round() as usize).clamp(1, 2) {
                filter(view, |level| {
                    SignalPole::new(white * (f64::from(level).exp() + floor) / (1.0 + floor), step)
                });
            }
        },
        report: |_, all| all[..2].to_vec(),
    },
    ModelEffect {
        id: EffectId::FixedPole,
        parameters: &[log("cutoff_hz", [0.5, 3_000.0])],
        changes_signal: true,
        ordinary: |_| 0.0,
        starts: |_| [10.0, 60.0, 400.0].iter().map(|s| vec![*s]).collect(),
        stage: 1,
        apply: |v, view| {
            let pole = SignalPole::new(v[0], view.step_us * 1e-6);
            filter(view, |_| pole);
        },
        report: |_, all| all,
    },
    ModelEffect {
        id: EffectId::RefractoryPeriod,
        parameters: &[
            log("refractory_us", [50.0, 200_000.0]),
            log("onset_us", [20.0, 50_000.0]),
            fixed("retake"),
        ],
        changes_signal: false,
        ordinary: |_| 0.0,
        starts: |evidence| {
            // The next crossing takes time after the period, so that the shortest intervals bound it.
            let mut all = intervals(evidence);
            all.sort_by(f64::total_cmp);
            let quantile =
                |share: f64| all.get((share * all.len() as f64) as usize).copied().unwrap_or(1e3);
            let below = [0.2, 0.35, 0.5, 0.7, 0.85].map(|share| share * quantile(0.002));
            let beyond = [0.002, 0.01, 0.03, 0.1].map(quantile);
            let start = |us: &f64| {
                let us = us.clamp(100.0, 100_000.0);
                vec![us, 0.15 * us, 1.0]
            };
            below.iter().chain(&beyond).map(start).collect()
        },
        stage: 3,
        apply: |v, view| {
            view.law.refractory_s = v[0] * 1e-6;
            // The end is resolved to a hundredth; a wider one than a third is no period.
            let [least, most] = [0.01, 0.3].map(|share| share * view.law.refractory_s);
            view.law.onset_s = (v[1] * 1e-6).clamp(least, most);
            view.law.retake = v[2];
        },
        report: |_, all| {
            let pixel = ConfidenceInterval { value: 0.0, ci90: [Some(0.0); 2] };
            vec![all[0], ("compares_on", pixel), all[1]]
        },
    },
    ModelEffect {
        id: EffectId::ShotNoise,
        parameters: &[log("rms_thresholds", [0.02, 1.5]), log("bandwidth_hz", [1.0, 5_000.0])],
        changes_signal: false,
        ordinary: |_| 0.0,
        starts: |_| {
            [[0.08, 100.0], [0.08, 500.0], [0.15, 300.0], [0.25, 300.0]]
                .iter()
                .map(|s| s.to_vec())
                .collect()
        },
        stage: 3,
        apply: |v, view| {
            view.law.shot_rms = v[0] * 0.5 * (view.law.theta[0] + view.law.theta[1]);
            view.law.shot_hz = v[1];
        },
        report: |_, all| all,
    },
    ModelEffect {
        id: EffectId::Adaptation,
        parameters: &[log("time_constant_s", [0.05, 20.0]), linear("fraction", [0.0, 0.98], 2e-3)],
        changes_signal: true,
        ordinary: |_| 0.0,
        starts: |_| [[0.3, 0.05], [1.5, 0.05], [0.1, 0.05]].iter().map(|s| s.to_vec()).collect(),
        stage: 1,
        apply: |v, view| {
            let keep = (-view.step_us * 1e-6 / v[0]).exp();
            let mut slow: Option<f64> = None;
            for signal in &mut view.signal {
                let x = *signal;
                if !x.is_finite() {
                    slow = None;
                    continue;
                }
                let z = slow.map_or(x, |z| x + (z - x) * keep);
                slow = Some(z);
                *signal = x - v[1] * z;
            }
        },
        report: |_, all| all,
    },
    ModelEffect {
        id: EffectId::TemperatureDrift,
        parameters: &[linear("rate_hz_per_s", [-5.0, 20.0], 5e-3)],
        changes_signal: true,
        ordinary: |_| 0.0,
        starts: |_| vec![vec![0.1], vec![-0.1]],
        stage: 2,
        apply: |v, view| {
            let half = 0.5 * v[0] * view.law.theta[0];
            let step = view.step_us * 1e-6;
            for (i, signal) in view.signal.iter_mut().enumerate() {
                let t = i as f64 * step;
                *signal += half * t * t;
            }
        },
        report: |_, all| all,
    },
    ModelEffect {
        id: EffectId::EventDrop,
        parameters: &[log("fraction", [1e-3, 0.9])],
        changes_signal: false,
        ordinary: |_| 0.0,
        starts: |_| vec![vec![0.02], vec![0.15]],
        stage: 3,
        apply: |v, view| view.law.loss = v[0].min(0.95),
        report: |_, all| all,
    },
    ModelEffect {
        id: EffectId::ClockSkew,
        parameters: &[linear("skew_ppm", [-50_000.0, 50_000.0], 2.0)],
        changes_signal: false,
        ordinary: ordinary_skew_ppm,
        starts: |evidence| {
            // Without a measured clock, 24 frames per second may be stamped as 25: 42 000 ppm.
            const UNMEASURED_PPM: [f64; 4] = [5_000.0, 10_000.0, 20_000.0, 42_000.0];
            let tied = evidence.facts.clock_tie.map(|tied| tied.skew_ppm[0]);
            let far = if tied.is_some() { &UNMEASURED_PPM[..0] } else { &UNMEASURED_PPM[..] };
            let both = [100.0, 1_500.0].iter().chain(far).flat_map(|ppm| [*ppm, -ppm]);
            tied.into_iter().chain(both).map(|ppm| vec![ppm]).collect()
        },
        stage: 4,
        apply: |v, view| {
            // The clock was set at the start.
            let fast = 1.0 + v[0] * 1e-6;
            view.start_us *= fast;
            view.step_us *= fast;
        },
        report: |_, all| all,
    },
    ModelEffect {
        id: EffectId::RollingShutter,
        parameters: &[linear("row_us", [-200.0, 200.0], 0.1)],
        changes_signal: false,
        ordinary: |_| 0.0,
        starts: |_| vec![vec![1.0], vec![-1.0]],
        stage: 4,
        apply: |v, view| view.start_us += v[0] * (f64::from(view.y) + 0.5 - view.middle[1]),
        report: |_, all| all,
    },
    ModelEffect {
        id: EffectId::ExposureBlur,
        parameters: &[log("exposure_us", [1_000.0, 60_000.0])],
        changes_signal: true,
        ordinary: |_| 0.0,
        starts: |e| if e.facts.from_scene { vec![vec![8_000.0]] } else { vec![] },
        stage: 0,
        apply: |v, view| {
            // A mean over T adds T^2 / 24 of the curvature.
            let h = 4_000.0 / view.step_us;
            let half = (h.round() as usize).max(1);
            let factor = (v[0] / (half as f64 * view.step_us)).powi(2) / 24.0;
            let old = view.signal.clone();
            for i in half..old.len().saturating_sub(half) {
                let curvature = old[i - half] - 2.0 * old[i] + old[i + half];
                view.signal[i] -= (factor * curvature).clamp(-0.5, 0.5);
            }
        },
        report: |_, all| all,
    },
    ModelEffect {
        id: EffectId::Flicker,
        parameters: &[
            linear("frequency_hz", [1.0, 500.0], 2e-3),
            linear("sine", [-0.9, 0.9], 1e-3),
            linear("cosine", [-0.9, 0.9], 1e-3),
        ],
        changes_signal: true,
        ordinary: |_| 0.0,
        starts: |e| {
            lines(e, 3)
                .into_iter()
                .flat_map(|hz| {
                    (0..4).map(move |k| {
                        let p = f64::from(k) * TAU / 4.0;
                        vec![hz, 0.01 * p.cos(), 0.01 * p.sin()]
                    })
                })
                .collect()
        },
        stage: 0,
        apply: |v, view| {
            let turn = TAU * v[0] * view.step_us * 1e-6;
            let n = view.signal.len();
            for (i, signal) in view.signal.iter_mut().enumerate() {
                let phase = turn * (i as f64 - 0.5 * n as f64);
                *signal += (1.0 + (v[1] * phase.sin() + v[2] * phase.cos()).max(-0.999)).ln();
            }
        },
        report: |_, all| vec![all[0], ("depth", amplitude(all[1].1, all[2].1))],
    },
    ModelEffect {
        id: EffectId::Vibration,
        parameters: &[
            linear("frequency_hz", [1.0, 500.0], 2e-3),
            linear("sine_x_px", [-2.0, 2.0], 2e-3),
            linear("cosine_x_px", [-2.0, 2.0], 2e-3),
            linear("sine_y_px", [-2.0, 2.0], 2e-3),
            linear("cosine_y_px", [-2.0, 2.0], 2e-3),
        ],
        changes_signal: true,
        ordinary: |_| 0.0,
        starts: |e| {
            if !e.facts.from_scene {
                return vec![];
            }
            lines(e, 1)
                .into_iter()
                .flat_map(|hz| {
                    (0..4).map(move |k| {
                        let p = f64::from(k) * TAU / 4.0;
                        vec![hz, 0.1 * p.cos(), 0.1 * p.sin(), 0.1 * p.cos(), 0.1 * p.sin()]
                    })
                })
                .collect()
        },
        stage: 0,
        apply: |v, view| {
            let turn = TAU * v[0] * view.step_us * 1e-6;
            let n = view.signal.len();
            let pixel = view.pixel;
            if pixel.gradient[0].is_empty() {
                return;
            }
            for (i, signal) in view.signal.iter_mut().enumerate() {
                let phase = turn * (i as f64 - 0.5 * n as f64);
                let (s, c) = phase.sin_cos();
                *signal += (v[1] * s + v[2] * c) * f64::from(pixel.gradient[0][i])
                    + (v[3] * s + v[4] * c) * f64::from(pixel.gradient[1][i]);
            }
        },
        report: |evidence, all| {
            let px = amplitude(amplitude(all[1].1, all[2].1), amplitude(all[3].1, all[4].1));
            let mm = evidence.facts.pixel_mm.map(|mm| {
                let scaled = px.ci90.map(|end| end.map(|end| end * mm));
                ("amplitude_mm", ConfidenceInterval { value: px.value * mm, ci90: scaled })
            });
            std::iter::once(all[0]).chain(mm).collect()
        },
    },
];

/// Intervals between the events of each pixel, microseconds.
fn intervals(evidence: &Evidence) -> Vec<f64> {
    evidence
        .pixels
        .iter()
        .flat_map(|p| p.spikes.windows(2).map(|w| (w[1].t_us - w[0].t_us) as f64))
        .collect()
}

/// A first-order low pass, exact for a piecewise linear signal.
#[derive(Clone, Copy)]
pub(crate) struct SignalPole {
    tau: f64,
    kept: f64,
}

impl SignalPole {
    pub(crate) fn new(cutoff_hz: f64, step_s: f64) -> Self {
        let per_step = TAU * cutoff_hz.max(1e-3) * step_s;
        Self { tau: per_step.recip(), kept: (-per_step).exp() }
    }
}

pub(crate) fn filter(view: &mut ModelledPixel<'_>, pole: impl Fn(f32) -> SignalPole) {
    let level = &view.pixel.light;
    let mut state: Option<(f64, f64)> = None;
    for (signal, level) in view.signal.iter_mut().zip(level) {
        let x = *signal;
        if !x.is_finite() {
            state = None;
            continue;
        }
        let y = match state {
            None => x,
            Some((y, before)) => {
                let SignalPole { tau, kept } = pole(*level);
                let lag = (x - before) * tau;
                x - lag + (y - before + lag) * kept
            }
        };
        state = Some((y, x));
        *signal = y;
    }
}
