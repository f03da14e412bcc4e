//! The signal of one pixel with its leak, over a known stretch of its light.

use super::law::LONGEST_PATH;
use super::{Bends, Light, PixelLaw};

/// A pixel's signal on its way. Positions count the light's instants, heights are the signal's log
/// intensity with all that the leak has added since the first instant.
#[derive(Debug, Clone, Copy)]
pub(super) struct Course<'a> {
    pub(super) law: &'a PixelLaw,
    light: Light<'a>,
    run: [usize; 2],
    leak_per_step: f64,
}

/// Bends up to which a threshold is looked for.
const MOST_AHEAD: usize = 2_000;

/// How far the signal has gone, both ways.
#[derive(Debug, Clone, Copy)]
pub(super) struct Reach {
    pub(super) high: f64,
    pub(super) low: f64,
}

impl Reach {
    pub(super) fn at(height: f64) -> Self {
        Self { high: height, low: height }
    }

    pub(super) fn add(&mut self, height: f64) {
        (self.high, self.low) = (self.high.max(height), self.low.min(height));
    }
}

/// What lies ahead of a pixel that has just memorised the light.
struct Ahead {
    /// How far the light goes, there and back, thresholds.
    path: f64,
    /// Where it will have come as far as a threshold.
    crossing: Option<f64>,
}

impl<'a> Course<'a> {
    pub(super) fn new(law: &'a PixelLaw, light: Light<'a>, run: [usize; 2]) -> Self {
        Self { law, light, run, leak_per_step: law.leak_per_s * light.step_us * 1e-6 }
    }

    /// From one instant to the next, seconds.
    pub(super) fn step_s(&self) -> f64 {
        self.light.step_us * 1e-6
    }

    pub(super) fn position(&self, t_us: f64) -> f64 {
        (t_us - self.light.start_us) / self.light.step_us
    }

    pub(super) fn time_us(&self, position: f64) -> f64 {
        self.light.start_us + position * self.light.step_us
    }

    /// Log intensity over white.
    pub(super) fn level(&self, position: f64) -> f64 {
        let i = (position.max(0.0) as usize).clamp(self.run[0], self.run[1]);
        f64::from(self.light.level[i])
    }

    /// Rate of change of the signal and its leak, log intensity a second.
    pub(super) fn slope(&self, position: f64) -> f64 {
        self.light.slope(position, self.run) + self.law.leak_per_s
    }

    pub(super) fn height(&self, position: f64) -> f64 {
        self.light.at(position, self.run) + self.leak_per_step * position
    }

    /// Scale of the scatter of a threshold from a position on, of whose light nothing but the stamp is known.
    pub(super) fn noise(&self, position: f64) -> f64 {
        self.noise_behind(position, self.scatter_of_stamp(position))
    }

    /// The same where what was memorised there is known but for so much scatter.
    pub(super) fn noise_behind(&self, position: f64, memory: f64) -> f64 {
        let noise = self.law.noise(self.level(position));
        let [rests, scatters] = [self.law.rests(), self.law.jitter_s > 0.0];
        if !rests && !scatters {
            return noise;
        }
        let ahead = self.ahead(position, scatters);
        let noise = if rests { noise * self.law.share_of_noise(ahead.path) } else { noise };
        if !scatters {
            return noise;
        }
        // Stamps scatter about where the light will set the pixel off as well.
        let next = ahead.crossing.map_or(0.0, |position| self.scatter_of_stamp(position));
        noise.hypot(memory).hypot(next)
    }

    /// How the light goes from a position to where it passes a threshold. A leak that passes it alone, the light at
    /// rest, is counted from one error of the light to the same. The walk ends where the path grows too long to
    /// matter, unless where it ends is asked for.
    fn ahead(&self, position: f64, to_the_end: bool) -> Ahead {
        let law = self.law;
        let [signal, level] = [self.light.signal, self.light.level];
        let begin = self.height(position);
        let [high, low] = [begin + law.theta_on, begin - law.theta_off];
        let theta = law.theta_on.min(law.theta_off) as f32;
        let (first, longest) = (position.max(0.0) as usize, LONGEST_PATH as f32 * theta);
        let (mut path, mut before) = (0.0, level[first.clamp(self.run[0], self.run[1])]);
        let (mut last, mut crossing) = ((position, begin), None);
        // Asked at every event: nothing but what it needs.
        let mut goes_on = |i: usize| {
            path += (level[i] - before).abs();
            before = level[i];
            let at = i as f64;
            let height = f64::from(signal[i]) + self.leak_per_step * at;
            if !(low..high).contains(&height) {
                let limit = if height >= high { high } else { low };
                crossing = Some(last.0 + (limit - last.1) / (height - last.1) * (at - last.0));
                return false;
            }
            last = (at, height);
            to_the_end || path < longest
        };
        match self.light.bends.map(Bends::at) {
            None => (first + 1..=self.run[1]).take(MOST_AHEAD).all(goes_on),
            Some(bends) => {
                let at = |instant: usize| bends.partition_point(|&bend| bend as usize <= instant);
                let ahead = &bends[at(first)..at(self.run[1])];
                ahead.iter().take(MOST_AHEAD).all(|&bend| goes_on(bend as usize))
            }
        };
        Ahead { path: f64::from(path / theta), crossing }
    }

    /// By how much the light at a stamp differs from that at the event, as the scale of a logistic number.
    pub(super) fn scatter_of_stamp(&self, position: f64) -> f64 {
        if self.law.jitter_s > 0.0 {
            self.law.scatter_of_stamps(self.steepness(position))
        } else {
            0.0
        }
    }

    /// How steep the signal is about a position, log intensity a second: the mean size of its changes
    /// within the time by which stamps scatter, to both sides.
    fn steepness(&self, position: f64) -> f64 {
        let [first, last] = self.run.map(|end| end as f64);
        let reach = self.law.jitter_s / self.step_s();
        let [from, to] = [(position - reach).max(first), (position + reach).min(last)];
        if to - from < 1.0 {
            return self.slope(position).abs();
        }
        let at = self.height(position);
        let gone = (at - self.height(from)).abs() + (self.height(to) - at).abs();
        gone / ((to - from) * self.step_s())
    }

    /// The instants behind one position up to another at which the signal may bend, with their
    /// heights.
    pub(super) fn instants(
        &self,
        from: f64,
        to: f64,
    ) -> impl Iterator<Item = (f64, f64)> + Clone + '_ {
        let first = from.floor() as usize + 1;
        let end = (to.floor().max(0.0) as usize).min(self.run[1]) + 1;
        let bends = self.light.bends.map(Bends::at);
        let numbers = match bends {
            None => first..end,
            Some(bends) => {
                let at = |instant: usize| bends.partition_point(|&bend| (bend as usize) < instant);
                at(first)..at(end)
            }
        };
        numbers.map(move |number| {
            let instant = bends.map_or(number, |bends| bends[number] as usize);
            let position = instant as f64;
            (position, f64::from(self.light.signal[instant]) + self.leak_per_step * position)
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
    fn where_the_light_rests_a_leak_meets_the_noise_of_the_pixel_alone() {
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
            let light =
                Light { start_us: 0.0, step_us: 1_000.0, signal: light, level: light, bends: None };
            Course::new(law, light, [0, 80]).noise(at)
        };
        assert!((noise(&law, &resting, 3.0) - 0.002).abs() < 1e-12);
        // The light itself rises twice as fast as the leak: two thirds of a threshold.
        assert!((noise(&law, &rising, 3.0) / 0.0139 - 1.0).abs() < 0.02);
        // Signal noise is there at rest as well.
        let shot = PixelLaw { shot_at_white: 0.05, ..law };
        assert!((noise(&shot, &resting, 3.0) - 0.02).abs() < 1e-12);
    }

    #[test]
    fn stamps_scatter_by_how_the_light_goes_at_either_end() {
        let signal = triangle();
        let level = vec![0.0; signal.len()];
        let light =
            Light { start_us: 0.0, step_us: 1_000.0, signal: &signal, level: &level, bends: None };
        let law = PixelLaw {
            theta_on: 0.25,
            theta_off: 0.25,
            leak_per_s: 0.0,
            noise_at_white: 1e-6,
            jitter_s: 4e-3,
            ..PixelLaw::default()
        };
        let course = Course::new(&law, light, [0, 80]);
        let alone = law.scatter_of_stamps(10.0);
        // From the foot of the flank to where it has risen by the threshold, as steep.
        assert!((course.noise(6.0) / (alone * 2.0_f64.sqrt()) - 1.0).abs() < 1e-4);
        // Near the end nothing is crossed any more.
        assert!((course.noise(60.0) / alone - 1.0).abs() < 1e-4);
        let crossing = |at| course.ahead(at, true).crossing;
        assert!((crossing(30.0).unwrap() - 75.0).abs() < 1e-4);
        assert!(crossing(60.0).is_none());
    }
}
