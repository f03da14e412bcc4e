//! Normal equations of path, geometry and time, and elimination of the path.
//!
//! The path's coefficients couple only to their neighbours and to six parameters. They are
//! eliminated (Schur complement), which leaves the Fisher information of the six with the path
//! unknown.

use super::banded::{Banded, Factor};
use super::path::{Basis, PathSpline, add_gap_penalty, bends};
use nalgebra::{SMatrix, SVector};

/// tau, kappa, ln(scale), roll, shift x, shift y.
pub(super) const N: usize = 6;
pub(super) const TAU: usize = 0;
pub(super) const KAPPA: usize = 1;
pub(super) const LN_SCALE: usize = 2;
pub(super) const ROLL: usize = 3;

pub(super) type Information = SMatrix<f64, N, N>;

#[derive(Debug, Clone)]
pub(super) struct MotionState {
    pub(super) path: PathSpline,
    pub(super) theta: SVector<f64, N>,
    pub(super) centre: [f64; 2],
}

pub(super) struct MotionEquations {
    normal: Banded,
    right: [Vec<f64>; 2],
    border: [Vec<SVector<f64, N>>; 2],
    pub(super) corner: Information,
    pub(super) corner_right: SVector<f64, N>,
}

pub(super) struct ReducedMotion {
    pub(super) factor: Factor,
    pub(super) information: Information,
    pub(super) right: SVector<f64, N>,
    /// `A^-1` times the border, by coefficient.
    leverage: [Vec<SVector<f64, N>>; 2],
    /// `A^-1` times the right-hand side.
    path_step: [Vec<f64>; 2],
}

/// Derivatives of the tag's position in the other camera.
pub(super) struct ImageJacobian {
    /// Derivatives of x and y by the six parameters.
    pub(super) by: [SVector<f64, N>; 2],
    /// Linear part of the map from path to image.
    pub(super) matrix: [[f64; 2]; 2],
}

impl ImageJacobian {
    pub(super) fn new(state: &MotionState, since_s: f64, basis: &Basis) -> Self {
        let m = state.matrix();
        let q = state.path.position(basis);
        let seen = apply(m, [q[0] - state.centre[0], q[1] - state.centre[1]]);
        let speed = apply(m, state.path.velocity(basis));
        let by = [
            SVector::<f64, N>::from([speed[0], speed[0] * since_s, seen[0], -seen[1], 1.0, 0.0]),
            SVector::<f64, N>::from([speed[1], speed[1] * since_s, seen[1], seen[0], 0.0, 1.0]),
        ];
        Self { by, matrix: m }
    }
}

impl ReducedMotion {
    /// Score of the six parameters for a residual on the path, with the path eliminated.
    pub(super) fn score(&self, basis: &Basis, pull: [f64; 2]) -> SVector<f64, N> {
        let mut score = SVector::zeros();
        for (leverage, pull) in self.leverage.iter().zip(pull) {
            for (own, b) in leverage[basis.first..].iter().zip(basis.value) {
                score -= own * (b * pull);
            }
        }
        score
    }
}

impl MotionState {
    /// Linear part of the map from path to image.
    pub(super) fn matrix(&self) -> [[f64; 2]; 2] {
        let scale = self.theta[LN_SCALE].exp();
        let (sin, cos) = self.theta[ROLL].sin_cos();
        [[scale * cos, -scale * sin], [scale * sin, scale * cos]]
    }

    pub(super) fn place(&self, t_s: f64, middle_s: f64) -> Basis {
        self.path.basis(t_s + self.theta[TAU] + self.theta[KAPPA] * (t_s - middle_s))
    }
}

pub(super) fn apply(m: [[f64; 2]; 2], v: [f64; 2]) -> [f64; 2] {
    [m[0][0] * v[0] + m[0][1] * v[1], m[1][0] * v[0] + m[1][1] * v[1]]
}

impl MotionEquations {
    pub(super) fn new(n: usize) -> Self {
        Self {
            normal: Banded::zeros(n),
            right: [vec![0.0; n], vec![0.0; n]],
            border: [vec![SVector::zeros(); n], vec![SVector::zeros(); n]],
            corner: Information::zeros(),
            corner_right: SVector::zeros(),
        }
    }

    pub(super) fn add_reference(&mut self, basis: &Basis, r: [f64; 2], w: f64) {
        self.normal.add_outer(basis.first, basis.value, w);
        for (axis, right) in self.right.iter_mut().enumerate() {
            for (i, b) in basis.value.iter().enumerate() {
                right[basis.first + i] += w * b * r[axis];
            }
        }
    }

    pub(super) fn add_other(
        &mut self,
        jacobian: &ImageJacobian,
        basis: &Basis,
        r: [f64; 2],
        w: f64,
    ) {
        let ImageJacobian { by, matrix: m } = jacobian;
        let scale2 = m[0][0] * m[0][0] + m[1][0] * m[1][0];
        self.normal.add_outer(basis.first, basis.value, w * scale2);
        for axis in [0, 1] {
            let column = [m[0][axis], m[1][axis]];
            let coupling = (by[0] * column[0] + by[1] * column[1]) * w;
            let pull = w * (column[0] * r[0] + column[1] * r[1]);
            for (i, b) in basis.value.iter().enumerate() {
                self.right[axis][basis.first + i] += b * pull;
                self.border[axis][basis.first + i] += coupling * *b;
            }
            self.corner += by[axis] * by[axis].transpose() * w;
            self.corner_right += by[axis] * (w * r[axis]);
        }
    }

    pub(super) fn add_penalty(&mut self, path: &PathSpline) {
        let weight = add_gap_penalty(&mut self.normal);
        for (right, c) in self.right.iter_mut().zip(&path.c) {
            for (first, bend) in bends(c.len()) {
                let size: f64 = bend.iter().zip(&c[first..]).map(|(b, c)| b * c).sum();
                for (i, b) in bend.iter().enumerate() {
                    right[first + i] -= weight * b * size;
                }
            }
        }
    }

    pub(super) fn fix(&mut self, index: usize) {
        self.border.iter_mut().flatten().for_each(|border| border[index] = 0.0);
        self.corner.row_mut(index).fill(0.0);
        self.corner.column_mut(index).fill(0.0);
        self.corner[(index, index)] = 1.0;
        self.corner_right[index] = 0.0;
    }

    pub(super) fn reduce(self) -> ReducedMotion {
        let factor = self.normal.factor();
        let (mut information, mut right) = (self.corner, self.corner_right);
        let mut path_step = self.right.clone();
        path_step.iter_mut().for_each(|step| factor.solve(step));
        let mut leverage = self.border.clone();
        for (own, border) in leverage.iter_mut().zip(&self.border) {
            for index in 0..N {
                let mut column: Vec<f64> = border.iter().map(|b| b[index]).collect();
                factor.solve(&mut column);
                own.iter_mut().zip(column).for_each(|(own, value)| own[index] = value);
            }
        }
        for axis in [0, 1] {
            for (j, border) in self.border[axis].iter().enumerate() {
                information -= border * leverage[axis][j].transpose();
                right -= border * path_step[axis][j];
            }
        }
        ReducedMotion { factor, information, right, leverage, path_step }
    }
}

pub(super) fn advance(state: &mut MotionState, reduced: &ReducedMotion, change: &SVector<f64, N>) {
    for axis in [0, 1] {
        for (j, c) in state.path.c[axis].iter_mut().enumerate() {
            *c += reduced.path_step[axis][j] - reduced.leverage[axis][j].dot(change);
        }
    }
    state.theta += change;
}

/// The inverse, computed with every diagonal element scaled to one; nothing when singular.
pub(super) fn invert(information: &Information) -> Option<Information> {
    let scale = SVector::<f64, N>::from_fn(|i, _| information[(i, i)].max(0.0).sqrt().recip());
    if !scale.iter().all(|value| value.is_finite()) {
        return None;
    }
    let scaled = Information::from_fn(|i, j| {
        scale[i] * scale[j] * information[(i, j)].midpoint(information[(j, i)])
    });
    let inverse = scaled.cholesky()?.inverse();
    let unscaled = Information::from_fn(|i, j| scale[i] * scale[j] * inverse[(i, j)]);
    unscaled.iter().all(|value| value.is_finite()).then_some(unscaled)
}

pub(super) fn solve(information: &Information, right: &SVector<f64, N>) -> Option<SVector<f64, N>> {
    invert(information).map(|inverse| inverse * right)
}
