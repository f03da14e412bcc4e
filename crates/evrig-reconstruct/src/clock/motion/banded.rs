//! Symmetric positive matrices of four diagonals: what cubic splines lead to.

/// The diagonal and the three above it, by row.
#[derive(Debug, Clone)]
pub(super) struct Banded {
    rows: Vec<[f64; 4]>,
}

/// Its lower triangular factor, by row: `rows[i][d]` couples `i` with `i - d`.
#[derive(Debug)]
pub(super) struct Factor {
    rows: Vec<[f64; 4]>,
}

impl Banded {
    pub(super) fn zeros(n: usize) -> Self {
        Self { rows: vec![[0.0; 4]; n] }
    }

    /// Adds `weight * b b^T` for four neighbouring entries `b` from `first` on.
    pub(super) fn add_outer(&mut self, first: usize, b: [f64; 4], weight: f64) {
        for (i, bi) in b.iter().enumerate() {
            for (j, bj) in b.iter().enumerate().skip(i) {
                self.rows[first + i][j - i] += weight * bi * bj;
            }
        }
    }

    pub(super) fn n(&self) -> usize {
        self.rows.len()
    }

    pub(super) fn mean_diagonal(&self) -> f64 {
        self.rows.iter().map(|row| row[0]).sum::<f64>() / self.rows.len() as f64
    }

    /// Cholesky factor. A pivot that is not positive is replaced by that of an undetermined entry;
    /// the curvature penalty prevents it.
    pub(super) fn factor(&self) -> Factor {
        let mut rows = vec![[0.0; 4]; self.rows.len()];
        for i in 0..rows.len() {
            for d in (0..=i.min(3)).rev() {
                let j = i - d;
                let mut sum = self.rows[j][d];
                for e in d + 1..=i.min(3) {
                    sum -= rows[i][e] * rows[j][e - d];
                }
                rows[i][d] =
                    if d > 0 { sum / rows[j][0] } else { sum.max(f64::MIN_POSITIVE.sqrt()).sqrt() };
            }
        }
        Factor { rows }
    }
}

impl Factor {
    pub(super) fn solve(&self, right: &mut [f64]) {
        let n = self.rows.len();
        for i in 0..n {
            for d in 1..=i.min(3) {
                right[i] -= self.rows[i][d] * right[i - d];
            }
            right[i] /= self.rows[i][0];
        }
        for i in (0..n).rev() {
            for d in 1..=(n - 1 - i).min(3) {
                right[i] -= self.rows[i + d][d] * right[i + d];
            }
            right[i] /= self.rows[i][0];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_solution_of_a_banded_system_solves_it() {
        let mut matrix = Banded::zeros(6);
        let parts = [[1.0, 2.0, 0.5, -1.0], [0.3, 1.0, 4.0, 2.0], [2.0, -1.0, 1.0, 3.0]];
        for (first, part) in parts.into_iter().enumerate() {
            matrix.add_outer(first, part, 1.5);
        }
        (0..6).for_each(|i| matrix.rows[i][0] += 1.0);
        let truth = [1.0, -2.0, 3.0, 0.5, 4.0, -1.0];
        let entry = |i: usize, j: usize| {
            let (low, high) = (i.min(j), i.max(j));
            if high - low > 3 { 0.0 } else { matrix.rows[low][high - low] }
        };
        let mut right: Vec<f64> =
            (0..6).map(|i| (0..6).map(|j| entry(i, j) * truth[j]).sum()).collect();
        matrix.factor().solve(&mut right);
        for (found, planted) in right.iter().zip(truth) {
            assert!((found - planted).abs() < 1e-12, "{found} {planted}");
        }
    }
}
