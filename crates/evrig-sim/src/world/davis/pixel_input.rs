//! What an event pixel sees of the scene in a slab of time.

use super::slab_scene::{PixelBuffers, SlabScene};

/// What a pixel sees in a slab.
pub(super) enum PixelInput {
    /// Always the same.
    Same(f32),
    /// As in the scratch buffer, sample by sample.
    Varies,
}

/// Shares of white between which all lies that a pixel sees in a slab, and the last.
#[derive(Debug, Clone, Copy)]
pub(super) struct InputBounds {
    pub(super) low: f32,
    pub(super) high: f32,
    pub(super) last: f32,
}

/// Bounds from a few samples of what a pixel sees, widened for the times between them; none where
/// a shadow moves.
pub(super) fn input_bounds(pixel: usize, scene: &SlabScene<'_>) -> Option<InputBounds> {
    let (view, slab) = (scene.view, scene.slab);
    if scene.light.has_shadow() {
        return None;
    }
    let (ray, gain) = (view.rays[pixel], view.gains[pixel] / scene.white);
    let seen = |look: usize| {
        let texel = slab.samples[look].texel.at(ray);
        gain * view.texture.sample(texel[0], texel[1])
    };
    let n = slab.samples.len() - 1;
    let last = seen(n);
    if slab.is_still {
        return Some(InputBounds { low: last, high: last, last });
    }
    let (mut low, mut high) = (last, last);
    for look in (0..n).step_by(slab.stride) {
        let value = seen(look);
        low = low.min(value);
        high = high.max(value);
    }
    let spare =
        gain * scene.white * view.bend_per_px2 * (slab.stride_px * slab.stride_px / 8.0) as f32;
    Some(InputBounds { low: (low - spare).max(1e-9), high: high + spare, last })
}

/// What a pixel sees at each look of the slab, as a share of white.
pub(super) fn pixel_input(
    pixel: usize,
    scene: &SlabScene<'_>,
    scratch: &mut PixelBuffers,
) -> PixelInput {
    let (view, slab) = (scene.view, scene.slab);
    let (ray, gain) = (view.rays[pixel], view.gains[pixel] / scene.white);
    let texture = &view.texture;
    let first = slab.samples[0].texel.at(ray);
    let has_shadow = scene.light.has_shadow();
    if !has_shadow && (slab.is_still || sees_one_value(ray, scene)) {
        return PixelInput::Same(gain * texture.sample(first[0], first[1]));
    }
    scratch.seen.clear();
    for look in &slab.samples {
        let texel = look.texel.at(ray);
        let mut seen = gain * texture.sample(texel[0], texel[1]);
        if has_shadow {
            let [x, y] = view.mm_of_texel(texel);
            seen *= scene.light.left_by_shadow(x, y, slab.begin() + look.since) as f32;
        }
        scratch.seen.push(seen);
    }
    PixelInput::Varies
}

/// Whether all that the ray can meet in this slab is of one brightness.
fn sees_one_value(ray: [f32; 2], scene: &SlabScene<'_>) -> bool {
    let samples = &scene.slab.samples;
    let n = samples.len() - 1;
    let places = (0..=8).map(|eighth| samples[n * eighth / 8].texel.at(ray));
    scene.view.texture.is_flat_along(places)
}
