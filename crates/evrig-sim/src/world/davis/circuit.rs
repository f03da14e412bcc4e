//! A pixel's analogue chain: photocurrent, logarithm, poles, slow part, noise.

use crate::world::draws::WorldRandom;
use crate::world::effects::WorldEffects;
use std::f64::consts::TAU;

/// The follower's pole lies at this multiple of the noise's bandwidth.
const FOLLOWER: f64 = 3.0;

/// Constants of the chain; what is off does nothing.
#[derive(Debug, Clone, Default)]
pub(super) struct Circuit {
    /// Corner at white in Hz and number of poles.
    photoreceptor: Option<(f64, u32)>,
    /// Time constant in seconds.
    fixed_pole: Option<f64>,
    /// Time constant in seconds and share.
    adaptation: Option<(f64, f64)>,
    /// Highest rate of change a second.
    slew: Option<f64>,
    noise: Option<CircuitNoise>,
    /// Share of the current at white.
    pub(super) dark: f64,
}

#[derive(Debug, Clone, Copy)]
struct CircuitNoise {
    /// Standard deviation of the log signal at white, over that of the second state.
    rms_of_state: f64,
    bandwidth_hz: f64,
    exponent: f64,
}

/// What a pixel's chain remembers.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct CircuitState {
    receptor: [f64; 2],
    followed: f64,
    slewed: f64,
    slow: f64,
    noise: [f64; 2],
    /// The output at the last look.
    pub(super) output: f64,
}

impl Circuit {
    pub(super) fn new(effects: &WorldEffects, threshold: f64) -> Self {
        let noise = effects.shot_noise.filter(|noise| noise.rms_thresholds > 0.0);
        Self {
            photoreceptor: effects
                .photoreceptor_bandwidth
                .map(|pole| (pole.cutoff_hz_at_white, pole.order)),
            fixed_pole: effects.fixed_pole.map(|pole| 1.0 / (TAU * pole.cutoff_hz)),
            adaptation: effects.adaptation.map(|slow| (slow.time_constant_s, slow.fraction)),
            slew: effects.slew_limit.map(|slew| slew.per_s),
            noise: noise.map(|noise| CircuitNoise {
                rms_of_state: noise.rms_thresholds
                    * threshold
                    * ((1.0 + FOLLOWER) / FOLLOWER).sqrt(),
                bandwidth_hz: noise.bandwidth_hz,
                exponent: noise.brightness_exponent,
            }),
            dark: effects.dark_current.map_or(0.0, |dark| dark.fraction_of_white),
        }
    }

    /// Whether the output is the logarithm of the current, now and always.
    pub(super) fn is_bare(&self) -> bool {
        self.photoreceptor.is_none()
            && self.fixed_pole.is_none()
            && self.adaptation.is_none()
            && self.slew.is_none()
            && self.noise.is_none()
    }

    /// How often a second the noise must be looked at: twice per time constant of the follower.
    pub(super) fn noise_rate_hz(&self) -> f64 {
        self.noise.map_or(0.0, |noise| 2.0 * TAU * FOLLOWER * noise.bandwidth_hz)
    }

    /// How often a second the poles must be looked at while they settle.
    pub(super) fn settling_rate_hz(&self, current: f64) -> f64 {
        let receptor = self.photoreceptor.map_or(0.0, |(cutoff, _)| TAU * cutoff * current);
        let follower = self.fixed_pole.map_or(0.0, |tau| 1.0 / tau);
        (2.0 * receptor.max(follower)).min(20_000.0)
    }

    /// At rest under a current.
    pub(super) fn at_rest(&self, current: f64, draws: &mut WorldRandom) -> CircuitState {
        let x = current.ln();
        let share = self.adaptation.map_or(0.0, |(_, share)| share);
        let mut memory = CircuitState {
            receptor: [x; 2],
            followed: x,
            slewed: x,
            slow: x,
            noise: [0.0; 2],
            output: x - share * x,
        };
        if let Some(noise) = self.noise {
            memory.noise = noise.stationary(draws);
            memory.output += noise.output(&memory, x);
        }
        memory
    }

    /// Whether nothing moves any more under a constant log current `x`.
    pub(super) fn is_settled(&self, memory: &CircuitState, x: f64) -> bool {
        let share = self.adaptation.map_or(0.0, |(_, share)| share);
        self.noise.is_none()
            && (memory.output - (x - share * x)).abs() < 1e-7
            && (memory.followed - x).abs() < 1e-7
    }

    /// What steps of `dt` seconds have in common.
    pub(super) fn pace(&self, dt: f64) -> StepConstants {
        let pole = |tau: f64| LowPassPole { kept: (-dt / tau).exp(), lag: tau / dt.max(1e-12) };
        let noise = self.noise.map(|noise| {
            let tau = 1.0 / (TAU * noise.bandwidth_hz);
            let kept = (-dt / tau).exp();
            NoiseStepConstants {
                kept,
                fresh: (1.0 - kept * kept).sqrt(),
                follower: pole(tau / FOLLOWER),
            }
        });
        let adaptation = self.adaptation.map(|(tau, share)| (pole(tau), share));
        StepConstants { dt, fixed: self.fixed_pole.map(pole), adaptation, noise }
    }

    /// Goes on by a step while the log current goes straight from `x[0]` to `x[1]`, its middle
    /// being `current`; the new output.
    pub(super) fn advance(
        &self,
        memory: &mut CircuitState,
        x: [f64; 2],
        current: f64,
        pace: &StepConstants,
        draws: &mut WorldRandom,
    ) -> f64 {
        let mut signal = x;
        if let Some((cutoff, order)) = self.photoreceptor {
            // The corner follows the current, so that rises are faster than falls.
            let decay = TAU * cutoff * current.max(1e-9) * pace.dt;
            let pole = LowPassPole { kept: decayed(decay), lag: 1.0 / decay.max(1e-12) };
            for state in memory.receptor.iter_mut().take(order as usize) {
                signal = pole.pass(state, signal);
            }
        }
        if let Some(per_s) = self.slew {
            let before = memory.slewed;
            let reach = per_s * pace.dt;
            memory.slewed += (signal[1] - before).clamp(-reach, reach);
            signal = [before, memory.slewed];
        }
        if let Some(pole) = &pace.fixed {
            signal = pole.pass(&mut memory.followed, signal);
        } else {
            memory.followed = signal[1];
        }
        let mut output = signal[1];
        if let Some((pole, share)) = &pace.adaptation {
            pole.pass(&mut memory.slow, signal);
            output -= share * memory.slow;
        }
        if let (Some(noise), Some(pace)) = (&self.noise, &pace.noise) {
            pace.advance(memory, draws);
            output += noise.output(memory, x[1]);
        }
        memory.output = output;
        output
    }
}

/// Constants of steps of one length.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct StepConstants {
    /// Seconds.
    pub(super) dt: f64,
    fixed: Option<LowPassPole>,
    adaptation: Option<(LowPassPole, f64)>,
    noise: Option<NoiseStepConstants>,
}

#[derive(Debug, Clone, Copy)]
struct NoiseStepConstants {
    kept: f64,
    fresh: f64,
    follower: LowPassPole,
}

/// A first-order low pass over a step.
#[derive(Debug, Clone, Copy)]
struct LowPassPole {
    /// What is left of a difference.
    kept: f64,
    /// Time constant in steps.
    lag: f64,
}

impl LowPassPole {
    /// The exact answer to an input that goes straight from one value to another.
    #[inline]
    fn pass(&self, state: &mut f64, input: [f64; 2]) -> [f64; 2] {
        let before = *state;
        let lag = (input[1] - input[0]) * self.lag;
        *state = input[1] - lag + (before - input[0] + lag) * self.kept;
        [before, *state]
    }
}

/// `exp(-x)`; short steps, which are most, by its Padé approximant, within 2e-8.
#[inline]
fn decayed(x: f64) -> f64 {
    if x < 0.1 {
        let even = 1.0 + x * x / 12.0;
        return (even - 0.5 * x) / (even + 0.5 * x);
    }
    (-x).exp()
}

impl NoiseStepConstants {
    #[inline]
    fn advance(&self, memory: &mut CircuitState, draws: &mut WorldRandom) {
        let [first, second] = &mut memory.noise;
        let before = *first;
        *first = before * self.kept + f64::from(draws.normal()) * self.fresh;
        self.follower.pass(second, [before, *first]);
    }
}

impl CircuitNoise {
    /// A draw from the stationary distribution of both poles.
    fn stationary(&self, draws: &mut WorldRandom) -> [f64; 2] {
        let [a, b] = [draws.normal(), draws.normal()].map(f64::from);
        // Variances and correlation of the two states, the first of variance one.
        let variance = FOLLOWER / (1.0 + FOLLOWER);
        let followed = variance * a + (variance - variance * variance).sqrt() * b;
        [a, followed]
    }

    /// The noise on the log signal, scaled to its standard deviation under the log current `x`.
    #[inline]
    fn output(&self, memory: &CircuitState, x: f64) -> f64 {
        let scale = if self.exponent == 0.0 { 1.0 } else { (-self.exponent * x).exp() };
        self.rms_of_state * scale * memory.noise[1]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::draws::RandomPurpose;
    use crate::world::effects::{PhotoreceptorBandwidth, ShotNoise};

    #[test]
    fn a_pole_answers_a_ramp_as_in_the_textbook() {
        let mut state = 0.0;
        let pole = |tau: f64, dt: f64| LowPassPole { kept: (-dt / tau).exp(), lag: tau / dt };
        for _ in 0..7 {
            let last = state;
            pole(0.01, 0.001).pass(&mut state, [1.0, 1.0]);
            assert!(state > last);
        }
        assert!((state - (1.0 - (-0.7_f64).exp())).abs() < 1e-12);
        let mut ramp = 0.0;
        pole(0.1, 5.0).pass(&mut ramp, [0.0, 5.0]);
        assert!((ramp - 4.9).abs() < 1e-9, "a ramp of one a second is late by tau: {ramp}");
    }

    #[test]
    fn a_short_step_decays_as_an_exponential() {
        for x in [0.0, 1e-6, 0.03, 0.0999, 0.1, 0.7, 30.0] {
            assert!((decayed(x) - (-x).exp()).abs() < 2e-8, "{x}");
        }
    }

    #[test]
    fn a_dark_pixel_is_slower_than_a_bright_one_in_proportion() {
        let effects = WorldEffects {
            photoreceptor_bandwidth: Some(PhotoreceptorBandwidth {
                cutoff_hz_at_white: 100.0,
                order: 1,
            }),
            ..WorldEffects::default()
        };
        let circuit = Circuit::new(&effects, 0.19);
        let mut draws = WorldRandom::new(0, RandomPurpose::ShotNoise, 0, 0);
        let mut time_to_settle = |current: f64| {
            let mut memory = circuit.at_rest(current, &mut draws);
            let goal = current.ln() + 0.01;
            let (mut time, pace) = (0.0, circuit.pace(1e-5));
            let mut go = || circuit.advance(&mut memory, [goal; 2], current, &pace, &mut draws);
            while go() < goal - 0.01 * 0.3679 {
                time += 1e-5;
            }
            time
        };
        let (bright, dark) = (time_to_settle(1.0), time_to_settle(0.1));
        assert!((bright - 1.0 / (TAU * 100.0)).abs() < 5e-5, "{bright}");
        assert!((dark / bright - 10.0).abs() < 0.3, "{dark} over {bright}");
    }

    #[test]
    fn noise_has_its_standard_deviation_whatever_the_step() {
        let noise =
            ShotNoise { rms_thresholds: 0.5, bandwidth_hz: 100.0, brightness_exponent: 0.0 };
        let effects = WorldEffects { shot_noise: Some(noise), ..WorldEffects::default() };
        let circuit = Circuit::new(&effects, 0.2);
        for (dt, n) in [(1e-4, 200_000), (2.5e-4, 80_000)] {
            let mut draws = WorldRandom::new(5, RandomPurpose::ShotNoise, 1, 2);
            let mut memory = circuit.at_rest(1.0, &mut draws);
            let pace = circuit.pace(dt);
            let mut go = |_| circuit.advance(&mut memory, [0.0; 2], 1.0, &pace, &mut draws);
            let values: Vec<f64> = (0..n).map(&mut go).collect();
            let variance = values.iter().map(|v| v * v).sum::<f64>() / f64::from(n);
            assert!((variance.sqrt() - 0.1).abs() < 0.004, "{dt}: {}", variance.sqrt());
        }
    }
}
