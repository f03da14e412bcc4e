//! What an event pixel sees of the scene in a slab of time.

use super::pixel::{Scene, Scratch};

/// What a pixel sees in a slab.
pub(super) enum Sight {
    /// Always the same.
    Same(f32),
    /// As the scratch says, look by look.
    Varies,
}

/// Shares of white between which all lies that a pixel sees in a slab, and the last.
#[derive(Debug, Clone, Copy)]
pub(super) struct Glimpse {
    pub(super) low: f32,
    pub(super) high: f32,
    pub(super) last: f32,
}

/// A few looks at what a pixel sees, with room for what lies between them; none where a shadow moves.
pub(super) fn glimpse(pixel: usize, scene: &Scene<'_>) -> Option<Glimpse> {
    let (view, slab) = (scene.view, scene.slab);
    if scene.light.has_shadow() {
        return None;
    }
    let (ray, gain) = (view.rays[pixel], view.gains[pixel] / scene.white);
    let seen = |look: usize| {
        let texel = slab.looks[look].texel.at(ray);
        gain * view.texture.sample(texel[0], texel[1])
    };
    let n = slab.looks.len() - 1;
    let last = seen(n);
    if slab.is_still {
        return Some(Glimpse { low: last, high: last, last });
    }
    let (mut low, mut high) = (last, last);
    for look in (0..n).step_by(slab.stride) {
        let value = seen(look);
        low = low.min(value);
        high = high.max(value);
    }
    let spare =
        gain * scene.white * view.bend_per_px2 * (slab.stride_px * slab.stride_px / 8.0) as f32;
    Some(Glimpse { low: (low - spare).max(1e-9), high: high + spare, last })
}

/// What a pixel sees at each look of the slab, as a share of white.
pub(super) fn sight(pixel: usize, scene: &Scene<'_>, scratch: &mut Scratch) -> Sight {
    let (view, slab) = (scene.view, scene.slab);
    let (ray, gain) = (view.rays[pixel], view.gains[pixel] / scene.white);
    let texture = &view.texture;
    let first = slab.looks[0].texel.at(ray);
    let has_shadow = scene.light.has_shadow();
    if !has_shadow && (slab.is_still || sees_one_value(ray, scene)) {
        return Sight::Same(gain * texture.sample(first[0], first[1]));
    }
    scratch.seen.clear();
    for look in &slab.looks {
        let texel = look.texel.at(ray);
        let mut seen = gain * texture.sample(texel[0], texel[1]);
        if has_shadow {
            let [x, y] = view.mm_of_texel(texel);
            seen *= scene.light.left_by_shadow(x, y, slab.begin() + look.since) as f32;
        }
        scratch.seen.push(seen);
    }
    Sight::Varies
}

/// Whether all that the ray can meet in this slab is of one brightness.
fn sees_one_value(ray: [f32; 2], scene: &Scene<'_>) -> bool {
    let looks = &scene.slab.looks;
    let n = looks.len() - 1;
    let places = (0..=8).map(|eighth| looks[n * eighth / 8].texel.at(ray));
    scene.view.texture.is_flat_along(places)
}
