//! Smooth interpolation on a regular grid.

/// Values at the nodes of a grid, row-major; `NaN` where unknown.
///
/// Catmull-Rom cubic along rows and columns, with a continuous gradient; an unknown node makes
/// `NaN` up to two nodes around it.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Raster {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) values: Vec<f32>,
}

impl Raster {
    #[inline]
    pub(super) fn sample(&self, x: f32, y: f32) -> f32 {
        let Some((at, u, v)) = self.cell(x, y) else { return f32::NAN };
        let (wx, wy) = (weights(u), weights(v));
        let mut sum = 0.0;
        for (j, weight) in wy.into_iter().enumerate() {
            let row = &self.values[at + j * self.width..at + j * self.width + 4];
            sum += weight * (wx[0] * row[0] + wx[1] * row[1] + wx[2] * row[2] + wx[3] * row[3]);
        }
        sum
    }

    /// Value and gradient per node.
    #[inline]
    pub(super) fn sample_with_slopes(&self, x: f32, y: f32) -> [f32; 3] {
        let Some((at, u, v)) = self.cell(x, y) else { return [f32::NAN; 3] };
        let (wx, wy, sx, sy) = (weights(u), weights(v), slopes(u), slopes(v));
        let mut sums = [0.0; 3];
        for j in 0..4 {
            let row = &self.values[at + j * self.width..at + j * self.width + 4];
            let value = wx[0] * row[0] + wx[1] * row[1] + wx[2] * row[2] + wx[3] * row[3];
            let slope = sx[0] * row[0] + sx[1] * row[1] + sx[2] * row[2] + sx[3] * row[3];
            sums[0] += wy[j] * value;
            sums[1] += wy[j] * slope;
            sums[2] += sy[j] * value;
        }
        sums
    }

    /// Index of the first of the four by four surrounding nodes, and the position in their middle
    /// cell.
    #[inline]
    fn cell(&self, x: f32, y: f32) -> Option<(usize, f32, f32)> {
        let inside =
            x >= 1.0 && y >= 1.0 && x < self.width as f32 - 2.0 && y < self.height as f32 - 2.0;
        if !inside {
            return None;
        }
        let (i, j) = (x as usize, y as usize);
        Some(((j - 1) * self.width + i - 1, x - i as f32, y - j as f32))
    }
}

#[inline]
fn weights(u: f32) -> [f32; 4] {
    let (u2, u3) = (u * u, u * u * u);
    [
        -0.5 * u3 + u2 - 0.5 * u,
        1.5 * u3 - 2.5 * u2 + 1.0,
        -1.5 * u3 + 2.0 * u2 + 0.5 * u,
        0.5 * u3 - 0.5 * u2,
    ]
}

#[inline]
fn slopes(u: f32) -> [f32; 4] {
    let u2 = u * u;
    [-1.5 * u2 + 2.0 * u - 0.5, 4.5 * u2 - 5.0 * u, -4.5 * u2 + 4.0 * u + 0.5, 1.5 * u2 - u]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wave(x: f32, y: f32) -> f32 {
        (0.5 * x).sin() * (0.3 * y).cos()
    }

    #[test]
    fn a_wave_and_its_slopes_are_met_between_the_nodes() {
        let (width, height) = (30, 20);
        let values = (0..width * height).map(|i| wave((i % width) as f32, (i / width) as f32));
        let raster = Raster { width, height, values: values.collect() };
        for i in 0..400 {
            let (x, y) = (2.0 + 0.06 * i as f32, 2.0 + 0.037 * i as f32);
            let [value, dx, dy] = raster.sample_with_slopes(x, y);
            assert!((value - wave(x, y)).abs() < 4e-3 && value == raster.sample(x, y));
            assert!((dx - 0.5 * (0.5 * x).cos() * (0.3 * y).cos()).abs() < 0.02);
            assert!((dy + 0.3 * (0.5 * x).sin() * (0.3 * y).sin()).abs() < 0.02);
        }
    }

    #[test]
    fn outside_and_beside_a_gap_nothing_is_known() {
        let mut raster = Raster { width: 9, height: 9, values: vec![1.0; 81] };
        assert!(raster.sample(0.9, 4.0).is_nan() && raster.sample(4.0, 7.1).is_nan());
        assert!(raster.sample(f32::NAN, 4.0).is_nan());
        assert!((raster.sample(4.5, 4.5) - 1.0).abs() < 1e-6);
        raster.values[4 * 9 + 6] = f32::NAN;
        assert!(raster.sample(4.5, 4.5).is_nan());
        assert!(raster.sample(3.5, 4.5).is_finite());
    }
}
