//! The predictive log score.

use super::{BlockScore, Blocks, ByPixel, EventTerm, Light, Lights, PixelLaw, Spike, Stretch};
use super::{Witness, walk};
use evrig_core::drive::Drive;
use rayon::prelude::*;

/// Pixels whose light is held in memory at a time.
const PIXELS_AT_A_TIME: usize = 512;

/// The log-likelihood of events and silences given the light.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Score {
    /// Sum of the logarithms of the events' hazards minus the compensators; time in seconds.
    pub log_likelihood: f64,
    /// Events of pixels and times with known light.
    pub n_events: u64,
    /// Pixels of which the light is known at some time.
    pub n_pixels: u64,
}

impl Score {
    /// Nats an event; NaN without events.
    #[must_use]
    pub fn nats_per_event(&self) -> f64 {
        self.log_likelihood / self.n_events as f64
    }
}

/// Adds up what a pixel scores, block by block.
struct Summing<'a>(&'a mut [BlockScore]);

impl Witness for Summing<'_> {
    fn silence(&mut self, stretch: &Stretch) {
        let [on, off] = &mut self.0[stretch.block].on_off;
        *on -= stretch.on;
        *off -= stretch.off;
    }

    fn event(&mut self, term: &EventTerm) {
        let block = &mut self.0[term.block];
        block.on_off[usize::from(!term.spike.on)] += term.log_hazard;
        block.n_events += 1;
    }
}

/// What one pixel scores in each block of time.
#[must_use]
pub fn score_pixel(
    law: &PixelLaw,
    light: Light<'_>,
    spikes: &[Spike],
    blocks: &Blocks,
) -> Vec<BlockScore> {
    let mut scores = vec![BlockScore::default(); blocks.n()];
    walk(law, light, spikes, blocks, &mut Summing(&mut scores));
    scores
}

/// The score of the events of `pixels` under one law, the drive sampled every `step_us`.
/// Memory does not grow with the number of pixels.
#[must_use]
pub fn score(
    law: &PixelLaw,
    drive: &dyn Drive,
    recording: &ByPixel,
    pixels: &[(u16, u16)],
    step_us: u32,
) -> Score {
    let mut sum = Score::default();
    for some in pixels.chunks(PIXELS_AT_A_TIME) {
        let lights = Lights::new(drive, some, recording.window_us(), step_us);
        let part = score_lights(law, &lights, recording);
        sum.log_likelihood += part.log_likelihood;
        sum.n_events += part.n_events;
        sum.n_pixels += part.n_pixels;
    }
    sum
}

/// The score of the events of the pixels whose lights are given, under one law.
#[must_use]
pub fn score_lights(law: &PixelLaw, lights: &Lights, recording: &ByPixel) -> Score {
    let blocks = Blocks::new(recording.length_us(), 1);
    let scores: Vec<BlockScore> = (0..lights.pixels().len())
        .into_par_iter()
        .map(|index| {
            let (x, y) = lights.pixels()[index];
            let all = score_pixel(law, lights.light(index), recording.of(x, y), &blocks);
            all.first().copied().unwrap_or_default()
        })
        .collect();
    let mut sum = Score { n_pixels: scores.len() as u64, ..Score::default() };
    for score in scores {
        sum.log_likelihood += score.log_likelihood();
        sum.n_events += u64::from(score.n_events);
    }
    sum
}
