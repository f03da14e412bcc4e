//! Time cut into slabs, and a slab into instants close enough that light is a straight line between
//! them.

use crate::world::scene::World;
use crate::world::view::TexelFromRay;
use evrig_core::time::Span;

/// Events are computed for so long at once.
pub(super) const SLAB: Span = Span::from_micros(10_000);

/// While the image moves it is looked at so often at least.
const MIN_RATE_HZ: f64 = 5_000.0;

/// And so often that it moves no farther than this between two looks, in pixels.
const MAX_STEP_PX: f64 = 0.05;

/// Between two of the looks by which a pixel is judged to be quiet, in pixels.
const STRIDE_PX: f64 = 0.2;

/// The image's speed exceeds its mean over a slab by no more than this factor.
const MAX_SPEED_RATIO: f64 = 2.0;

/// An image that moves less than this in a slab counts as static, in pixels.
const MAX_STILL_PX: f64 = 1e-6;

/// Most looks in a slab, so that an absurd speed costs no absurd memory.
const MAX_SAMPLES: f64 = 20_000.0;

/// One look at the scene.
#[derive(Debug, Clone, Copy)]
pub(super) struct SlabSample {
    /// Seconds since the slab's beginning.
    pub(super) since: f64,
    pub(super) texel: TexelFromRay,
    pub(super) light: f32,
}

/// What all pixels share of a slab.
#[derive(Debug)]
pub(super) struct Slab {
    /// Its number since the twin's beginning.
    pub(super) number: u64,
    pub(super) start: Span,
    /// At the beginning, at the end, and where needed between.
    pub(super) samples: Vec<SlabSample>,
    /// The camera does not move.
    pub(super) is_still: bool,
    /// The light does not change.
    pub(super) is_steady: bool,
    /// Every so many looks are enough to judge what a pixel may see, ...
    pub(super) stride: usize,
    /// ... between which the image moves by so many pixels at most.
    pub(super) stride_px: f64,
    /// Smallest number of intervals that the pixels' noise needs.
    pub(super) n_noise: usize,
}

impl Slab {
    /// Slab number `number` from `start` on; `noise_rate_hz` is how often the noise must be looked
    /// at.
    pub(super) fn new(world: &World, number: u64, start: Span, noise_rate_hz: f64) -> Self {
        let (begin, length) = (start.as_secs_f64(), SLAB.as_secs_f64());
        let at = |since: f64| world.true_pose(start + Span::from_secs_f64(since));
        let sample = |since: f64| SlabSample {
            since,
            texel: world.davis.texel_from_ray(&world.plane, at(since)),
            light: world.lamps().light.level(begin + since) as f32,
        };
        let coarse = (MIN_RATE_HZ * length).round() as usize;
        let probes: Vec<_> = (0..=coarse).map(|i| at(length * i as f64 / coarse as f64)).collect();
        let first = world.davis.texel_from_ray(&world.plane, probes[0]);
        let moves = probes.iter().any(|pose| *pose != probes[0])
            && probes.iter().any(|pose| {
                let now = world.davis.texel_from_ray(&world.plane, *pose);
                displacement_px(world, &first, &now) > MAX_STILL_PX
            });
        let is_steady = world.lamps().light.is_steady(begin, begin + length);
        let mut n = 1.0_f64;
        let way = if moves { way_px(world, &probes) } else { 0.0 };
        if moves {
            n = n.max(coarse as f64).max(way / MAX_STEP_PX);
            let swing_hz = world.swing.as_ref().map_or(0.0, |swing| swing.frequency_hz());
            n = n.max(40.0 * swing_hz * length);
        }
        if !is_steady {
            n = n.max(world.lamps().light.rate_hz() * length);
            n = n.max(if world.lamps().light.has_shadow() { coarse as f64 } else { 1.0 });
        }
        let n = n.min(MAX_SAMPLES).ceil() as usize;
        let mut times: Vec<f64> = (0..=n).map(|i| length * i as f64 / n as f64).collect();
        if !is_steady {
            let corners = world.lamps().light.corners(begin, begin + length);
            times.extend(corners.iter().map(|time| time - begin));
            times.sort_by(f64::total_cmp);
            times.dedup_by(|a, b| (*a - *b).abs() < 1e-9);
        }
        let per_look = MAX_SPEED_RATIO * way / n as f64;
        let stride = ((STRIDE_PX / per_look.max(1e-9)) as usize).clamp(1, n);
        Self {
            number,
            start,
            stride,
            stride_px: per_look * stride as f64,
            samples: times.into_iter().map(sample).collect(),
            is_still: !moves,
            is_steady,
            n_noise: (noise_rate_hz * length).min(MAX_SAMPLES).ceil() as usize,
        }
    }

    /// Seconds.
    pub(super) fn length(&self) -> f64 {
        SLAB.as_secs_f64()
    }

    /// World time of the beginning in seconds.
    pub(super) fn begin(&self) -> f64 {
        self.start.as_secs_f64()
    }
}

/// How far the image moved between two looks, where it moved most.
fn displacement_px(world: &World, from: &TexelFromRay, to: &TexelFromRay) -> f64 {
    let rays = world.davis.outermost_rays();
    let texels = rays.map(|ray| {
        let ([x0, y0], [x1, y1]) = (from.at(ray), to.at(ray));
        f64::from(x1 - x0).hypot(f64::from(y1 - y0))
    });
    texels.into_iter().fold(0.0, f64::max) / crate::world::view::DAVIS_TEXELS_PER_PX
}

/// The image's way along all probes.
fn way_px(world: &World, probes: &[evrig_session::rig::Pose]) -> f64 {
    let texel = |pose| world.davis.texel_from_ray(&world.plane, pose);
    let stride = (probes.len() / 5).max(1);
    let few: Vec<_> = probes.iter().step_by(stride).map(|pose| texel(*pose)).collect();
    few.windows(2).map(|pair| displacement_px(world, &pair[0], &pair[1])).sum()
}
