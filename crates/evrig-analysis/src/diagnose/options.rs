//! How much work a diagnosis is.

use serde::{Deserialize, Serialize};

/// How hard to look.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct DiagnosisOptions {
    /// Pixels looked at, at most where they have events enough; they are drawn over the whole
    /// sensor, textured ones first.
    pub n_pixels: usize,
    /// With fewer events than these in them, more pixels are looked at, as long as there are
    /// instants.
    pub few_events: usize,
    /// Events of the pixels looked at, at most, as long as a few tens of pixels are left; where these still
    /// hold more than twice as many, parts of the time are looked at: more say little more and take as much
    /// longer.
    pub n_events: usize,
    /// Instants of light, over all pixels, at most.
    pub n_instants: usize,
    /// From one instant of the light to the next.
    pub step_us: u32,
    /// Blocks of time.
    pub n_blocks: usize,
    /// Side of a tile of pixels that is trained on or held out as one.
    pub tile_px: u16,
    /// Most effects named.
    pub max_effects: usize,
    /// Recordings drawn from the fitted model that go through the same search.
    pub n_null: usize,
    /// Seed of all draws.
    pub seed: u64,
}

impl DiagnosisOptions {
    /// A short look, for a run over every stage: fewer pixels and one drawn recording.
    #[must_use]
    pub fn brief() -> Self {
        Self { n_pixels: 120, n_null: 1, ..Self::default() }
    }
}

impl Default for DiagnosisOptions {
    fn default() -> Self {
        Self {
            n_pixels: 600,
            few_events: 1_500,
            n_events: 8_000,
            n_instants: 8_000_000,
            step_us: 1_000,
            n_blocks: 9,
            tile_px: 20,
            max_effects: 4,
            n_null: 2,
            seed: 0,
        }
    }
}
