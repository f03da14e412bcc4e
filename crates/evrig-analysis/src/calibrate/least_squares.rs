//! Weighted linear least squares with few columns.

use nalgebra::{DMatrix, DVector};

/// The coefficients that minimise `sum w (y - x . b)^2` over rows (x, y, w); `None` where the
/// rows do not determine them.
pub(super) fn weighted<const P: usize>(
    rows: impl Iterator<Item = ([f64; P], f64, f64)>,
) -> Option<[f64; P]> {
    let (mut normal, mut right) = (DMatrix::zeros(P, P), DVector::zeros(P));
    for (x, y, w) in rows {
        for i in 0..P {
            right[i] += w * x[i] * y;
            for j in 0..P {
                normal[(i, j)] += w * x[i] * x[j];
            }
        }
    }
    let solution = solve(&normal, &right)?;
    let mut coefficients = [0.0; P];
    coefficients.copy_from_slice(solution.as_slice());
    Some(coefficients)
}

/// Ratio of singular values below which a direction counts as undetermined.
const SINGULAR: f64 = 1e-12;

/// Solves a small square system whose columns may differ in scale by many decades.
pub(super) fn solve(matrix: &DMatrix<f64>, right: &DVector<f64>) -> Option<DVector<f64>> {
    inverse(matrix).map(|inverse| inverse * right)
}

/// The inverse after scaling of rows and columns; `None` for a singular matrix.
pub(super) fn inverse(matrix: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let n = matrix.nrows();
    let scale: Vec<f64> = (0..n).map(|i| matrix[(i, i)].abs().sqrt()).collect();
    if scale.iter().any(|s| !(*s > 0.0 && s.is_finite())) {
        return None;
    }
    let scaled = DMatrix::from_fn(n, n, |i, j| matrix[(i, j)] / (scale[i] * scale[j]));
    let values = scaled.clone().singular_values();
    let (least, greatest) = (values.min(), values.max());
    if least.is_nan() || greatest.is_nan() || least <= SINGULAR * greatest {
        return None;
    }
    let inverse = scaled.try_inverse()?;
    Some(DMatrix::from_fn(n, n, |i, j| inverse[(i, j)] / (scale[i] * scale[j])))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_found_whatever_the_scales() {
        let rows = (0..9).map(|i| {
            let x = f64::from(i) * 1e-7;
            ([x, 1.0], 3e5 * x - 2.0, 1.0 + f64::from(i))
        });
        let [slope, intercept] = weighted(rows).unwrap();
        assert!((slope / 3e5 - 1.0).abs() < 1e-9 && (intercept + 2.0).abs() < 1e-9);
    }

    #[test]
    fn rows_at_one_place_determine_no_slope() {
        assert!(weighted((0..5).map(|i| ([2.0, 1.0], f64::from(i), 1.0))).is_none());
        assert!(weighted::<2>(std::iter::empty()).is_none());
    }
}
