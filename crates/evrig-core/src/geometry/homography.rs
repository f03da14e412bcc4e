//! Homographies: from one plane to another, fitted to points, with their error.

use nalgebra::{DMatrix, Matrix2, Matrix3, SMatrix, SymmetricEigen, Vector3};
use serde::{Deserialize, Serialize};

/// A projective map between two planes, defined up to a factor.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(from = "[[f64; 3]; 3]", into = "[[f64; 3]; 3]")]
pub struct Homography {
    matrix: Matrix3<f64>,
}

/// A homography with the covariance of its nine elements, row by row. The direction in which only
/// the common factor changes carries no meaning and drops out of everything that is derived.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UncertainHomography {
    /// The best map.
    pub homography: Homography,
    /// Covariance of its elements, row-major.
    pub covariance: SMatrix<f64, 9, 9>,
}

/// Why no homography could be fitted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum HomographyError {
    /// A homography has eight degrees of freedom.
    #[error("{0} points do not fix a homography; at least 4 are needed")]
    TooFewPoints(usize),
    /// Three points on a line, points that coincide, or numbers that are none.
    #[error("the points do not fix a homography: three of four lie on a line, or some coincide")]
    Degenerate,
}

/// A point and its image.
type PointPair = ([f64; 2], [f64; 2]);

impl From<[[f64; 3]; 3]> for Homography {
    fn from(rows: [[f64; 3]; 3]) -> Self {
        Self { matrix: Matrix3::from_fn(|row, column| rows[row][column]) }
    }
}

impl From<Homography> for [[f64; 3]; 3] {
    fn from(homography: Homography) -> Self {
        [0, 1, 2].map(|row| [0, 1, 2].map(|column| homography.matrix[(row, column)]))
    }
}

impl Homography {
    /// The homography of a matrix.
    #[must_use]
    pub fn from_matrix(matrix: Matrix3<f64>) -> Self {
        Self { matrix }
    }

    /// Its matrix.
    #[must_use]
    pub fn matrix(&self) -> &Matrix3<f64> {
        &self.matrix
    }

    /// The homography that takes each first point to its second: exact for four pairs, else of
    /// least algebraic error (the normalised direct linear transform; Hartley and Zisserman,
    /// "Multiple View Geometry", 2nd edition, algorithm 4.2).
    ///
    /// # Errors
    /// When the points are too few or do not fix it.
    pub fn fit(pairs: &[PointPair]) -> Result<Self, HomographyError> {
        if pairs.len() < 4 {
            return Err(HomographyError::TooFewPoints(pairs.len()));
        }
        let degenerate = HomographyError::Degenerate;
        let from = normalising(pairs.iter().map(|pair| pair.0)).ok_or(degenerate)?;
        let to = normalising(pairs.iter().map(|pair| pair.1)).ok_or(degenerate)?;
        // Nine rows at least, so that the decomposition holds the null vector of four pairs.
        let mut equations = DMatrix::zeros((2 * pairs.len()).max(9), 9);
        for (i, &(a, b)) in pairs.iter().enumerate() {
            let [x, y] = Self { matrix: from }.apply(a);
            let [u, v] = Self { matrix: to }.apply(b);
            let first = [x, y, 1.0, 0.0, 0.0, 0.0, -u * x, -u * y, -u];
            let second = [0.0, 0.0, 0.0, x, y, 1.0, -v * x, -v * y, -v];
            for column in 0..9 {
                equations[(2 * i, column)] = first[column];
                equations[(2 * i + 1, column)] = second[column];
            }
        }
        let svd = equations.svd(false, true);
        let rows = svd.v_t.ok_or(degenerate)?;
        let mut order: Vec<usize> = (0..9).collect();
        order.sort_by(|&a, &b| svd.singular_values[a].total_cmp(&svd.singular_values[b]));
        // A second null vector: the points leave freedom.
        if svd.singular_values[order[1]] <= 1e-9 * svd.singular_values[order[8]] {
            return Err(degenerate);
        }
        let normalised = Matrix3::from_fn(|row, column| rows[(order[0], 3 * row + column)]);
        let back = to.try_inverse().ok_or(degenerate)?;
        let matrix = back * normalised * from;
        let norm = matrix.norm();
        let is_sound = norm.is_finite() && normalised.determinant().abs() > 1e-9;
        is_sound.then(|| Self { matrix: matrix / norm }).ok_or(degenerate)
    }

    /// The image of a point; not finite for points that map to infinity.
    #[must_use]
    pub fn apply(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let image = self.matrix * Vector3::new(x, y, 1.0);
        [image.x / image.z, image.y / image.z]
    }

    /// The inverse; None when the matrix is singular.
    #[must_use]
    pub fn inverse(&self) -> Option<Self> {
        self.matrix.try_inverse().map(|matrix| Self { matrix })
    }

    /// This map and then another.
    #[must_use]
    pub fn then(&self, next: &Self) -> Self {
        Self { matrix: next.matrix * self.matrix }
    }

    /// Jacobian of the image with respect to the point.
    #[must_use]
    pub fn jacobian(&self, [x, y]: [f64; 2]) -> Matrix2<f64> {
        let image = self.matrix * Vector3::new(x, y, 1.0);
        let [u, v] = [image.x / image.z, image.y / image.z];
        let m = &self.matrix;
        Matrix2::new(
            m[(0, 0)] - u * m[(2, 0)],
            m[(0, 1)] - u * m[(2, 1)],
            m[(1, 0)] - v * m[(2, 0)],
            m[(1, 1)] - v * m[(2, 1)],
        ) / image.z
    }

    /// Jacobian of the image with respect to the nine elements.
    fn element_jacobian(&self, [x, y]: [f64; 2]) -> SMatrix<f64, 2, 9> {
        let image = self.matrix * Vector3::new(x, y, 1.0);
        let [u, v] = [image.x / image.z, image.y / image.z];
        let row = [x / image.z, y / image.z, 1.0 / image.z];
        let mut jacobian = SMatrix::zeros();
        for (column, part) in row.into_iter().enumerate() {
            jacobian[(0, column)] = part;
            jacobian[(1, 3 + column)] = part;
            jacobian[(0, 6 + column)] = -u * part;
            jacobian[(1, 6 + column)] = -v * part;
        }
        jacobian
    }
}

impl UncertainHomography {
    /// Fits pairs whose second points have the given covariances.
    ///
    /// # Errors
    /// When the points are too few or do not fix it.
    pub fn fit(pairs: &[(PointPair, Matrix2<f64>)]) -> Result<Self, HomographyError> {
        let points: Vec<PointPair> = pairs.iter().map(|(pair, _)| *pair).collect();
        let homography = Homography::fit(&points)?;
        let mut information = SMatrix::<f64, 9, 9>::zeros();
        for ((from, _), covariance) in pairs {
            let jacobian = homography.element_jacobian(*from);
            let weight = covariance.try_inverse().ok_or(HomographyError::Degenerate)?;
            information += jacobian.transpose() * weight * jacobian;
        }
        // The elements differ by orders of magnitude: bring them to one scale before inverting.
        let scale = information.diagonal().map(|d| if d > 0.0 { d.sqrt().recip() } else { 1.0 });
        let scale = SMatrix::<f64, 9, 9>::from_diagonal(&scale);
        let eigen = SymmetricEigen::new(scale * information * scale);
        let largest = eigen.eigenvalues.max();
        let inverted = eigen.eigenvalues.map(|v| if v > 1e-12 * largest { v.recip() } else { 0.0 });
        let vectors = scale * eigen.eigenvectors;
        let covariance = vectors * SMatrix::from_diagonal(&inverted) * vectors.transpose();
        Ok(Self { homography, covariance })
    }

    /// The image of a point, and its covariance.
    #[must_use]
    pub fn apply(&self, point: [f64; 2]) -> ([f64; 2], Matrix2<f64>) {
        let jacobian = self.homography.element_jacobian(point);
        (self.homography.apply(point), jacobian * self.covariance * jacobian.transpose())
    }

    /// The inverse with its covariance, d(H^-1) = -H^-1 dH H^-1; None when the matrix is singular.
    #[must_use]
    pub fn inverse(&self) -> Option<Self> {
        let homography = self.homography.inverse()?;
        let m = homography.matrix;
        let jacobian = SMatrix::<f64, 9, 9>::from_fn(|to, from| {
            -m[(to / 3, from / 3)] * m[(from % 3, to % 3)]
        });
        Some(Self { homography, covariance: jacobian * self.covariance * jacobian.transpose() })
    }
}

/// Shift and scale that bring points to mean zero and mean distance sqrt(2).
fn normalising(points: impl Iterator<Item = [f64; 2]> + Clone) -> Option<Matrix3<f64>> {
    let n = points.clone().count() as f64;
    let sum = points.clone().fold([0.0; 2], |sum, [x, y]| [sum[0] + x, sum[1] + y]);
    let [mx, my] = sum.map(|part| part / n);
    let distance: f64 = points.map(|[x, y]| (x - mx).hypot(y - my)).sum();
    let scale = std::f64::consts::SQRT_2 * n / distance;
    let matrix = Matrix3::new(scale, 0.0, -scale * mx, 0.0, scale, -scale * my, 0.0, 0.0, 1.0);
    scale.is_finite().then_some(matrix)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn planted(tilt: [f64; 2], turn: f64, shift: [f64; 2]) -> Homography {
        let (sin, cos) = turn.sin_cos();
        let [x, y] = shift;
        Homography::from([[cos, -1.2 * sin, x], [sin, 1.1 * cos, y], [tilt[0], tilt[1], 1.0]])
    }

    const CORNERS: [[f64; 2]; 4] = [[-1.0, 1.0], [1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]];

    proptest! {
        #[test]
        fn four_points_give_the_planted_map_back_and_its_inverse_undoes_it(
            p in -0.2..0.2_f64, q in -0.2..0.2_f64, turn in -3.0..3.0_f64, x in -300.0..300.0_f64,
        ) {
            let truth = planted([p, q], turn, [x, 50.0]);
            let found = Homography::fit(&CORNERS.map(|c| (c, truth.apply(c)))).unwrap();
            for point in [[3.0, -1.0], [0.2, 0.1], [-2.0, 1.5]] {
                let [a, b] = [truth.apply(point), found.apply(point)];
                prop_assert!((a[0] - b[0]).hypot(a[1] - b[1]) < 1e-6 * (1.0 + a[0].abs()));
                let back = found.inverse().unwrap().apply(b);
                prop_assert!((back[0] - point[0]).hypot(back[1] - point[1]) < 1e-6);
            }
        }
    }

    #[test]
    fn points_on_a_line_and_too_few_points_are_refused() {
        let line = [0.0, 1.0, 2.0, 3.0].map(|x| ([x, x], [x, 2.0 * x]));
        assert_eq!(Homography::fit(&line), Err(HomographyError::Degenerate));
        assert_eq!(Homography::fit(&line[..3]), Err(HomographyError::TooFewPoints(3)));
        let nan = CORNERS.map(|c| (c, [f64::NAN, 1.0]));
        assert_eq!(Homography::fit(&nan), Err(HomographyError::Degenerate));
    }

    #[test]
    fn the_stated_error_of_a_far_point_is_what_moving_the_corners_gives() {
        let truth = planted([0.05, -0.02], 0.4, [100.0, 80.0]);
        let spread = Matrix2::new(0.04, 0.01, 0.01, 0.02);
        let pairs = CORNERS.map(|c| ((c, truth.apply(c)), spread));
        let fitted = UncertainHomography::fit(&pairs).unwrap();
        let far = [-5.0, 1.0];
        // The exact map of four points is differentiated by moving each image a little.
        let mut expected = Matrix2::zeros();
        for corner in 0..4 {
            let step = 1e-5;
            let moved = |axis: usize| {
                let mut points = CORNERS.map(|c| (c, truth.apply(c)));
                points[corner].1[axis] += step;
                let there = Homography::fit(&points).unwrap().apply(far);
                let here = truth.apply(far);
                [(there[0] - here[0]) / step, (there[1] - here[1]) / step]
            };
            let [a, b] = [moved(0), moved(1)];
            let jacobian = Matrix2::new(a[0], b[0], a[1], b[1]);
            expected += jacobian * spread * jacobian.transpose();
        }
        let (_, stated) = fitted.apply(far);
        assert!((stated - expected).norm() < 1e-3 * expected.norm(), "{stated} {expected}");
        // The corners themselves get back the error that was put in.
        let (_, corner) = fitted.apply(CORNERS[2]);
        assert!((corner - spread).norm() < 1e-6);
        // There and back: the inverse's error at the image is the forward error brought back.
        let backward = fitted.inverse().unwrap();
        let (_, on_plane) = backward.apply(truth.apply(far));
        let pull = truth.inverse().unwrap().jacobian(truth.apply(far));
        assert!((on_plane - pull * expected * pull.transpose()).norm() < 1e-3 * on_plane.norm());
    }

    #[test]
    fn a_homography_is_three_rows_in_json() {
        let json = serde_json::to_string(&planted([0.0, 0.0], 0.0, [2.0, 3.0])).unwrap();
        assert_eq!(json, "[[1.0,-0.0,2.0],[0.0,1.1,3.0],[0.0,0.0,1.0]]");
        let back: Homography = serde_json::from_str(&json).unwrap();
        assert_eq!(back.apply([0.0, 1.0]), [2.0, 4.1]);
    }
}
