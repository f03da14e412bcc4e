//! The forward simulation of some pixels of a camera.

use super::comparator_input::ComparatorInput;
use super::parameters::{ForwardError, ForwardParameters, MAX_EVENT_RATE_HZ};
use super::{noisy, quiet};
use crate::effect::{
    Effect, EffectError, PixelSite, ReadoutContext, RecordingContext, Region, SiteSignal,
};
use crate::pixel_model::PixelModel;
use crate::random::RandomSource;
use evrig_core::drive::{Drive, TimeGrid};
use evrig_core::event::{Event, Events};
use evrig_core::geometry::Size;
use rayon::prelude::*;

/// The most instants of a window: at these a pixel's light takes 64 MB.
const MAX_STEPS: i128 = 1 << 24;

/// Pixels that one thread takes at a time. Results do not depend on it.
const PIXELS_PER_TASK: usize = 64;

/// Streams of draws beside those of the effects, which are in the upper half.
const COMPARATOR_STREAM: u64 = 1 << 62;
const SPONTANEOUS_STREAM: u64 = (1 << 62) + 1;

/// Result of a forward simulation.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SimulatedEvents {
    /// The events, in ascending time, within a microsecond by row and column.
    pub events: Events,
    /// Pixels with a known signal at any instant.
    pub n_with_signal: usize,
}

/// Simulates events of pixels of a camera from a drive.
#[derive(Debug, Clone)]
pub struct ForwardSimulator {
    parameters: ForwardParameters,
    context: RecordingContext,
}

impl ForwardSimulator {
    /// A simulator with these parameters, for a recording.
    ///
    /// # Errors
    /// A parameter out of range, or an effect without its input.
    pub fn new(
        parameters: ForwardParameters,
        context: RecordingContext,
    ) -> Result<Self, ForwardError> {
        let step_us = parameters.step_us;
        if !(10..=100_000).contains(&step_us) {
            return Err(ForwardError::Step { step_us });
        }
        for applied in parameters.effects.iter() {
            applied.effect.check()?;
            if let Some(what) = applied.effect.model().missing_input(&context) {
                return Err(EffectError::Needs { id: applied.effect.id(), what }.into());
            }
        }
        Ok(Self { parameters, context })
    }

    /// Its parameters.
    #[must_use]
    pub const fn parameters(&self) -> &ForwardParameters {
        &self.parameters
    }

    /// The events of some pixels in a window of the drive's clock, µs: those with
    /// `window[0] < t <= window[1]`, before effects of readout and stamps move them.
    ///
    /// # Errors
    /// An invalid window or pixel, or an unbounded event rate.
    pub fn run(
        &self,
        drive: &dyn Drive,
        pixels: &[(u16, u16)],
        window_us: [i64; 2],
        seed: u64,
    ) -> Result<SimulatedEvents, ForwardError> {
        self.run_with(drive, pixels, window_us, seed, &|_, _, _| {})
    }

    /// As [`ForwardSimulator::run`], with `adjust` called for each pixel (column, row) after the
    /// effects.
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
        let n_with_signal = blocks.iter().map(|block| block.n_with_signal).sum();
        let mut events: Vec<Event> = blocks.into_iter().flat_map(|block| block.events).collect();
        events.par_sort_by_key(|event| (event.t, event.y, event.x));
        let mut events: Events = events.into_iter().collect();
        self.apply_readout(&mut events, drive.size(), pixels, window_us, seed);
        Ok(SimulatedEvents { events, n_with_signal })
    }

    /// The signal at a pixel's comparator: log intensity over white after all effects before the
    /// comparator. `None` where it is unknown.
    #[must_use]
    pub fn comparator_signal(
        &self,
        drive: &dyn Drive,
        x: u16,
        y: u16,
        grid: TimeGrid,
    ) -> Option<Vec<f32>> {
        let mut values = vec![f32::NAN; grid.n];
        let site = self.site(drive, x, y, RandomSource::new(0));
        self.fill_signal(drive, &site, grid, &mut values).then_some(values)
    }

    /// Applies the effects of readout and stamps to events of any model that are in ascending time,
    /// made by `pixels` of a camera of `size` in a window.
    pub fn apply_readout(
        &self,
        events: &mut Events,
        size: Size,
        pixels: &[(u16, u16)],
        window_us: [i64; 2],
        seed: u64,
    ) {
        let context = &self.context;
        let source = RandomSource::new(seed);
        for applied in self.parameters.effects.iter() {
            let region = applied.region.unwrap_or_default();
            let camera = ReadoutContext { size, pixels, window_us, context, region, source };
            applied.effect.model().apply_to_events(&camera, events);
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

    fn site<'a>(
        &'a self,
        drive: &dyn Drive,
        x: u16,
        y: u16,
        source: RandomSource,
    ) -> PixelSite<'a> {
        let (size, white_dn) = (drive.size(), drive.white_dn());
        PixelSite { x, y, size, white_dn, context: &self.context, source }
    }

    /// The effects that act on a pixel.
    fn acting(&self, site: &PixelSite<'_>) -> impl Iterator<Item = &Effect> {
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
        let place = self.acting(site).fold(middle, |place, e| e.model().drive_place(site, place));
        let lag_us: f64 = self.acting(site).map(|e| e.model().lag_us(site)).sum();
        let grid = TimeGrid { start_us: grid.start_us - lag_us.round() as i64, ..grid };
        let Some(mut signal) = SiteSignal::sample(drive, place, grid, values) else {
            return false;
        };
        self.acting(site).for_each(|effect| effect.model().apply_to_signal(site, &mut signal));
        true
    }

    fn pixel(&self, site: &PixelSite<'_>) -> PixelModel {
        let mut pixel = PixelModel::from_k(self.parameters.k, site.white_dn);
        self.acting(site).for_each(|effect| effect.model().apply_to_pixel(site, &mut pixel));
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
    signal: Vec<f32>,
    input: ComparatorInput,
}

struct BlockEvents {
    events: Vec<Event>,
    n_with_signal: usize,
}

impl ForwardRun<'_> {
    fn block(
        &self,
        buffers: &mut WorkBuffers,
        pixels: &[(u16, u16)],
    ) -> Result<BlockEvents, ForwardError> {
        let mut block = BlockEvents { events: Vec::new(), n_with_signal: 0 };
        for &(x, y) in pixels {
            block.n_with_signal += usize::from(self.pixel(buffers, x, y, &mut block.events)?);
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
        buffers.signal.resize(self.grid.n, f32::NAN);
        if !self.forward.fill_signal(self.drive, &site, self.grid, &mut buffers.signal) {
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
        buffers.input.fill(&pixel, &buffers.signal, step_us * 1e-6);
        if pixel.is_quiet() {
            quiet::simulate(&buffers.input.volts, &pixel, step_us, &mut fire);
        } else {
            let mut draws = self.source.draws(site.number(), COMPARATOR_STREAM);
            noisy::simulate(&buffers.input, &pixel, step_us, &mut draws, &mut fire);
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
