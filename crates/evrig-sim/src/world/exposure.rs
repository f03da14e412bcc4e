//! What a frame's pixels gather while they see light.

use super::World;
use super::lamps::Lamps;
use super::view::{TexelFromRay, View};
use evrig_core::time::Span;
use std::sync::Arc;

/// The picture moves less than this between two looks of one exposure, in pixels.
const STEP_PX: f64 = 0.25;

/// Most looks of one exposure.
const MAX_LOOKS: f64 = 32.0;

/// One look of an exposure.
#[derive(Debug, Clone, Copy)]
struct Look {
    time_s: f64,
    texel: TexelFromRay,
    light: f32,
}

/// The looks of one exposure: at the middles of equal parts of it.
#[derive(Debug)]
pub(super) struct Exposure<'a> {
    view: &'a View,
    world: &'a World,
    lamps: Arc<Lamps>,
    looks: Vec<Look>,
    /// The light of all looks together.
    light: f32,
}

/// How many looks an exposure needs, from how far the picture moves in it and how the light pulsates.
pub(super) fn n_looks(world: &World, view: &View, per_px: f64, start: Span, end: Span) -> usize {
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
    (way / STEP_PX).max(for_light).max(for_swing).clamp(1.0, MAX_LOOKS).ceil() as usize
}

impl<'a> Exposure<'a> {
    pub(super) fn new(
        world: &'a World,
        view: &'a View,
        start: Span,
        end: Span,
        n_looks: usize,
    ) -> Self {
        let (begin, length) = (start.as_secs_f64(), (end - start).as_secs_f64());
        let lamps = world.lamps();
        let look = |i: usize| {
            let time_s = begin + length * (i as f64 + 0.5) / n_looks as f64;
            Look {
                time_s,
                texel: view
                    .texel_from_ray(&world.plane, world.true_pose(Span::from_secs_f64(time_s))),
                light: lamps.light.level(time_s) as f32,
            }
        };
        let looks: Vec<Look> = (0..n_looks).map(look).collect();
        let same = looks
            .windows(2)
            .all(|pair| pair[0].texel.is_same(&pair[1].texel) && pair[0].light == pair[1].light);
        let n_needed = if same && !lamps.light.has_shadow() { 1 } else { looks.len() };
        let looks = looks[..n_needed].to_vec();
        let light = looks.iter().map(|look| look.light).sum();
        Self { view, world, lamps, looks, light }
    }

    /// Mean light on a pixel, 1 where white in full light.
    pub(super) fn mean(&self, pixel: usize) -> f32 {
        let (ray, texture) = (self.view.rays[pixel], &self.view.texture);
        let light = &self.lamps.light;
        let white = self.world.print.white() as f32;
        let share = self.view.gains[pixel] / (white * self.looks.len() as f32);
        let n = self.looks.len() - 1;
        let few = [0, n / 2, n].map(|look| self.looks[look].texel.at(ray));
        // Most of a frame is bare paper, which one look shows.
        if n > 2 && !light.has_shadow() && texture.is_flat_along(few) {
            return share * self.light * texture.sample(few[0][0], few[0][1]);
        }
        let mut sum = 0.0;
        for look in &self.looks {
            let texel = look.texel.at(ray);
            let mut seen = look.light * texture.sample(texel[0], texel[1]);
            if light.has_shadow() {
                let [x, y] = self.view.mm_of_texel(texel);
                seen *= light.left_by_shadow(x, y, look.time_s) as f32;
            }
            sum += seen;
        }
        share * sum
    }
}
