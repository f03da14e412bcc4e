//! The common path as a cubic spline with even knots.

use super::banded::Banded;
use super::samples::TrackPoint;

/// Knot distances tried, seconds.
const KNOTS_S: [f64; 7] = [1.6, 0.8, 0.4, 0.2, 0.1, 0.05, 0.025];
/// Samples a knot must have on average.
const SAMPLES_PER_KNOT: f64 = 3.0;
/// Curvature penalty relative to the mean weight of a coefficient; it matters only in gaps.
const GAP_PENALTY: f64 = 1e-7;

#[derive(Debug, Clone)]
pub(super) struct PathSpline {
    pub(super) begin_s: f64,
    pub(super) knot_s: f64,
    pub(super) c: [Vec<f64>; 2],
}

/// The four basis functions that are not zero at a time, and their derivatives.
#[derive(Debug, Clone, Copy)]
pub(super) struct Basis {
    pub(super) first: usize,
    pub(super) value: [f64; 4],
    /// Per second.
    pub(super) slope: [f64; 4],
}

impl PathSpline {
    /// Fits one track; the knot spacing minimises Akaike's criterion with unknown error.
    pub(super) fn fit(points: &[TrackPoint]) -> Self {
        let span = points[points.len() - 1].t_s - points[0].t_s;
        let most = points.len() as f64 / SAMPLES_PER_KNOT;
        let tried = KNOTS_S.iter().filter(|knot| span / **knot <= most);
        let coarsest = span / (most.max(4.0) - 3.0).clamp(1.0, 8.0);
        tried
            .copied()
            .chain([coarsest])
            .map(|knot_s| Self::with_knots(points, knot_s))
            .map(|path| (path.criterion(points), path))
            .min_by(|a, b| a.0.total_cmp(&b.0))
            .map_or_else(|| Self::with_knots(points, coarsest), |(_, path)| path)
    }

    /// The path refitted with half the knot spacing; None where `n` samples are too few.
    pub(super) fn finer(&self, points: &[TrackPoint], n: usize) -> Option<Self> {
        let knot_s = self.knot_s / 2.0;
        let span = points[points.len() - 1].t_s - points[0].t_s;
        (span / knot_s <= n as f64 / SAMPLES_PER_KNOT).then(|| Self::with_knots(points, knot_s))
    }

    /// A path of zeros over the time of the points.
    fn flat(points: &[TrackPoint], knot_s: f64) -> Self {
        let begin_s = points[0].t_s;
        let n = ((points[points.len() - 1].t_s - begin_s) / knot_s).ceil().max(1.0) as usize + 3;
        Self { begin_s, knot_s, c: [vec![0.0; n], vec![0.0; n]] }
    }

    fn with_knots(points: &[TrackPoint], knot_s: f64) -> Self {
        let mut path = Self::flat(points, knot_s);
        let mut normal = Banded::zeros(path.n());
        for point in points {
            let basis = path.basis(point.t_s);
            let weight = point.error.powi(-2);
            normal.add_outer(basis.first, basis.value, weight);
            for (axis, c) in path.c.iter_mut().enumerate() {
                for (i, b) in basis.value.iter().enumerate() {
                    c[basis.first + i] += weight * b * point.p[axis];
                }
            }
        }
        add_gap_penalty(&mut normal);
        let factor = normal.factor();
        path.c.iter_mut().for_each(|c| factor.solve(c));
        path
    }

    /// Akaike's criterion with the samples' error unknown.
    fn criterion(&self, points: &[TrackPoint]) -> f64 {
        let squares: f64 = points
            .iter()
            .map(|point| {
                let q = self.position(&self.basis(point.t_s));
                ((q[0] - point.p[0]).powi(2) + (q[1] - point.p[1]).powi(2)) / point.error.powi(2)
            })
            .sum();
        let n = 2.0 * points.len() as f64;
        n * (squares / n).max(1e-12).ln() + 4.0 * self.n() as f64
    }

    /// Coefficients of each coordinate.
    pub(super) fn n(&self) -> usize {
        self.c[0].len()
    }

    /// The basis at `t_s`, clamped to the path.
    pub(super) fn basis(&self, t_s: f64) -> Basis {
        let place = ((t_s - self.begin_s) / self.knot_s).clamp(0.0, (self.n() - 3) as f64);
        let first = (place as usize).min(self.n() - 4);
        let s = place - first as f64;
        let r = 1.0 - s;
        let value = [
            r * r * r / 6.0,
            (3.0 * s * s * s - 6.0 * s * s + 4.0) / 6.0,
            (3.0 * r * r * r - 6.0 * r * r + 4.0) / 6.0,
            s * s * s / 6.0,
        ];
        let slope = [-0.5 * r * r, 1.5 * s * s - 2.0 * s, 2.0 * r - 1.5 * r * r, 0.5 * s * s];
        Basis { first, value, slope: slope.map(|d| d / self.knot_s) }
    }

    pub(super) fn position(&self, basis: &Basis) -> [f64; 2] {
        self.combine(basis.first, basis.value)
    }

    pub(super) fn velocity(&self, basis: &Basis) -> [f64; 2] {
        self.combine(basis.first, basis.slope)
    }

    fn combine(&self, first: usize, factors: [f64; 4]) -> [f64; 2] {
        [0, 1].map(|axis| {
            factors.iter().zip(&self.c[axis][first..]).map(|(factor, c)| factor * c).sum()
        })
    }
}

/// Adds the curvature penalty and returns its weight.
pub(super) fn add_gap_penalty(normal: &mut Banded) -> f64 {
    let weight = GAP_PENALTY * normal.mean_diagonal();
    for (first, bend) in bends(normal.n()) {
        normal.add_outer(first, bend, weight);
    }
    weight
}

/// The second differences of neighbouring coefficients.
pub(super) fn bends(n: usize) -> impl Iterator<Item = (usize, [f64; 4])> {
    // The last one starts one entry further left, since four must fit.
    (0..n - 3).map(|first| (first, [1.0, -2.0, 1.0, 0.0])).chain([(n - 4, [0.0, 1.0, -2.0, 1.0])])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_spline_follows_a_circle_and_its_velocity() {
        let circle = |t: f64| [20.0 * (3.0 * t).cos(), 20.0 * (3.0 * t).sin()];
        let points: Vec<TrackPoint> = (0..600)
            .map(|i| f64::from(i) / 120.0)
            .map(|t| TrackPoint { t_s: t, p: circle(t), error: 0.1 })
            .collect();
        let path = PathSpline::fit(&points);
        for t in [0.3, 1.7, 4.2] {
            let basis = path.basis(t);
            let (q, v) = (path.position(&basis), path.velocity(&basis));
            assert!((q[0] - circle(t)[0]).abs() < 1e-3, "{q:?}");
            assert!((v[1] - 60.0 * (3.0 * t).cos()).abs() < 0.05, "{v:?}");
        }
    }
}
