//! The Pi camera's sensor: rolling shutter, Bayer mosaic, shot and read noise, pedestal, ten bits.

use crate::world::draws::{RandomPurpose, WorldRandom};
use crate::world::exposure::{Exposure, n_samples};
use crate::world::scene::World;
use crate::world::view::PI_TEXELS_PER_PX;
use evrig_core::time::Span;
use evrig_session::rig::Pose;
use rayon::prelude::*;

/// The sensor. It remembers the last mean image: while nothing moves, only the noise is new.
#[derive(Debug)]
pub(super) struct RollingSensor {
    last: Option<StillImage>,
}

/// An image of a scene in which nothing moved.
#[derive(Debug)]
struct StillImage {
    pose: Pose,
    light: f64,
    /// Mean light on each pixel, 1 where white in full light.
    light_on: Vec<f32>,
}

/// What turns light into DN.
struct SensorResponse {
    /// DN of white above the pedestal for each of the mosaic's four places.
    white_dn: [f32; 4],
    variance_per_dn: f32,
    read_dn: f32,
    pedestal_dn: f32,
    /// Range above the stated pedestal, and the exponent of the curve.
    range_dn: f32,
    gamma: f32,
    highest: f32,
}

impl RollingSensor {
    pub(super) fn new() -> Self {
        Self { last: None }
    }

    /// The raw frame whose sensor's first row ends its exposure at `end`.
    pub(super) fn expose(
        &mut self,
        world: &World,
        sequence: u64,
        end: Span,
        exposure: Span,
        exposure_scale: f64,
    ) -> Vec<u16> {
        let timing = RowExposures::new(world, end, exposure);
        let pose = timing.constant_pose(world);
        let light = world.lamps().light.level(end.as_secs_f64());
        let is_known =
            self.last.as_ref().is_some_and(|last| pose == Some(last.pose) && light == last.light);
        let fresh = if is_known { None } else { Some(timing.gather(world)) };
        let light_on = match (&fresh, &self.last) {
            (Some(fresh), _) => fresh.as_slice(),
            (None, Some(last)) => last.light_on.as_slice(),
            (None, None) => &[],
        };
        let raw = SensorResponse::new(world, exposure_scale).digitise(world, sequence, light_on);
        if let Some(light_on) = fresh {
            self.last = pose.map(|pose| StillImage { pose, light, light_on });
        }
        raw
    }
}

/// When the rows of one frame see light.
struct RowExposures {
    /// End of the exposure of the crop's first row.
    first_end: Span,
    row_ns: f64,
    exposure: Span,
    n_rows: usize,
}

impl RowExposures {
    fn new(world: &World, end: Span, exposure: Span) -> Self {
        let stated_us = world.rig.pi.camera.row_time.as_secs_f64() * 1e6;
        let shutter = world.description.effects.rolling_shutter;
        let row_ns = shutter.map_or(stated_us, |shutter| shutter.row_us) * 1e3;
        let first_row = f64::from(world.description.pi.crop_origin_px[1]);
        Self {
            first_end: end + Span::from_nanos((first_row * row_ns).round() as i64),
            row_ns,
            exposure,
            n_rows: usize::from(world.pi.camera.size.height),
        }
    }

    fn end_of(&self, row: usize) -> Span {
        self.first_end + Span::from_nanos((row as f64 * self.row_ns).round() as i64)
    }

    /// The one pose in which all rows see the target, if neither tool nor light changes.
    fn constant_pose(&self, world: &World) -> Option<Pose> {
        let last = self.end_of(self.n_rows.saturating_sub(1));
        let begin = self.first_end.min(last) - self.exposure;
        let end = self.first_end.max(last);
        if !world.lamps().light.is_steady(begin.as_secs_f64(), end.as_secs_f64()) {
            return None;
        }
        let pose = world.true_pose(begin);
        let length = (end - begin).as_nanos();
        let same = (1..=8)
            .all(|part| world.true_pose(begin + Span::from_nanos(length / 8 * part)) == pose);
        (same && world.true_pose(end) == pose).then_some(pose)
    }

    /// Mean light on each pixel.
    fn gather(&self, world: &World) -> Vec<f32> {
        let view = &world.pi;
        let width = usize::from(view.camera.size.width);
        let middle = self.end_of(self.n_rows / 2);
        let n = n_samples(world, view, PI_TEXELS_PER_PX, middle - self.exposure, middle);
        let mut light_on = vec![0.0_f32; view.rays.len()];
        light_on.par_chunks_mut(width).enumerate().for_each(|(row, values)| {
            let end = self.end_of(row);
            let exposure = Exposure::new(world, view, end - self.exposure, end, n);
            for (column, value) in values.iter_mut().enumerate() {
                *value = exposure.mean(row * width + column);
            }
        });
        light_on
    }
}

impl SensorResponse {
    fn new(world: &World, exposure_scale: f64) -> Self {
        let (sensor, effects) = (&world.description.pi, &world.description.effects);
        let camera = &world.rig.pi.camera;
        let [red, green, blue] =
            sensor.colour_response.map(|part| (part * sensor.white_dn * exposure_scale) as f32);
        let extra = effects.frame_noise.map_or(0.0, |noise| noise.sigma_dn);
        let highest = f64::from((1_u32 << world.rig.pi.raw_bits) - 1);
        let offset = effects.black_level.map_or(0.0, |black| black.offset_dn);
        Self {
            white_dn: [red, green, green, blue],
            variance_per_dn: (camera.gain / sensor.electrons_per_dn) as f32,
            read_dn: sensor.read_noise_dn.hypot(extra) as f32,
            pedestal_dn: (camera.black_level_dn + offset) as f32,
            range_dn: (highest - camera.black_level_dn).max(1.0) as f32,
            gamma: effects.tone_curve.map_or(1.0, |curve| curve.gamma) as f32,
            highest: highest as f32,
        }
    }

    fn digitise(&self, world: &World, sequence: u64, light_on: &[f32]) -> Vec<u16> {
        let width = usize::from(world.pi.camera.size.width);
        let mut raw = vec![0_u16; light_on.len()];
        let rows = raw.par_chunks_mut(width).zip(light_on.par_chunks(width)).enumerate();
        rows.for_each(|(row, (raw, light_on))| {
            let mut draws =
                WorldRandom::new(world.seed, RandomPurpose::PiNoise, sequence, row as u64);
            let whites = [self.white_dn[row % 2 * 2], self.white_dn[row % 2 * 2 + 1]];
            for (column, (value, light)) in raw.iter_mut().zip(light_on).enumerate() {
                let signal = whites[column % 2] * light;
                *value = self.sample(signal, &mut draws);
            }
        });
        raw
    }

    fn sample(&self, signal: f32, draws: &mut WorldRandom) -> u16 {
        let shot = self.variance_per_dn * signal.max(0.0);
        let dn = if self.gamma == 1.0 {
            signal + (shot + self.read_dn * self.read_dn).sqrt() * draws.normal()
        } else {
            let noisy = (signal + shot.sqrt() * draws.normal()).max(0.0) / self.range_dn;
            self.range_dn * noisy.powf(self.gamma) + self.read_dn * draws.normal()
        };
        (self.pedestal_dn + dn).round().clamp(0.0, self.highest) as u16
    }
}
