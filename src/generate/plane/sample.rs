//! A frame between its pixels.

use crate::frame::Luminance;

/// A frame that is looked up between its pixels by the cubic through four neighbours each way
/// (Catmull and Rom): exact at the pixels' middles, and nearly as sharp between them, so that the
/// contrast does not beat with the frames.
#[derive(Debug, Clone, Copy)]
pub(super) struct Picture<'a> {
    values: &'a [f32],
    width: usize,
    height: usize,
}

impl<'a> Picture<'a> {
    pub(super) fn new(frame: &'a Luminance) -> Self {
        let [width, height] = [frame.size.width, frame.size.height].map(usize::from);
        Self { values: &frame.values, width, height }
    }

    /// Brightness at a place, pixel `i` covering `i..i + 1`; none outside the frame. Beside the edge
    /// the outermost pixels go on.
    #[inline]
    pub(super) fn at(&self, [u, v]: [f64; 2]) -> Option<f32> {
        let is_inside = u >= 0.0 && v >= 0.0 && u < self.width as f64 && v < self.height as f64;
        if !is_inside {
            return None;
        }
        let (px, py) = (u - 0.5, v - 0.5);
        let (fx, fy) = (px.floor(), py.floor());
        let (wx, wy) = (weights((px - fx) as f32), weights((py - fy) as f32));
        let (x, y) = (fx as isize - 1, fy as isize - 1);
        let mut sum = 0.0;
        if x >= 0 && y >= 0 && x as usize + 4 <= self.width && y as usize + 4 <= self.height {
            let mut start = y as usize * self.width + x as usize;
            for wy in wy {
                let row = &self.values[start..start + 4];
                sum += wy * (wx[0] * row[0] + wx[1] * row[1] + wx[2] * row[2] + wx[3] * row[3]);
                start += self.width;
            }
        } else {
            for (j, wy) in wy.into_iter().enumerate() {
                let row = (y + j as isize).clamp(0, self.height as isize - 1) as usize * self.width;
                for (i, wx) in wx.into_iter().enumerate() {
                    let column = (x + i as isize).clamp(0, self.width as isize - 1) as usize;
                    sum += wy * wx * self.values[row + column];
                }
            }
        }
        // Beside a sharp edge the cubic swings below black.
        Some(sum.max(0.0))
    }
}

/// Catmull and Rom's weights of four neighbours at a share of the way from the second to the third.
fn weights(s: f32) -> [f32; 4] {
    let (s2, s3) = (s * s, s * s * s);
    [
        -0.5 * s + s2 - 0.5 * s3,
        1.0 - 2.5 * s2 + 1.5 * s3,
        0.5 * s + 2.0 * s2 - 1.5 * s3,
        -0.5 * s2 + 0.5 * s3,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Size;

    #[test]
    fn a_plane_of_light_is_met_everywhere_inside_and_nothing_is_known_outside() {
        let size = Size::new(9, 7);
        let values = (0..63).map(|i| 3.0 + 2.0 * (i % 9) as f32 + 5.0 * (i / 9) as f32).collect();
        let frame = Luminance { t_us: 0, size, values };
        let picture = Picture::new(&frame);
        for (u, v) in [(3.2, 2.9), (4.5, 3.5), (5.71, 4.33)] {
            let truth = 3.0 + 2.0 * (u - 0.5) + 5.0 * (v - 0.5);
            assert!((f64::from(picture.at([u, v]).unwrap()) - truth).abs() < 1e-4);
        }
        assert!((picture.at([0.5, 0.5]).unwrap() - 3.0).abs() < 1e-6);
        assert_eq!(picture.at([-0.01, 3.0]), None);
        assert_eq!(picture.at([3.0, 7.0]), None);
        assert_eq!(picture.at([f64::NAN, 3.0]), None);
    }
}
