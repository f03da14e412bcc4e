//! What a frame's pixels gather while they see light.

use super::lamps::Lamps;
use super::scene::{CameraName, World};
use super::view::{CameraView, TexelFromRay};
use evrig_core::time::Span;
use std::sync::Arc;

/// The image moves less than this between two looks of one exposure, in pixels.
const MAX_STEP_PX: f64 = 0.25;

/// Most looks of one exposure.
const MAX_SAMPLES: f64 = 32.0;

/// One look of an exposure.
#[derive(Debug, Clone, Copy)]
struct ExposureSample {
    time_s: f64,
    texel: TexelFromRay,
    light: f32,
}

/// The looks of one exposure: at the middles of equal parts of it.
#[derive(Debug)]
pub(super) struct Exposure<'a> {
    view: &'a CameraView,
    world: &'a World,
    lamps: Arc<Lamps>,
    samples: Vec<ExposureSample>,
    /// The light of all looks together.
    light: f32,
}

/// How many looks an exposure needs, from how far the image moves in it and how the light pulsates.
pub(super) fn n_samples(
    world: &World,
    view: &CameraView,
    per_px: f64,
    start: Span,
    end: Span,
) -> usize {
    let middle = start + Span::from_nanos((end - start).as_nanos() / 2);
    let way: f64 = [[start, middle], [middle, end]]
        .map(|pair| {
            let [from, to] = pair.map(|t| view.texel_from_ray(&world.plane, world.true_pose(t)));
            let moved = view.outermost_rays().map(|ray| {
                let ([x0, y0], [x1, y1]) = (from.at(ray), to.at(ray));
                f64::from(x1 - x0).hypot(f64::from(y1 - y0))
            });
            moved.into_iter().fold(0.0, f64::max) / per_px
        })
        .iter()
        .sum();
    let seconds = (end - start).as_secs_f64();
    let swing_hz = world.swing.as_ref().map_or(0.0, |swing| swing.frequency_hz());
    let for_light = if world.lamps().light.is_steady(start.as_secs_f64(), end.as_secs_f64()) {
        1.0
    } else {
        8.0_f64.max(world.lamps().light.rate_hz() / 4.0 * seconds)
    };
    let for_swing = if way > 0.0 { 8.0 * swing_hz * seconds } else { 1.0 };
    (way / MAX_STEP_PX).max(for_light).max(for_swing).clamp(1.0, MAX_SAMPLES).ceil() as usize
}

impl<'a> Exposure<'a> {
    pub(super) fn new(
        world: &'a World,
        view: &'a CameraView,
        start: Span,
        end: Span,
        n_samples: usize,
    ) -> Self {
        let (begin, length) = (start.as_secs_f64(), (end - start).as_secs_f64());
        let lamps = world.lamps();
        let sample = |i: usize| {
            let time_s = begin + length * (i as f64 + 0.5) / n_samples as f64;
            ExposureSample {
                time_s,
                texel: view
                    .texel_from_ray(&world.plane, world.true_pose(Span::from_secs_f64(time_s))),
                light: lamps.light.level(time_s) as f32,
            }
        };
        let samples: Vec<ExposureSample> = (0..n_samples).map(sample).collect();
        let same = samples
            .windows(2)
            .all(|pair| pair[0].texel.is_same(&pair[1].texel) && pair[0].light == pair[1].light);
        let n_needed = if same && !lamps.light.has_shadow() { 1 } else { samples.len() };
        let samples = samples[..n_needed].to_vec();
        let light = samples.iter().map(|sample| sample.light).sum();
        Self { view, world, lamps, samples, light }
    }

    /// Mean light on a pixel, 1 where white in full light.
    pub(super) fn mean(&self, pixel: usize) -> f32 {
        let (ray, texture) = (self.view.rays[pixel], &self.view.texture);
        let light = &self.lamps.light;
        let white = self.world.target.white() as f32;
        let share = self.view.gains[pixel] / (white * self.samples.len() as f32);
        let n = self.samples.len() - 1;
        let few = [0, n / 2, n].map(|sample| self.samples[sample].texel.at(ray));
        // Most of a frame is bare paper, which one look shows.
        if n > 2 && !light.has_shadow() && texture.is_flat_along(few) {
            return share * self.light * texture.sample(few[0][0], few[0][1]);
        }
        let mut sum = 0.0;
        for sample in &self.samples {
            let texel = sample.texel.at(ray);
            let mut seen = sample.light * texture.sample(texel[0], texel[1]);
            if light.has_shadow() {
                let [x, y] = self.view.mm_of_texel(texel);
                seen *= light.left_by_shadow(x, y, sample.time_s) as f32;
            }
            sum += seen;
        }
        share * sum
    }
}

impl World {
    /// The light that a pixel truly gets at an instant, 1 where white in full light, free of noise.
    ///
    /// # Panics
    /// When the pixel does not lie on the sensor.
    #[must_use]
    pub fn light_on(&self, camera: CameraName, [x, y]: [u16; 2], time: Span) -> f32 {
        let view = self.view(camera);
        Exposure::new(self, view, time, time, 1).mean(view.camera.size.index(x, y))
    }
}
