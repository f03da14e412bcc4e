//! The signal of one pixel with its leak, over an interval in which the light is known.

use super::pixel_law::{LONGEST_PATH, PixelLaw};
use super::pixel_signal::PixelSignal;
use super::signal_knots::SignalKnots;

/// Knots up to which the next threshold crossing is searched for.
const MAX_KNOTS_AHEAD: usize = 2_000;

/// A pixel's signal plus leak. Positions count samples; values are log intensity including the leak
/// accumulated since the first sample.
#[derive(Debug, Clone, Copy)]
pub(super) struct LeakySignal<'a> {
    pub(super) law: &'a PixelLaw,
    signal: PixelSignal<'a>,
    run: [usize; 2],
    leak_per_step: f64,
}

/// Lowest and highest value of a signal.
#[derive(Debug, Clone, Copy)]
pub(super) struct SignalRange {
    pub(super) high: f64,
    pub(super) low: f64,
}

impl SignalRange {
    pub(super) fn at(value: f64) -> Self {
        Self { high: value, low: value }
    }

    pub(super) fn add(&mut self, value: f64) {
        (self.high, self.low) = (self.high.max(value), self.low.min(value));
    }
}

/// The signal that follows a reset of the reference level.
struct Lookahead {
    /// Total variation of the light up to the next crossing, in thresholds.
    path: f64,
    /// Position at which the signal will have changed by a threshold.
    crossing: Option<f64>,
}

impl<'a> LeakySignal<'a> {
    pub(super) fn new(law: &'a PixelLaw, signal: PixelSignal<'a>, run: [usize; 2]) -> Self {
        Self { law, signal, run, leak_per_step: law.leak_per_s * signal.step_us * 1e-6 }
    }

    pub(super) fn step_s(&self) -> f64 {
        self.signal.step_us * 1e-6
    }

    pub(super) fn position(&self, t_us: f64) -> f64 {
        (t_us - self.signal.start_us) / self.signal.step_us
    }

    pub(super) fn time_us(&self, position: f64) -> f64 {
        self.signal.start_us + position * self.signal.step_us
    }

    /// Log intensity relative to white.
    pub(super) fn level(&self, position: f64) -> f64 {
        let i = (position.max(0.0) as usize).clamp(self.run[0], self.run[1]);
        f64::from(self.signal.level[i])
    }

    /// Rate of change including the leak, log intensity per second.
    pub(super) fn slope(&self, position: f64) -> f64 {
        self.signal.slope(position, self.run) + self.law.leak_per_s
    }

    pub(super) fn value(&self, position: f64) -> f64 {
        self.signal.at(position, self.run) + self.leak_per_step * position
    }

    /// Scale of the threshold's scatter after a reset of which only the time stamp is known.
    pub(super) fn noise(&self, position: f64) -> f64 {
        self.noise_after_reset(position, self.stamp_scatter(position))
    }

    /// Scale of the threshold's scatter after a reset whose reference level scatters by
    /// `reference_scatter`.
    pub(super) fn noise_after_reset(&self, position: f64, reference_scatter: f64) -> f64 {
        let noise = self.law.noise(self.level(position));
        let [is_path_dependent, has_jitter] =
            [self.law.is_noise_path_dependent(), self.law.jitter_s > 0.0];
        if !is_path_dependent && !has_jitter {
            return noise;
        }
        let ahead = self.look_ahead(position, has_jitter);
        let noise =
            if is_path_dependent { noise * self.law.noise_share(ahead.path) } else { noise };
        if !has_jitter {
            return noise;
        }
        // The stamp of the next event scatters as well.
        let next = ahead.crossing.map_or(0.0, |position| self.stamp_scatter(position));
        noise.hypot(reference_scatter).hypot(next)
    }

    /// Follows the signal to its next threshold crossing; with `to_crossing` false only until the
    /// path is so long that more of it has no effect.
    fn look_ahead(&self, position: f64, to_crossing: bool) -> Lookahead {
        let law = self.law;
        let [signal, level] = [self.signal.signal, self.signal.level];
        let begin = self.value(position);
        let [high, low] = [begin + law.theta_on, begin - law.theta_off];
        let theta = law.theta_on.min(law.theta_off) as f32;
        let (first, longest) = (position.max(0.0) as usize, LONGEST_PATH as f32 * theta);
        let (mut path, mut before) = (0.0, level[first.clamp(self.run[0], self.run[1])]);
        let (mut last, mut crossing) = ((position, begin), None);
        let mut advance = |i: usize| {
            path += (level[i] - before).abs();
            before = level[i];
            let at = i as f64;
            let value = f64::from(signal[i]) + self.leak_per_step * at;
            if !(low..high).contains(&value) {
                let limit = if value >= high { high } else { low };
                crossing = Some(last.0 + (limit - last.1) / (value - last.1) * (at - last.0));
                return false;
            }
            last = (at, value);
            to_crossing || path < longest
        };
        match self.signal.knots.map(SignalKnots::positions) {
            None => (first + 1..=self.run[1]).take(MAX_KNOTS_AHEAD).all(advance),
            Some(knots) => {
                let at = |sample: usize| knots.partition_point(|&knot| knot as usize <= sample);
                let ahead = &knots[at(first)..at(self.run[1])];
                ahead.iter().take(MAX_KNOTS_AHEAD).all(|&knot| advance(knot as usize))
            }
        };
        Lookahead { path: f64::from(path / theta), crossing }
    }

    /// Scatter of the signal between stamp and event, as the scale of a logistic distribution.
    pub(super) fn stamp_scatter(&self, position: f64) -> f64 {
        if self.law.jitter_s > 0.0 {
            self.law.stamp_scatter(self.mean_steepness(position))
        } else {
            0.0
        }
    }

    /// Mean absolute slope within one standard deviation of the stamps to both sides, log intensity
    /// per second.
    fn mean_steepness(&self, position: f64) -> f64 {
        let [first, last] = self.run.map(|end| end as f64);
        let half_width = self.law.jitter_s / self.step_s();
        let [from, to] = [(position - half_width).max(first), (position + half_width).min(last)];
        if to - from < 1.0 {
            return self.slope(position).abs();
        }
        let at = self.value(position);
        let variation = (at - self.value(from)).abs() + (self.value(to) - at).abs();
        variation / ((to - from) * self.step_s())
    }

    /// Samples after `from` up to `to` at which the slope may change: position and value.
    pub(super) fn samples(
        &self,
        from: f64,
        to: f64,
    ) -> impl Iterator<Item = (f64, f64)> + Clone + '_ {
        let first = from.floor() as usize + 1;
        let end = (to.floor().max(0.0) as usize).min(self.run[1]) + 1;
        let knots = self.signal.knots.map(SignalKnots::positions);
        let numbers = match knots {
            None => first..end,
            Some(knots) => {
                let at = |sample: usize| knots.partition_point(|&knot| (knot as usize) < sample);
                at(first)..at(end)
            }
        };
        numbers.map(move |number| {
            let sample = knots.map_or(number, |knots| knots[number] as usize);
            let position = sample as f64;
            (position, f64::from(self.signal.signal[sample]) + self.leak_per_step * position)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A triangle that rises by 0.4 over 40 steps of a millisecond and falls again.
    fn triangle() -> Vec<f32> {
        (0..=80_i16).map(|i| 0.01 * (40.0 - f32::from((i - 40).abs()))).collect()
    }

    #[test]
    fn under_constant_light_a_leak_meets_only_the_noise_of_the_pixel() {
        let (rising, resting) = (triangle(), vec![0.0; 81]);
        let law = PixelLaw {
            theta_on: 0.25,
            theta_off: 0.25,
            leak_per_s: 5.0,
            noise_at_white: 0.02,
            noise_exponent: 0.0,
            noise_at_rest: 0.1,
            ..PixelLaw::default()
        };
        let noise = |law: &PixelLaw, light: &[f32], at: f64| {
            let light = PixelSignal {
                start_us: 0.0,
                step_us: 1_000.0,
                signal: light,
                level: light,
                knots: None,
            };
            LeakySignal::new(law, light, [0, 80]).noise(at)
        };
        assert!((noise(&law, &resting, 3.0) - 0.002).abs() < 1e-12);
        // The light itself rises twice as fast as the leak: two thirds of a threshold.
        assert!((noise(&law, &rising, 3.0) / 0.0139 - 1.0).abs() < 0.02);
        // Signal noise is there at rest as well.
        let shot = PixelLaw { shot_at_white: 0.05, ..law };
        assert!((noise(&shot, &resting, 3.0) - 0.02).abs() < 1e-12);
    }

    #[test]
    fn stamp_scatter_depends_on_the_slope_at_both_events() {
        let signal = triangle();
        let level = vec![0.0; signal.len()];
        let light = PixelSignal {
            start_us: 0.0,
            step_us: 1_000.0,
            signal: &signal,
            level: &level,
            knots: None,
        };
        let law = PixelLaw {
            theta_on: 0.25,
            theta_off: 0.25,
            leak_per_s: 0.0,
            noise_at_white: 1e-6,
            jitter_s: 4e-3,
            ..PixelLaw::default()
        };
        let leaky = LeakySignal::new(&law, light, [0, 80]);
        let alone = law.stamp_scatter(10.0);
        // From the foot of the flank to where it has risen by the threshold, as steep.
        assert!((leaky.noise(6.0) / (alone * 2.0_f64.sqrt()) - 1.0).abs() < 1e-4);
        // Near the end nothing is crossed any more.
        assert!((leaky.noise(60.0) / alone - 1.0).abs() < 1e-4);
        let crossing = |at| leaky.look_ahead(at, true).crossing;
        assert!((crossing(30.0).unwrap() - 75.0).abs() < 1e-4);
        assert!(crossing(60.0).is_none());
    }
}
