//! The signal of one pixel with its leak, over a known stretch of its light.

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

    /// Scale of the scatter of a threshold from a position on.
    pub(super) fn noise(&self, position: f64) -> f64 {
        self.law.noise_on(self.level(position), self.slope(position))
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
