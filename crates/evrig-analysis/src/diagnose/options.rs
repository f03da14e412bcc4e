//! Work and resolution of a diagnosis.

use serde::{Deserialize, Serialize};

/// Work and resolution of a diagnosis.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct DiagnosisOptions {
    /// Pixels, at most, where they have enough events; drawn over the whole sensor, textured ones
    /// first.
    pub n_pixels: usize,
    /// With fewer events than this, more pixels are used, up to `n_instants`.
    pub few_events: usize,
    /// Events, at most; pixels are thinned down to a minimum, then the time is subsampled.
    pub n_events: usize,
    /// Instants of the signal over all pixels, at most.
    pub n_instants: usize,
    /// Step between instants of the signal, microseconds.
    pub step_us: u32,
    /// Time blocks.
    pub n_blocks: usize,
    /// Side of a tile of pixels, the spatial unit of cross-validation.
    pub tile_px: u16,
    /// Effects that can be named, at most.
    pub max_effects: usize,
    /// Seed of all random draws.
    pub seed: u64,
}

impl Default for DiagnosisOptions {
    fn default() -> Self {
        Self {
            n_pixels: 120,
            few_events: 1_500,
            n_events: 8_000,
            n_instants: 8_000_000,
            step_us: 1_000,
            n_blocks: 9,
            tile_px: 20,
            max_effects: 4,
            seed: 0,
        }
    }
}
