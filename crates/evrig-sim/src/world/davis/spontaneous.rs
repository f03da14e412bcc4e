//! Events that come by themselves: at random, and from the camera's own frames.

use super::slab::Slab;
use crate::world::draws::{RandomPurpose, WorldRandom, poisson};
use crate::world::effects::{ApsCoupling, BackgroundActivity, WorldEffects};

/// Sources of such events.
#[derive(Debug, Clone)]
pub(super) struct Spontaneous {
    background: Option<BackgroundActivity>,
    coupling: Option<ApsCoupling>,
    seed: u64,
}

impl Spontaneous {
    pub(super) fn new(effects: &WorldEffects, seed: u64) -> Self {
        Self {
            background: effects.background_activity.filter(|activity| activity.rate_hz > 0.0),
            coupling: effects.aps_coupling.filter(|coupling| coupling.events_fraction > 0.0),
            seed,
        }
    }

    pub(super) fn is_silent(&self) -> bool {
        self.background.is_none() && self.coupling.is_none()
    }

    /// From the exposure's start to the last kick of a frame, in seconds: earliest and latest.
    pub(super) fn reach_s(&self, n_rows: usize) -> [f64; 2] {
        self.coupling.map_or([0.0; 2], |coupling| {
            let first = coupling.delay_us * 1e-6;
            let last = first + coupling.row_us * 1e-6 * n_rows as f64;
            [first.min(last), first.max(last)]
        })
    }

    /// The events of one pixel within the slab, in order; `exposures` are numbers and starts
    /// (seconds) of the frames that may reach into it. An affected pixel alone has background
    /// activity.
    pub(super) fn events(
        &self,
        pixel: usize,
        row: usize,
        is_affected: bool,
        slab: &Slab,
        exposures: &[(u64, f64)],
        events: &mut Vec<(f64, bool)>,
    ) {
        events.clear();
        let (begin, length) = (slab.begin(), slab.length());
        if let Some(background) = self.background.filter(|_| is_affected) {
            let mut draws =
                WorldRandom::new(self.seed, RandomPurpose::Spontaneous, pixel as u64, slab.number);
            for _ in 0..poisson(&mut draws, background.rate_hz * length) {
                let time = begin + draws.uniform() * length;
                events.push((time, draws.bits() & 1 == 1));
            }
        }
        if let Some(coupling) = self.coupling {
            for (frame, start) in exposures {
                let after_us = coupling.delay_us + coupling.row_us * row as f64;
                let time = start + after_us * 1e-6;
                let mut draws =
                    WorldRandom::new(self.seed, RandomPurpose::ApsCoupling, pixel as u64, *frame);
                let is_within = (begin..begin + length).contains(&time);
                if is_within && draws.uniform() < coupling.events_fraction {
                    events.push((time, draws.bits() & 1 == 1));
                }
            }
        }
        events.sort_by(|a, b| a.0.total_cmp(&b.0));
    }
}
