//! The DAVIS's own frames: global shutter, eight bits.

use crate::world::draws::{RandomPurpose, WorldRandom};
use crate::world::exposure::{Exposure, n_samples};
use crate::world::scene::World;
use crate::world::view::DAVIS_TEXELS_PER_PX;
use evrig_core::frame::{Frame, FrameTiming, Samples};
use evrig_core::time::{Davis, Span, Stamp};
use rayon::prelude::*;

/// A column-parallel readout takes so long a row.
const READOUT_ROW: Span = Span::from_micros(20);

/// Takes frame after frame.
#[derive(Debug)]
pub(super) struct Aps {
    from: Span,
    period: Span,
    next: u64,
}

impl Aps {
    pub(super) fn new(world: &World, from: Span) -> Self {
        let period = Span::from_secs_f64(1.0 / world.rig.davis.camera.frame_rate.0);
        Self { from, period, next: 0 }
    }

    fn start_of(&self, number: u64) -> Span {
        self.from + Span::from_nanos(self.period.as_nanos().saturating_mul(number as i64))
    }

    /// Numbers and starts (seconds) of the exposures that begin within an interval.
    pub(super) fn exposures_within(&self, world: &World, from: Span, to: Span) -> Vec<(u64, f64)> {
        let period = self.period.as_nanos().max(1);
        let first = ((from - self.from).as_nanos() / period - 1).max(0) as u64;
        let starts = (first..).map(|number| (number, self.start_of(number)));
        let within =
            starts.take_while(|(_, start)| *start < to).filter(|(_, start)| *start >= from);
        within
            .filter(|(_, start)| world.lamps().schedule.at(*start).aps)
            .map(|(number, start)| (number, start.as_secs_f64()))
            .collect()
    }

    /// The frames whose exposure ended before `until` and were not given yet.
    pub(super) fn frames_until(&mut self, world: &World, until: Span) -> Vec<Frame<Davis>> {
        let mut frames = Vec::new();
        loop {
            let (number, start) = (self.next, self.start_of(self.next));
            let setting = world.lamps().schedule.at(start);
            let exposure = world.rig.davis.camera.exposure.as_secs_f64() * setting.exposure_scale;
            let end = start + Span::from_secs_f64(exposure);
            if end > until {
                return frames;
            }
            self.next += 1;
            if setting.aps && world.rig.davis.aps {
                frames.push(frame(world, number, [start, end], setting.exposure_scale));
            }
        }
    }
}

fn frame(world: &World, number: u64, [start, end]: [Span; 2], scale: f64) -> Frame<Davis> {
    let view = &world.davis;
    let size = view.camera.size;
    let sensor = &world.description.davis;
    let n = n_samples(world, view, DAVIS_TEXELS_PER_PX, start, end);
    let exposure = Exposure::new(world, view, start, end, n);
    let black = world.rig.davis.camera.black_level_dn as f32;
    let white = (sensor.aps_white_dn * scale) as f32;
    let per_electron = 1.0 / sensor.aps_electrons_per_dn as f32;
    let read = sensor.aps_read_noise_dn as f32;
    let width = usize::from(size.width);
    let mut samples = vec![0_u8; size.n_pixels()];
    samples.par_chunks_mut(width).enumerate().for_each(|(row, samples)| {
        let mut draws = WorldRandom::new(world.seed, RandomPurpose::ApsNoise, number, row as u64);
        for (column, sample) in samples.iter_mut().enumerate() {
            let signal = white * exposure.mean(row * width + column);
            let sigma = (signal.max(0.0) * per_electron + read * read).sqrt();
            *sample = (black + signal + sigma * draws.normal()).round().clamp(0.0, 255.0) as u8;
        }
    });
    // The recorder writes whole microseconds.
    let stamp = |time: Span| Stamp::from_micros(world.clocks.davis(time).as_micros());
    let readout = Span::from_nanos(READOUT_ROW.as_nanos() * i64::from(size.height));
    Frame::gray(
        FrameTiming {
            stamp: stamp(start),
            exposure: Some([stamp(start), stamp(end)]),
            readout: Some([stamp(end), stamp(end + readout)]),
            row_time: Span::ZERO,
        },
        size,
        Samples::U8(samples),
    )
}
