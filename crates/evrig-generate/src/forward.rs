//! Events from a drive: pixels driven by light at any time, with any set of effects.
//!
//! The light of each pixel is taken at a fixed step, changed by the effects before the
//! comparator, and led through a [`PixelModel`] by the exact law between instants. Random numbers
//! are counted by pixel, so that neither threads nor the choice of pixels changes a pixel's events.

mod camera;
mod noisy;
mod pixel;
mod potential;
mod quiet;
#[cfg(test)]
mod tests;

pub use camera::Camera;
pub use pixel::{BandNoise, PixelModel, ThresholdScatter};

use super::effect::{ReadoutContext, EffectError, EffectSet, PixelSignal, Region, PixelSite, RecordingContext};
use super::random::RandomSource;
use super::voltmeter::Coefficients;
use evrig_core::drive::{Drive, TimeGrid};
use evrig_core::event::{Event, Events};
use evrig_core::geometry::Size;
use potential::ComparatorInput;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// What a forward generation is made of.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ForwardParameters {
    /// The voltmeter's k, in the digital units of [`Drive::white_dn`].
    pub k: Coefficients,
    /// What acts beside them.
    #[serde(default, skip_serializing_if = "Effects::is_empty")]
    pub effects: EffectSet,
    /// From one instant of the light to the next, µs.
    #[serde(default = "default_step_us")]
    pub step_us: u32,
}

/// The step at which light is taken when nothing else is said, µs.
const fn default_step_us() -> u32 {
    1_000
}

/// Why a forward generation is refused.
#[derive(Debug, thiserror::Error)]
pub enum ForwardError {
    /// Its effects cannot act.
    #[error(transparent)]
    Effect(#[from] EffectError),
    /// A step that resolves nothing or takes for ever.
    #[error("the step is {step_us} us; expected 10 to 100000")]
    Step {
        /// What was given.
        step_us: u32,
    },
    /// A window that ends before it begins or holds too many instants.
    #[error(
        "the window runs from {} to {} us, {n_steps} steps of {step_us} us; expected 1 to {limit} \
         steps: generate in shorter windows or at a larger step", .window_us[0], .window_us[1]
    )]
    Window {
        /// What was given.
        window_us: [i64; 2],
        /// The step.
        step_us: u32,
        /// How many of them.
        n_steps: i128,
        /// The most that are allowed.
        limit: i128,
    },
    /// A camera that no pixel can work with.
    #[error("{key} of the camera is {value}; expected {low} to {high}")]
    Camera {
        /// The constant.
        key: &'static str,
        /// Its value.
        value: f64,
        /// Lowest value.
        low: f64,
        /// Highest value.
        high: f64,
    },
    /// A drive without a scale.
    #[error("the drive's white is {white_dn} DN; expected a finite value above 0")]
    White {
        /// What the drive states.
        white_dn: f64,
    },
    /// A pixel off the sensor.
    #[error("pixel ({x}, {y}) is not on the sensor of {size}")]
    Pixel {
        /// Column.
        x: u16,
        /// Row.
        y: u16,
        /// The sensor.
        size: Size,
    },
    /// Parameters that make a pixel fire without bound.
    #[error(
        "pixel ({x}, {y}) fires more than {limit} times in a second; check k, the effects and \
         the unit of the drive"
    )]
    TooManyEvents {
        /// Column.
        x: u16,
        /// Row.
        y: u16,
        /// The most that is allowed.
        limit: u32,
    },
}

/// The most instants of a window: at these a pixel's light takes 64 MB.
const MAX_STEPS: i128 = 1 << 24;

/// The most events a pixel may fire a second, on average over a window.
const MAX_EVENT_RATE_HZ: u32 = 20_000;

/// Pixels that one thread takes at a time. Results do not depend on it.
const PIXELS_PER_TASK: usize = 64;

/// Streams of draws beside those of the effects, which are in the upper half.
const COMPARATOR_STREAM: u64 = 1 << 62;
const SPONTANEOUS_STREAM: u64 = (1 << 62) + 1;

/// What a run gave.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SimulatedEvents {
    /// The events, in ascending time, within a microsecond by row and column.
    pub events: Events,
    /// Pixels of which any light is known.
    pub n_lit: usize,
}

/// The generator from a drive.
#[derive(Debug, Clone)]
pub struct ForwardSimulator {
    parameters: ForwardParameters,
    surroundings: RecordingContext,
}

impl ForwardSimulator {
    /// The generator that the parameters describe, in a recording with these surroundings.
    ///
    /// # Errors
    /// A parameter out of range, or an effect that lacks what it acts on.
    pub fn new(
        parameters: ForwardParameters,
        surroundings: RecordingContext,
    ) -> Result<Self, ForwardError> {
        let step_us = parameters.step_us;
        if !(10..=100_000).contains(&step_us) {
            return Err(ForwardError::Step { step_us });
        }
        for applied in parameters.effects.iter() {
            applied.effect.check()?;
            if let Some(what) = applied.effect.acts().lacks(&surroundings) {
                return Err(EffectError::Needs { id: applied.effect.id(), what }.into());
            }
        }
        Ok(Self { parameters, surroundings })
    }

    /// What it is made of.
    #[must_use]
    pub const fn parameters(&self) -> &ForwardParameters {
        &self.parameters
    }

    /// The events of some pixels in a window of the drive's clock, µs: those with
    /// `window[0] < t <= window[1]`, before effects of readout and stamps move them.
    ///
    /// # Errors
    /// A window or pixel that cannot be, or a pixel that fires without bound.
    pub fn run(
        &self,
        drive: &dyn Drive,
        pixels: &[(u16, u16)],
        window_us: [i64; 2],
        seed: u64,
    ) -> Result<SimulatedEvents, ForwardError> {
        self.run_with(drive, pixels, window_us, seed, &|_, _, _| {})
    }

    /// As [`ForwardSimulator::run`], with `adjust` called for each pixel (column, row) behind the effects,
    /// for what is known of single pixels.
    ///
    /// # Errors
    /// As [`ForwardSimulator::run`].
    pub fn run_with(
        &self,
        drive: &dyn Drive,
        pixels: &[(u16, u16)],
        window_us: [i64; 2],
        seed: u64,
        adjust: &(dyn Fn(u16, u16, &mut PixelModel) + Sync),
    ) -> Result<SimulatedEvents, ForwardError> {
        let run = ForwardRun {
            forward: self,
            drive,
            grid: self.grid(window_us)?,
            window_us,
            source: RandomSource::new(seed),
            adjust,
        };
        let (size, white_dn) = (drive.size(), drive.white_dn());
        if !(white_dn > 0.0 && white_dn.is_finite()) {
            return Err(ForwardError::White { white_dn });
        }
        if let Some(&(x, y)) = pixels.iter().find(|(x, y)| !size.contains(*x, *y)) {
            return Err(ForwardError::Pixel { x, y, size });
        }
        let blocks: Result<Vec<BlockEvents>, ForwardError> = pixels
            .par_chunks(PIXELS_PER_TASK)
            .map_init(WorkBuffers::default, |buffers, block| run.block(buffers, block))
            .collect();
        let blocks = blocks?;
        let n_lit = blocks.iter().map(|block| block.n_lit).sum();
        let mut events: Vec<Event> = blocks.into_iter().flat_map(|block| block.events).collect();
        events.par_sort_by_key(|event| (event.t, event.y, event.x));
        let mut events: Events = events.into_iter().collect();
        self.readout(&mut events, drive.size(), pixels, window_us, seed);
        Ok(SimulatedEvents { events, n_lit })
    }

    /// The light of a pixel as its comparator gets it: log intensity over white behind all effects
    /// before the comparator. `None` where nothing is known of it.
    #[must_use]
    pub fn light(&self, drive: &dyn Drive, x: u16, y: u16, grid: TimeGrid) -> Option<Vec<f32>> {
        let mut values = vec![f32::NAN; grid.n];
        let site = self.site(drive, x, y, RandomSource::new(0));
        self.fill_signal(drive, &site, grid, &mut values).then_some(values)
    }

    /// Applies the effects of readout and stamps to events of any model that are in ascending time,
    /// made by `pixels` of a camera of `size` in a window.
    pub fn readout(
        &self,
        events: &mut Events,
        size: Size,
        pixels: &[(u16, u16)],
        window_us: [i64; 2],
        seed: u64,
    ) {
        let surroundings = &self.surroundings;
        let source = RandomSource::new(seed);
        for applied in self.parameters.effects.iter() {
            let region = applied.region.unwrap_or_default();
            let bench = ReadoutContext { size, pixels, window_us, surroundings, region, source };
            applied.effect.acts().readout(&bench, events);
        }
    }

    fn grid(&self, window_us: [i64; 2]) -> Result<TimeGrid, ForwardError> {
        let step_us = self.parameters.step_us;
        let span = i128::from(window_us[1]) - i128::from(window_us[0]);
        let n_steps = span / i128::from(step_us);
        if span <= 0 || n_steps > MAX_STEPS {
            return Err(ForwardError::Window { window_us, step_us, n_steps, limit: MAX_STEPS });
        }
        Ok(TimeGrid::covering(window_us, step_us))
    }

    fn site<'a>(&'a self, drive: &dyn Drive, x: u16, y: u16, source: RandomSource) -> PixelSite<'a> {
        let (size, white_dn) = (drive.size(), drive.white_dn());
        PixelSite { x, y, size, white_dn, surroundings: &self.surroundings, source }
    }

    /// The effects that act on a pixel.
    fn acting(&self, site: &PixelSite<'_>) -> impl Iterator<Item = &super::effect::Effect> {
        let (x, y) = (site.x, site.y);
        let here = move |region: &Option<Region>| region.is_none_or(|r| r.contains(x, y));
        self.parameters.effects.iter().filter(move |a| here(&a.region)).map(|a| &a.effect)
    }

    fn fill_signal(
        &self,
        drive: &dyn Drive,
        site: &PixelSite<'_>,
        grid: TimeGrid,
        values: &mut [f32],
    ) -> bool {
        let middle = [f64::from(site.x) + 0.5, f64::from(site.y) + 0.5];
        let place = self.acting(site).fold(middle, |place, e| e.acts().look(site, place));
        let lag_us: f64 = self.acting(site).map(|e| e.acts().lag_us(site)).sum();
        let grid = TimeGrid { start_us: grid.start_us - lag_us.round() as i64, ..grid };
        let Some(mut light) = PixelSignal::sample(drive, place, grid, values) else { return false };
        self.acting(site).for_each(|effect| effect.acts().light(site, &mut light));
        true
    }

    fn pixel(&self, site: &PixelSite<'_>) -> PixelModel {
        let mut pixel = PixelModel::from_k(self.parameters.k, site.white_dn);
        self.acting(site).for_each(|effect| effect.acts().pixel(site, &mut pixel));
        pixel
    }
}

/// One run of a generator.
struct ForwardRun<'a> {
    forward: &'a ForwardSimulator,
    drive: &'a dyn Drive,
    grid: TimeGrid,
    window_us: [i64; 2],
    source: RandomSource,
    adjust: &'a (dyn Fn(u16, u16, &mut PixelModel) + Sync),
}

/// Memory of a thread, used again from pixel to pixel.
#[derive(Default)]
struct WorkBuffers {
    light: Vec<f32>,
    potential: ComparatorInput,
}

struct BlockEvents {
    events: Vec<Event>,
    n_lit: usize,
}

impl ForwardRun<'_> {
    fn block(&self, buffers: &mut WorkBuffers, pixels: &[(u16, u16)]) -> Result<BlockEvents, ForwardError> {
        let mut block = BlockEvents { events: Vec::new(), n_lit: 0 };
        for &(x, y) in pixels {
            block.n_lit += usize::from(self.pixel(buffers, x, y, &mut block.events)?);
        }
        Ok(block)
    }

    /// Appends the events of a pixel; whether any light is known of it.
    fn pixel(
        &self,
        buffers: &mut WorkBuffers,
        x: u16,
        y: u16,
        events: &mut Vec<Event>,
    ) -> Result<bool, ForwardError> {
        let site = self.forward.site(self.drive, x, y, self.source);
        buffers.light.resize(self.grid.n, f32::NAN);
        if !self.forward.fill_signal(self.drive, &site, self.grid, &mut buffers.light) {
            return Ok(false);
        }
        let mut pixel = self.forward.pixel(&site);
        (self.adjust)(x, y, &mut pixel);
        if pixel.is_dead {
            return Ok(true);
        }
        let step_us = f64::from(self.grid.step_us);
        let seconds = (self.grid.n as f64 * step_us * 1e-6).max(1.0);
        let limit = (seconds * f64::from(MAX_EVENT_RATE_HZ)) as usize;
        let (first, mut n) = (events.len(), 0);
        let mut fire = |steps: f64, on: bool| {
            let t = self.grid.start_us + (steps * step_us).ceil() as i64;
            n += 1;
            if t > self.window_us[0] && t <= self.window_us[1] && n <= limit {
                events.push(Event { t, x, y, on });
            }
            n <= limit
        };
        buffers.potential.fill(&pixel, &buffers.light, step_us * 1e-6);
        if pixel.is_quiet() {
            quiet::walk(&buffers.potential.volts, &pixel, step_us, &mut fire);
        } else {
            let mut draws = self.source.draws(site.number(), COMPARATOR_STREAM);
            noisy::walk(&buffers.potential, &pixel, step_us, &mut draws, &mut fire);
        }
        self.spontaneous(&site, &pixel, &mut fire);
        if n > limit {
            return Err(ForwardError::TooManyEvents { x, y, limit: MAX_EVENT_RATE_HZ });
        }
        events[first..].sort_by_key(|event| event.t);
        Ok(true)
    }

    /// Events that come without a crossing: a Poisson process.
    fn spontaneous(
        &self,
        site: &PixelSite<'_>,
        pixel: &PixelModel,
        fire: &mut dyn FnMut(f64, bool) -> bool,
    ) {
        let per_step = pixel.spontaneous_hz * f64::from(self.grid.step_us) * 1e-6;
        if per_step <= 0.0 {
            return;
        }
        let mut draws = self.source.draws(site.number(), SPONTANEOUS_STREAM);
        let mut at = 0.0;
        loop {
            at -= draws.uniform().ln() / per_step;
            if at > self.grid.n as f64 {
                return;
            }
            if !fire(at, draws.uniform() < 0.5) {
                return;
            }
        }
    }
}
