//! Comparison of two small patches between the pixels of two frames.

use super::frame_view::FrameView;

/// Half the side of a compared patch, and its side, pixels.
pub(super) const PATCH_HALF_PX: usize = 2;
const PATCH_PX: usize = 2 * PATCH_HALF_PX + 1;

/// A patch of a frame around a position between pixels.
struct Patch<'a> {
    view: FrameView<'a>,
    place: [f32; 2],
    /// Index of its first pixel and the weights of the right and the lower neighbours, where all of
    /// them lie in the frame.
    inside: Option<(usize, [f32; 2])>,
}

impl<'a> Patch<'a> {
    fn around(view: FrameView<'a>, place: [f32; 2]) -> Self {
        let first = |at: f32, n: usize| {
            let first = at as usize;
            (at >= PATCH_HALF_PX as f32 && first + PATCH_HALF_PX + 1 < n)
                .then(|| (first - PATCH_HALF_PX, at - first as f32))
        };
        let inside = first(place[0], view.width())
            .zip(first(place[1], view.height()))
            .map(|((x, u), (y, v))| (y * view.width() + x, [u, v]));
        Self { view, place, inside }
    }

    fn row(&self, row: usize) -> [f32; PATCH_PX] {
        let Some((first, [u, v])) = self.inside else {
            let from_middle = |i: usize| i as f32 - PATCH_HALF_PX as f32;
            let [x, y] = [self.place[0], self.place[1] + from_middle(row)];
            return std::array::from_fn(|i| self.view.at([x + from_middle(i), y]));
        };
        let width = self.view.width();
        let line = |row: usize| &self.view.values[first + row * width..][..=PATCH_PX];
        let (upper, lower) = (line(row), line(row + 1));
        let across = |line: &[f32], i: usize| line[i] + (line[i + 1] - line[i]) * u;
        std::array::from_fn(|i| {
            let [upper, lower] = [across(upper, i), across(lower, i)];
            upper + (lower - upper) * v
        })
    }
}

/// Mean absolute difference of two patches if it is below `most`; most candidates are rejected
/// after the first rows.
pub(super) fn patch_difference(
    before: FrameView<'_>,
    after: FrameView<'_>,
    [from, to]: [[f32; 2]; 2],
    most: f32,
) -> Option<f32> {
    let n = (PATCH_PX * PATCH_PX) as f32;
    let (from, to) = (Patch::around(before, from), Patch::around(after, to));
    let mut sum = 0.0;
    for row in 0..PATCH_PX {
        let (a, b) = (from.row(row), to.row(row));
        sum += a.iter().zip(b).map(|(a, b)| (a - b).abs()).sum::<f32>();
        if sum >= most * n {
            return None;
        }
    }
    Some(sum / n)
}

#[cfg(test)]
mod tests {
    use super::*;
    use evrig_core::geometry::Size;

    #[test]
    fn a_patch_is_the_bilinear_image_inside_and_at_the_border() {
        let size = Size { width: 96, height: 80 };
        let values: Vec<f32> = (0..size.n_pixels())
            .map(|i| (0.4 * (i % 96) as f32).sin() + 0.01 * (i / 96) as f32)
            .collect();
        let view = FrameView { size, values: &values };
        for [x, y] in
            [[40.25, 30.5], [2.0, 2.0], [0.4, 1.7], [93.0, 77.0], [95.3, 79.9], [-3.0, 9.0]]
        {
            let patch = Patch::around(view, [x, y]);
            for row in 0..PATCH_PX {
                for (column, value) in patch.row(row).into_iter().enumerate() {
                    let at = |middle: f32, i: usize| middle + i as f32 - PATCH_HALF_PX as f32;
                    let expected = view.at([at(x, column), at(y, row)]);
                    assert!((value - expected).abs() < 1e-6, "{x} {y}: {value}, {expected}");
                }
            }
        }
    }
}
