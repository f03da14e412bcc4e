//! Bounding rectangle of the pixels that a moving square can touch within one step of its path.

use evrig_core::geometry::Size;

/// Margin for rounding in single precision, pixels.
const MARGIN_PX: f64 = 1.0;

/// Corner displacement per step above which all pixels are tested.
const MAX_DISPLACEMENT_PX: f64 = 16.0;

/// First column and row, and the number of each.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct PixelBounds {
    first: [u16; 2],
    n: [u16; 2],
}

/// Range of the undistorted x in each column and of the undistorted y in each row.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct IdealRanges {
    columns: Vec<[f32; 2]>,
    rows: Vec<[f32; 2]>,
}

impl IdealRanges {
    /// Of undistorted pixels, row-major.
    pub(super) fn new(size: Size, ideal: &[[f32; 2]]) -> Self {
        let (width, height) = (usize::from(size.width), usize::from(size.height));
        let nowhere = [f32::INFINITY, f32::NEG_INFINITY];
        let (mut columns, mut rows) = (vec![nowhere; width], vec![nowhere; height]);
        for (i, place) in ideal.iter().enumerate() {
            // min and max ignore NaN.
            for (range, part) in
                [(&mut columns[i % width], place[0]), (&mut rows[i / width], place[1])]
            {
                *range = [range[0].min(part), range[1].max(part)];
            }
        }
        Self { columns, rows }
    }
}

impl PixelBounds {
    pub(super) const fn all(size: Size) -> Self {
        Self { first: [0; 2], n: [size.width, size.height] }
    }

    /// Pixels that can lie within `half` of the square's middle during a step with homography `at`
    /// and its `change`; `ranges` for a lens with distortion.
    pub(super) fn new(
        size: Size,
        [at, change]: [[f32; 9]; 2],
        half: f32,
        ranges: Option<&IdealRanges>,
    ) -> Self {
        let then: [f32; 9] = std::array::from_fn(|i| at[i] + change[i]);
        let (Some(from), Some(to)) = (corners(at, half), corners(then, half)) else {
            return Self::all(size);
        };
        let displacements = from.iter().zip(&to).map(|(a, b)| (a[0] - b[0]).hypot(a[1] - b[1]));
        let displacement = displacements.fold(0.0, f64::max);
        if displacement.is_nan() || displacement > MAX_DISPLACEMENT_PX {
            return Self::all(size);
        }
        let both = || from.iter().chain(&to);
        let margin = 2.0 * displacement + MARGIN_PX;
        let range = |axis: usize| {
            let low = both().map(|corner| corner[axis]).fold(f64::INFINITY, f64::min);
            let high = both().map(|corner| corner[axis]).fold(f64::NEG_INFINITY, f64::max);
            [low - margin, high + margin]
        };
        let side = [size.width, size.height];
        let ends = |axis: usize| match ranges {
            None => inside(range(axis), side[axis]),
            Some(IdealRanges { columns, rows }) => intersecting(range(axis), [columns, rows][axis]),
        };
        let [columns, rows] = [ends(0), ends(1)];
        Self { first: [columns.0, rows.0], n: [columns.1, rows.1] }
    }

    #[inline(always)]
    pub(super) fn holds(&self, x: u16, y: u16) -> bool {
        (x.wrapping_sub(self.first[0]) < self.n[0]) & (y.wrapping_sub(self.first[1]) < self.n[1])
    }
}

/// Corners of a square of half side `half`, relative to the middle of the frame; none at or behind
/// the horizon.
fn corners(numbers: [f32; 9], half: f32) -> Option<[[f64; 2]; 4]> {
    let matrix = nalgebra::Matrix3::from_row_slice(&numbers.map(f64::from));
    let back = matrix.try_inverse()?;
    let h = f64::from(half);
    let mut found = [[0.0; 2]; 4];
    for (place, [u, v]) in found.iter_mut().zip([[-h, -h], [h, -h], [h, h], [-h, h]]) {
        let q = back * nalgebra::Vector3::new(u, v, 1.0);
        if q.z.is_nan() || q.z <= 0.0 {
            return None;
        }
        *place = [q.x / q.z, q.y / q.z];
    }
    Some(found)
}

/// First and number of pixels with middles in a range relative to the middle of `side` pixels.
fn inside([low, high]: [f64; 2], side: u16) -> (u16, u16) {
    let middle = f64::from(side) / 2.0 - 0.5;
    let first = (low + middle).ceil().clamp(0.0, f64::from(side)) as u16;
    let end = ((high + middle).floor() + 1.0).clamp(0.0, f64::from(side)) as u16;
    (first, end.saturating_sub(first))
}

/// First and number of columns or rows whose undistorted range intersects a range.
fn intersecting([low, high]: [f64; 2], ranges: &[[f32; 2]]) -> (u16, u16) {
    let meets = |[from, to]: &[f32; 2]| f64::from(*to) >= low && f64::from(*from) <= high;
    let first = ranges.iter().position(meets).unwrap_or(ranges.len());
    let end = ranges.iter().rposition(meets).map_or(first, |last| last + 1);
    (first as u16, (end - first) as u16)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: Size = Size::new(40, 30);
    /// A square of ten pixels in the middle of the frame.
    const SQUARE: [f32; 9] = [0.1, 0.0, 0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 1.0];

    #[test]
    fn the_rectangle_holds_the_square_and_a_pixel_more_on_its_way() {
        // It moves two pixels to the right: its own displacement is allowed for twice.
        let change = [0.0, 0.0, -0.2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        let near = PixelBounds::new(SIZE, [SQUARE, change], 0.5, None);
        assert_eq!((near.first, near.n), ([10, 5], [22, 20]));
        assert!(near.holds(10, 5) && near.holds(31, 24));
        assert!(!near.holds(9, 10) && !near.holds(32, 10) && !near.holds(20, 25));
    }

    #[test]
    fn a_bent_image_is_searched_by_where_its_pixels_lie() {
        // Twice as large about the middle: half as many pixels hold the square.
        let ideal: Vec<[f32; 2]> = (0..SIZE.n_pixels())
            .map(|i| [(i % 40) as f32 - 19.5, (i / 40) as f32 - 14.5].map(|part| 2.0 * part))
            .collect();
        let near =
            PixelBounds::new(SIZE, [SQUARE, [0.0; 9]], 0.5, Some(&IdealRanges::new(SIZE, &ideal)));
        assert_eq!((near.first, near.n), ([17, 12], [6, 6]));
    }

    #[test]
    fn a_square_that_leaps_or_lies_on_the_horizon_may_be_anywhere() {
        let leap = [0.0, 0.0, -9.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        assert_eq!(PixelBounds::new(SIZE, [SQUARE, leap], 0.5, None), PixelBounds::all(SIZE));
        let horizon = [0.1, 0.0, 0.0, 0.0, 0.1, 0.0, 0.3, 0.0, 1.0];
        assert_eq!(PixelBounds::new(SIZE, [horizon, [0.0; 9]], 5.0, None), PixelBounds::all(SIZE));
        let outside = [0.1, 0.0, -10.0, 0.0, 0.1, 0.0, 0.0, 0.0, 1.0];
        let near = PixelBounds::new(SIZE, [outside, [0.0; 9]], 0.5, None);
        assert!((0..40).all(|x| (0..30).all(|y| !near.holds(x, y))));
    }
}
