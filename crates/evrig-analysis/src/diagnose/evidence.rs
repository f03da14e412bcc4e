//! The data of a diagnosis: selected pixels with their events, log-intensity signal and context.

pub(crate) mod event_context;
pub(crate) mod frame_bursts;
pub(crate) mod pixel_selection;
pub(crate) mod session_facts;
pub(crate) mod spectral_lines;
pub(crate) mod stamp_grid;

use crate::diagnose::evidence::event_context::EventContext;
use crate::diagnose::evidence::frame_bursts::FrameBursts;
use crate::diagnose::evidence::pixel_selection::select_pixels;
use crate::diagnose::{DiagnosisOptions, SessionFacts};
use crate::predict::{BurstWindow, EventsByPixel, Spike, TimeBlocks};
use evrig_core::drive::{Drive, TimeGrid};
use evrig_core::stats::SplitMix;
use rayon::prelude::*;
use std::ops::Range;
use std::sync::{Arc, OnceLock};

/// Fewest events with a known signal from which a diagnosis is possible.
const MIN_EVENTS: usize = 300;

/// A recording with more than this many times the wanted events is subsampled in time.
const MAX_EVENT_EXCESS: usize = 2;

/// Why a session cannot be diagnosed.
#[derive(Debug, thiserror::Error)]
pub enum DiagnoseError {
    /// Too few events with a known signal.
    #[error(
        "{n} events have a known light in {n_pixels} pixels; a diagnosis needs at least \
         {MIN_EVENTS}: record for longer, from nearer, with more texture, or with a shorter \
         exposure where frames are clipped"
    )]
    TooFew {
        /// Events with a known signal.
        n: usize,
        /// Pixels with a known signal.
        n_pixels: usize,
    },
    /// Signal and events do not overlap in time.
    #[error(
        "the light is known from {light_from_us} to {light_to_us} us, the events lie from \
         {events_from_us} to {events_to_us} us: they do not overlap; check the clocks"
    )]
    NoOverlap {
        /// Start of the signal.
        light_from_us: i64,
        /// End of the signal.
        light_to_us: i64,
        /// Start of the events' window.
        events_from_us: i64,
        /// End of the events' window.
        events_to_us: i64,
    },
}

/// A selected pixel.
#[derive(Debug, Clone)]
pub struct PixelEvidence {
    /// Column.
    pub x: u16,
    /// Row.
    pub y: u16,
    /// Index of its tile.
    pub tile: usize,
    /// Its events.
    pub spikes: Vec<Spike>,
    /// Log intensity over white at every instant; NaN where unknown.
    pub(crate) light: Vec<f32>,
    /// Change of log intensity per pixel to the right and downwards; empty for frames of the same
    /// sensor.
    pub gradient: [Vec<f32>; 2],
    /// Laplacian of intensity over intensity, per square pixel; empty for frames of the same
    /// sensor.
    pub laplacian: Vec<f32>,
    /// When bursts follow the camera's own frames.
    pub(crate) bursts: Arc<[BurstWindow]>,
    /// Intensity over white, computed at first use.
    intensity: OnceLock<Vec<f32>>,
}

impl PixelEvidence {
    pub(crate) fn intensity(&self) -> &[f32] {
        self.intensity.get_or_init(|| self.light.iter().map(|level| level.exp()).collect())
    }

    /// The signal, to be changed.
    pub(crate) fn light_mut(&mut self) -> &mut [f32] {
        self.intensity = OnceLock::new();
        &mut self.light
    }

    /// Number of events between two instants at which the signal is known.
    fn n_with_known_light(&self, start_us: f64, step_us: f64) -> usize {
        let is_known = |i: usize| self.light.get(i).is_some_and(|level| level.is_finite());
        let is_lit = |spike: &&Spike| {
            let at = (spike.t_us as f64 - start_us) / step_us;
            at >= 0.0 && is_known(at as usize) && is_known(at as usize + 1)
        };
        self.spikes.iter().filter(is_lit).count()
    }
}

/// The data of a diagnosis.
#[derive(Debug, Clone)]
pub struct Evidence {
    /// Pixels in row-major order.
    pub pixels: Vec<PixelEvidence>,
    /// Window of the events, microseconds of their clock.
    pub window_us: [i64; 2],
    /// First instant, microseconds since the window's start.
    pub start_us: f64,
    /// Step between instants, microseconds.
    pub step_us: f64,
    /// Time blocks.
    pub blocks: TimeBlocks,
    /// Number of tiles.
    pub n_tiles: usize,
    /// Center of the sensor, pixels.
    pub middle: [f64; 2],
    /// ON minus OFF events of all pixels, and ON plus OFF, per instant.
    pub rates: [Vec<f32>; 2],
    /// All events of the sensor.
    pub(crate) event_context: Arc<EventContext>,
    /// Bursts that follow the camera's own frames.
    pub(crate) bursts: Option<Arc<FrameBursts>>,
    /// What the session states.
    pub facts: SessionFacts,
}

impl Evidence {
    /// Selects pixels with a known, varying signal and samples it.
    ///
    /// # Errors
    ///
    /// When signal and events do not overlap, or too few events have a known signal.
    pub fn new(
        recording: &EventsByPixel,
        drive: &dyn Drive,
        facts: SessionFacts,
        options: &DiagnosisOptions,
    ) -> Result<Self, DiagnoseError> {
        let window = recording.window_us();
        let [from, to] = drive.span_us();
        let span = [from.max(window[0]), to.min(window[1])];
        if span[1] - span[0] < 10 * i64::from(options.step_us) {
            return Err(DiagnoseError::NoOverlap {
                light_from_us: from,
                light_to_us: to,
                events_from_us: window[0],
                events_to_us: window[1],
            });
        }
        let mut grid = TimeGrid::covering(span, options.step_us);
        while grid.at(grid.n - 1) > span[1] && grid.n > 2 {
            grid.n -= 1;
        }
        let chosen = select_pixels(recording, drive, grid, options);
        let size = recording.size();
        let n_across = usize::from(size.width.div_ceil(options.tile_px));
        let n_down = usize::from(size.height.div_ceil(options.tile_px));
        let n_tiles = n_across * n_down;
        let jumps = instants(&drive.jumps_us(), grid);
        let pixels: Vec<PixelEvidence> = chosen
            .par_iter()
            .filter_map(|&(x, y)| {
                let tile_of = |p: u16| usize::from(p / options.tile_px);
                let tile = tile_of(y) * n_across + tile_of(x);
                pixel(recording, drive, grid, &jumps, (x, y), tile, facts.from_scene)
            })
            .collect();
        let start_us = (grid.start_us - window[0]) as f64;
        let n = pixels
            .iter()
            .map(|pixel| pixel.n_with_known_light(start_us, f64::from(grid.step_us)))
            .sum();
        if n < MIN_EVENTS {
            return Err(DiagnoseError::TooFew { n, n_pixels: pixels.len() });
        }
        let evidence = Self {
            pixels,
            window_us: window,
            start_us,
            step_us: f64::from(grid.step_us),
            blocks: TimeBlocks::new(recording.length_us(), options.n_blocks),
            n_tiles,
            middle: [f64::from(size.width) / 2.0, f64::from(size.height) / 2.0],
            rates: rates(recording, grid, start_us),
            event_context: Arc::new(EventContext::new(recording.clone(), &facts.aps_us)),
            bursts: None,
            facts,
        };
        Ok(evidence.subsample_time(MAX_EVENT_EXCESS * options.n_events, options.seed))
    }

    /// The same pixels with other events.
    #[must_use]
    pub fn with_events(&self, spikes: Vec<Vec<Spike>>) -> Self {
        let mut other = self.clone();
        for (pixel, own) in other.pixels.iter_mut().zip(spikes) {
            pixel.spikes = own;
        }
        other
    }

    /// With bursts that follow the camera's own frames.
    pub(crate) fn with_bursts(mut self, bursts: FrameBursts) -> Self {
        for pixel in &mut self.pixels {
            pixel.bursts = bursts.of_row(pixel.y);
        }
        self.bursts = Some(Arc::new(bursts));
        self
    }

    /// Every `n`-th pixel.
    #[must_use]
    pub fn thinned(&self, n: usize) -> Self {
        let mut other = self.clone();
        other.pixels = other.pixels.into_iter().step_by(n.max(1)).collect();
        other
    }

    /// Keeps about `n_events` events: in every block one stretch of equal length at a random
    /// place.
    fn subsample_time(self, n_events: usize, seed: u64) -> Self {
        let share = n_events as f64 / self.n_events().max(1) as f64;
        if share >= 1.0 {
            return self;
        }
        let mut random = SplitMix::new(seed, 0x7374_7265);
        let n_blocks = self.blocks.n();
        let from: Vec<f64> = (0..n_blocks).map(|_| (1.0 - share) * random.uniform()).collect();
        let (start_us, step_us, blocks) = (self.start_us, self.step_us, self.blocks);
        let block_us = blocks.length_us() as f64 / n_blocks as f64;
        self.masked_to(|i| {
            let us = start_us + i as f64 * step_us;
            let block = blocks.of(us);
            let passed = us / block_us - block as f64;
            (from[block]..from[block] + share).contains(&passed)
        })
    }

    /// Keeps some instants; the signal is unknown at the others.
    fn masked_to(mut self, is_known: impl Fn(usize) -> bool) -> Self {
        let is_known: Vec<bool> = (0..self.n_instants()).map(is_known).collect();
        for pixel in &mut self.pixels {
            let dark =
                pixel.light_mut().iter_mut().zip(&is_known).filter(|(_, is_known)| !**is_known);
            dark.for_each(|(level, _)| *level = f32::NAN);
            let instant = |t_us: i64| (t_us as f64 - self.start_us) / self.step_us;
            let is_in = |at: f64| at >= 0.0 && is_known.get(at as usize) == Some(&true);
            pixel.spikes.retain(|spike| is_in(instant(spike.t_us)));
        }
        self
    }

    fn n_instants(&self) -> usize {
        self.pixels.first().map_or(0, |pixel| pixel.light.len())
    }

    /// Number of events.
    #[must_use]
    pub fn n_events(&self) -> usize {
        self.pixels.iter().map(|pixel| pixel.spikes.len()).sum()
    }

    /// Duration of the signal, seconds.
    #[must_use]
    pub fn seconds(&self) -> f64 {
        self.n_instants() as f64 * self.step_us * 1e-6
    }

    /// Event rate of the whole sensor over the three instants before a time.
    pub(crate) fn rate_hz(&self, t_us: i64) -> f64 {
        let at = (t_us as f64 - self.start_us) / self.step_us;
        let i = (at.max(0.0) as usize).min(self.rates[1].len().saturating_sub(1));
        let recent = &self.rates[1][i.saturating_sub(3)..i];
        f64::from(recent.iter().sum::<f32>()) / (3e-6 * self.step_us)
    }

    /// Number of pixels of the sensor.
    #[must_use]
    pub fn n_sensor(&self) -> f64 {
        4.0 * self.middle[0] * self.middle[1]
    }

    /// Index of a cell: a tile of pixels during a time block.
    #[must_use]
    pub fn cell(&self, pixel: &PixelEvidence, block: usize) -> usize {
        pixel.tile * self.blocks.n() + block
    }

    /// Whether a tile is held out during a block: a third of all cells.
    #[must_use]
    pub fn is_held_out(&self, tile: usize, block: usize) -> bool {
        let mut random = SplitMix::new(0x7469_6c65, tile as u64);
        (block + random.below(3)).is_multiple_of(3)
    }
}

/// Ranges of instants that lie in some stretches of time.
fn instants(stretches_us: &[[i64; 2]], grid: TimeGrid) -> Vec<Range<usize>> {
    let at = |us: i64| (grid.position(us as f64).max(0.0) as usize).min(grid.n);
    stretches_us.iter().map(|[from, to]| at(*from)..(at(*to) + 1).min(grid.n)).collect()
}

fn pixel(
    recording: &EventsByPixel,
    drive: &dyn Drive,
    grid: TimeGrid,
    jumps: &[Range<usize>],
    (x, y): (u16, u16),
    tile: usize,
    with_surroundings: bool,
) -> Option<PixelEvidence> {
    let place = [f64::from(x) + 0.5, f64::from(y) + 0.5];
    let sample = |dx: f64, dy: f64| {
        let mut out = vec![f32::NAN; grid.n];
        drive.sample([place[0] + dx, place[1] + dy], grid, &mut out).then_some(out)
    };
    let mut light = sample(0.0, 0.0)?;
    jumps.iter().for_each(|jump| light[jump.clone()].fill(f32::NAN));
    let spikes = recording.of(x, y).to_vec();
    let mut evidence = PixelEvidence {
        x,
        y,
        tile,
        spikes,
        light,
        gradient: [Vec::new(), Vec::new()],
        laplacian: Vec::new(),
        bursts: Arc::default(),
        intensity: OnceLock::new(),
    };
    if with_surroundings {
        let (left, right) = (sample(-1.0, 0.0)?, sample(1.0, 0.0)?);
        let (up, down) = (sample(0.0, -1.0)?, sample(0.0, 1.0)?);
        let half = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| 0.5 * (b - a)).collect();
        evidence.gradient = [half(&left, &right), half(&up, &down)];
        evidence.laplacian = (0..grid.n)
            .map(|i| {
                let over = |side: &[f32]| (side[i] - evidence.light[i]).exp();
                over(&left) + over(&right) + over(&up) + over(&down) - 4.0
            })
            .collect();
    }
    Some(evidence)
}

fn rates(recording: &EventsByPixel, grid: TimeGrid, start_us: f64) -> [Vec<f32>; 2] {
    let mut net = vec![0.0; grid.n];
    let mut all = vec![0.0; grid.n];
    for y in 0..recording.size().height {
        for x in 0..recording.size().width {
            for spike in recording.of(x, y) {
                let at = (spike.t_us as f64 - start_us) / f64::from(grid.step_us);
                if let Some(i) = (at >= 0.0).then_some(at as usize).filter(|i| *i < grid.n) {
                    net[i] += if spike.on { 1.0 } else { -1.0 };
                    all[i] += 1.0;
                }
            }
        }
    }
    [net, all]
}
