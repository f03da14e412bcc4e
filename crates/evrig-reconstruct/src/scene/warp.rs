//! A homography with its derivatives by some parameters.

use nalgebra::Matrix3;

/// Homography from rays to positions with derivatives by `N` parameters.
#[derive(Debug, Clone, Copy)]
pub(super) struct Warp<const N: usize> {
    matrix: [f64; 9],
    slopes: [[f64; 9]; N],
}

impl<const N: usize> Warp<N> {
    /// The homography `of` at zero and its central differences; None where one is missing.
    pub(super) fn new(
        steps: &[f64; N],
        of: impl Fn(&[f64; N]) -> Option<Matrix3<f64>>,
    ) -> Option<Self> {
        let here = of(&[0.0; N])?;
        let mut slopes = [[0.0; 9]; N];
        for (i, slope) in slopes.iter_mut().enumerate() {
            let mut change = [0.0; N];
            change[i] = steps[i];
            let there = of(&change)?;
            change[i] = -steps[i];
            let back = of(&change)?;
            *slope = row_major(&((there - back) / (2.0 * steps[i])));
        }
        Some(Self { matrix: row_major(&here), slopes })
    }

    /// Linear interpolation towards a nearby homography.
    #[inline]
    pub(super) fn blend(&self, other: &Self, part: f64) -> Self {
        let mix = |a: &[f64; 9], b: &[f64; 9]| std::array::from_fn(|i| a[i] + (b[i] - a[i]) * part);
        Self {
            matrix: mix(&self.matrix, &other.matrix),
            slopes: std::array::from_fn(|i| mix(&self.slopes[i], &other.slopes[i])),
        }
    }

    /// Position of a ray and its derivatives by each parameter.
    #[inline]
    pub(super) fn slopes(&self, ray: [f64; 2]) -> ([f64; 2], [[f64; 2]; N]) {
        let [a, b, w] = product(&self.matrix, ray);
        let over = 1.0 / w;
        let place = [a * over, b * over];
        let moved = self.slopes.map(|slope| {
            let [da, db, dw] = product(&slope, ray);
            [(da - place[0] * dw) * over, (db - place[1] * dw) * over]
        });
        (place, moved)
    }

    /// Derivatives of the position by both components of the ray.
    #[inline]
    pub(super) fn by_ray(&self, ray: [f64; 2]) -> [[f64; 2]; 2] {
        let [a, b, w] = product(&self.matrix, ray);
        let m = &self.matrix;
        let (x, y) = (a / w, b / w);
        [0, 1].map(|i| [(m[i] - x * m[6 + i]) / w, (m[3 + i] - y * m[6 + i]) / w])
    }
}

pub(super) fn row_major(matrix: &Matrix3<f64>) -> [f64; 9] {
    std::array::from_fn(|i| matrix[(i / 3, i % 3)])
}

#[inline]
fn product(m: &[f64; 9], [u, v]: [f64; 2]) -> [f64; 3] {
    [m[0] * u + m[1] * v + m[2], m[3] * u + m[4] * v + m[5], m[6] * u + m[7] * v + m[8]]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slopes_are_what_moving_the_parameters_and_the_ray_gives() {
        let of = |by: &[f64; 2]| {
            Some(Matrix3::new(
                200.0,
                3.0 + by[0],
                5.0,
                -3.0,
                190.0,
                7.0 + by[1] * by[1] + by[1],
                0.01,
                0.1 * by[0],
                1.0,
            ))
        };
        let warp = Warp::new(&[1e-4, 1e-4], of).unwrap();
        let ray = [0.1, -0.2];
        let (here, slopes) = warp.slopes(ray);
        for i in 0..2 {
            let mut by = [0.0; 2];
            by[i] = 1e-6;
            let there = Warp::<0>::new(&[], |_| of(&by)).unwrap().slopes(ray).0;
            for axis in 0..2 {
                let slope = (there[axis] - here[axis]) / 1e-6;
                assert!((slope - slopes[i][axis]).abs() < 1e-4, "{slope} {}", slopes[i][axis]);
            }
            let mut moved = ray;
            moved[i] += 1e-6;
            let there = warp.slopes(moved).0;
            let slope = (there[0] - here[0]) / 1e-6;
            assert!((slope - warp.by_ray(ray)[i][0]).abs() < 1e-3);
        }
    }
}
