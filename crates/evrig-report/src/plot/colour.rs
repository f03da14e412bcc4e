//! Colour scales for images: readable with any colour vision and in grey.

/// Red, green, blue, 8 bits each.
pub type Rgb = [u8; 3];

/// ON events over an image.
pub const ON: Rgb = [0xff, 0xd0, 0x45];
/// OFF events over an image; darker than ON.
pub const OFF: Rgb = [0x5c, 0xa8, 0xff];

/// Cividis: even lightness, readable with red-green blindness (anchors: Nuñez, Anderton and
/// Renslow, PLoS ONE 13, 2018).
const SEQUENTIAL: [Rgb; 7] = [
    [0, 32, 76],
    [31, 63, 110],
    [87, 93, 109],
    [124, 123, 120],
    [165, 156, 116],
    [211, 193, 100],
    [255, 233, 69],
];

/// Blue to orange; the middle is the page's background.
const DIVERGING_LIGHT: [Rgb; 7] = [
    [8, 48, 107],
    [49, 120, 184],
    [158, 199, 228],
    [250, 249, 246],
    [246, 190, 132],
    [214, 107, 22],
    [110, 42, 4],
];

/// The same for a dark page.
const DIVERGING_DARK: [Rgb; 7] = [
    [190, 224, 255],
    [92, 163, 230],
    [40, 84, 132],
    [21, 23, 27],
    [134, 74, 24],
    [232, 139, 54],
    [255, 221, 178],
];

/// Colour of a share in 0..=1 of the sequential scale; clamped, NaN is the low end.
#[must_use]
pub fn sequential(share: f64) -> Rgb {
    interpolate(&SEQUENTIAL, share)
}

/// Colour of a value in -1..=1 of the diverging scale, for a light page.
#[must_use]
pub fn diverging_light(value: f64) -> Rgb {
    interpolate(&DIVERGING_LIGHT, 0.5 + 0.5 * value)
}

/// Colour of a value in -1..=1 of the diverging scale, for a dark page.
#[must_use]
pub fn diverging_dark(value: f64) -> Rgb {
    interpolate(&DIVERGING_DARK, 0.5 + 0.5 * value)
}

fn interpolate(anchors: &[Rgb], share: f64) -> Rgb {
    let last = anchors.len() - 1;
    let share = if share.is_nan() { 0.0 } else { share.clamp(0.0, 1.0) };
    let position = share * last as f64;
    let below = (position as usize).min(last);
    let above = (below + 1).min(last);
    let weight = position - below as f64;
    std::array::from_fn(|i| {
        let (a, b) = (f64::from(anchors[below][i]), f64::from(anchors[above][i]));
        (a + (b - a) * weight).round() as u8
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Relative luminance of WCAG 2.1.
    fn luminance(colour: Rgb) -> f64 {
        let linear = colour.map(|v| {
            let v = f64::from(v) / 255.0;
            if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
        });
        0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]
    }

    #[test]
    fn the_sequential_scale_grows_lighter_all_the_way() {
        let steps: Vec<f64> =
            (0..=64).map(|i| luminance(sequential(f64::from(i) / 64.0))).collect();
        assert!(steps.windows(2).all(|pair| pair[0] < pair[1]));
    }

    #[test]
    fn distance_from_equal_shows_without_hue() {
        for i in 1..=20 {
            let (near, far) = (f64::from(i - 1) / 20.0, f64::from(i) / 20.0);
            for sign in [-1.0, 1.0] {
                assert!(
                    luminance(diverging_light(sign * far))
                        < luminance(diverging_light(sign * near))
                );
                assert!(
                    luminance(diverging_dark(sign * far)) > luminance(diverging_dark(sign * near))
                );
            }
        }
    }

    #[test]
    fn on_off_and_the_brightest_frame_pixel_differ_in_gray() {
        let frame = luminance([super::super::overlay::BRIGHTEST_GRAY; 3]);
        assert!((luminance(OFF) + 0.05) / (frame + 0.05) > 1.8);
        assert!((luminance(ON) + 0.05) / (luminance(OFF) + 0.05) > 1.6);
    }
}
