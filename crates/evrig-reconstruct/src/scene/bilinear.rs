//! Bilinear interpolation on an image.

/// Indices of the four neighbouring pixels in a row-major image, with their weights.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct BilinearWeights(pub(super) [(usize, f32); 4]);

impl BilinearWeights {
    /// At a position in pixels from the middle of the first pixel; positions beyond the border are
    /// clamped.
    #[inline]
    pub(super) fn at([width, height]: [usize; 2], [x, y]: [f32; 2]) -> Self {
        let ([x0, x1], u) = neighbours(x, width);
        let ([y0, y1], v) = neighbours(y, height);
        let [y0, y1] = [y0 * width, y1 * width];
        Self([
            (y0 + x0, (1.0 - u) * (1.0 - v)),
            (y0 + x1, u * (1.0 - v)),
            (y1 + x0, (1.0 - u) * v),
            (y1 + x1, u * v),
        ])
    }

    #[inline]
    pub(super) fn value(&self, values: &[f32]) -> f32 {
        self.0.iter().map(|(pixel, weight)| values[*pixel] * weight).sum()
    }

    /// The greatest of the neighbours with a positive weight.
    pub(super) fn max_value(&self, values: &[f32]) -> f32 {
        let seen = self.0.iter().filter(|(_, weight)| *weight > 0.0);
        seen.map(|(pixel, _)| values[*pixel]).fold(f32::NEG_INFINITY, f32::max)
    }
}

/// The two neighbours among `n` pixels, and the distance from the first.
#[inline]
pub(super) fn neighbours(at: f32, n: usize) -> ([usize; 2], f32) {
    let inside = at.clamp(0.0, (n - 1) as f32);
    // A cast truncates inline; `floor` would be a function call for every look-up.
    let first = inside as usize;
    ([first, (first + 1).min(n - 1)], inside - first as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plane_is_read_back_inside_and_the_border_goes_on_beyond() {
        let values: Vec<f32> = (0..12).map(|i| (i % 4) as f32 + 10.0 * (i / 4) as f32).collect();
        let at = |place| BilinearWeights::at([4, 3], place).value(&values);
        for (place, expected) in
            [([1.25, 0.5], 6.25), ([3.0, 2.0], 23.0), ([-5.0, 1.0], 10.0), ([9.0, 9.5], 23.0)]
        {
            assert!((at(place) - expected).abs() < 1e-5, "{place:?}: {}", at(place));
        }
    }

    #[test]
    fn the_greatest_is_of_those_that_weigh() {
        let values = [1.0, 9.0, 2.0, 9.0];
        let max_value = |place| BilinearWeights::at([2, 2], place).max_value(&values);
        assert_eq!([[0.0, 0.5], [0.1, 0.5]].map(max_value), [2.0, 9.0]);
    }
}
