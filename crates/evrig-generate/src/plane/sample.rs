//! A frame between its pixels.

use evrig_core::frame::Luminance;
use wide::f32x4;

/// A frame that is looked up between its pixels by the cubic through four neighbours each way
/// (Catmull and Rom): exact at the pixels' middles, and nearly as sharp between them, so that the
/// contrast does not beat with the frames.
#[derive(Debug, Clone, Copy)]
pub(super) struct CubicSampler<'a> {
    values: &'a [f32],
    width: usize,
    height: usize,
}

impl<'a> CubicSampler<'a> {
    pub(super) fn new(frame: &'a Luminance) -> Self {
        let [width, height] = [frame.size.width, frame.size.height].map(usize::from);
        Self { values: &frame.values, width, height }
    }

    /// Brightness at a place, pixel `i` covering `i..i + 1`; none outside the frame. Beside the
    /// edge the outermost pixels go on.
    #[inline(always)]
    pub(super) fn at(&self, [u, v]: [f32; 2]) -> Option<f32> {
        let is_inside = u >= 0.0 && v >= 0.0 && u < self.width as f32 && v < self.height as f32;
        if !is_inside {
            return None;
        }
        // Middles lie at halves; raised by one, so that cutting off is rounding down.
        let (px, py) = (u + 0.5, v + 0.5);
        let (column, row) = (px as i32, py as i32);
        let share = [px - column as f32, py - row as f32];
        // The first of four neighbours; beside the left and upper edge a number beyond all others.
        let (x, y) = ((column - 2) as u32 as usize, (row - 2) as u32 as usize);
        if x + 4 > self.width || y + 4 > self.height {
            return Some(self.beside_edge([column - 2, row - 2], share));
        }
        let (start, width) = (y * self.width + x, self.width);
        let rows = &self.values[start..start + 3 * width + 4];
        let row = |j: usize| rows[j * width..j * width + 4].try_into().unwrap_or_default();
        Some(blend([row(0), row(1), row(2), row(3)], share))
    }

    #[cold]
    fn beside_edge(&self, [x, y]: [i32; 2], share: [f32; 2]) -> f32 {
        let within = |at: i32, side: usize| (at.max(0) as usize).min(side - 1);
        let row = |j: i32| {
            let start = within(y + j, self.height) * self.width;
            [0, 1, 2, 3].map(|i| self.values[start + within(x + i, self.width)])
        };
        blend([row(0), row(1), row(2), row(3)], share)
    }
}

/// The cubic through four rows of four neighbours. Beside a sharp edge it swings below black.
#[inline(always)]
fn blend(rows: [[f32; 4]; 4], [right, down]: [f32; 2]) -> f32 {
    let across = weights(down).to_array();
    let [a, b, c, d] = [0, 1, 2, 3].map(|j| f32x4::new(rows[j]) * f32x4::splat(across[j]));
    let parts = (((a + b) + (c + d)) * weights(right)).to_array();
    ((parts[0] + parts[1]) + (parts[2] + parts[3])).max(0.0)
}

/// Catmull and Rom's weights of four neighbours at a share of the way from the second to the third.
#[inline]
fn weights(s: f32) -> f32x4 {
    const POWERS: [f32x4; 4] = [
        f32x4::new([0.0, 1.0, 0.0, 0.0]),
        f32x4::new([-0.5, 0.0, 0.5, 0.0]),
        f32x4::new([1.0, -2.5, 2.0, -0.5]),
        f32x4::new([-0.5, 1.5, -1.5, 0.5]),
    ];
    let s = f32x4::splat(s);
    POWERS[0] + s * (POWERS[1] + s * (POWERS[2] + s * POWERS[3]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use evrig_core::geometry::Size;

    #[test]
    fn a_plane_of_light_is_met_everywhere_inside_and_nothing_is_known_outside() {
        let size = Size::new(9, 7);
        let values = (0..63).map(|i| 3.0 + 2.0 * (i % 9) as f32 + 5.0 * (i / 9) as f32).collect();
        let frame = Luminance { t_us: 0, size, values };
        let image = CubicSampler::new(&frame);
        for (u, v) in [(3.2, 2.9), (4.5, 3.5), (5.71, 4.33)] {
            let truth = 3.0 + 2.0 * (u - 0.5) + 5.0 * (v - 0.5);
            assert!((image.at([u, v]).unwrap() - truth).abs() < 1e-4);
        }
        assert!((image.at([0.5, 0.5]).unwrap() - 3.0).abs() < 1e-6);
        assert_eq!(image.at([-0.01, 3.0]), None);
        assert_eq!(image.at([3.0, 7.0]), None);
        assert_eq!(image.at([f32::NAN, 3.0]), None);
    }
}
