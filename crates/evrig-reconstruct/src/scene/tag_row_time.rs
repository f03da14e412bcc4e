//! Row time from the tag: a rolling shutter shears and stretches a moving tag.
//!
//! Relative to rest the tag is imaged by `G = (I + t v e_y^T) R s`, with rotation `R`, scale `s`,
//! row time `t` and velocity `v` in pixels per second. Small rotations and scale change neither the
//! sum `G_xy + G_yx = t v_x` nor the difference `G_yy - G_xx = t v_y` (a larger rotation mixes
//! them), so that both determine the row time on any path. A tilt of the target adds a term linear
//! in the tag's position.

use super::clustered_covariance::clustered_covariance;
use crate::roi::{TagDetection, Track};
use evrig_core::time::PiSensor;
use nalgebra::{Matrix2, SMatrix, SVector, Vector2};

/// The row time, then level and slopes of either strain by position.
const UNKNOWNS: usize = 7;
/// Fewest observations of a moving tag.
const MIN_OBSERVATIONS: usize = 24;
/// Longest time between frames that give a velocity, seconds.
const MAX_NEIGHBOUR_S: f64 = 0.05;
/// Systematic error of the distance of blurred edges, as a share of the row time: 0.1 to 0.4 % too
/// small in recordings of the simulated rig.
const EDGE_ERROR: f64 = 0.004;
/// Iterations: velocities depend on the row time.
const ITERATIONS: usize = 3;

type StrainRow = SVector<f64, UNKNOWNS>;

struct TagShape {
    /// Mid-exposure of the frame's first row, seconds.
    first_s: f64,
    middle: Vector2<f64>,
    /// Half sides of the tag, right and down, in pixels.
    sides: Matrix2<f64>,
}

impl TagShape {
    fn of(detection: &TagDetection<PiSensor>, stated_row_s: f64, track: &Track<PiSensor>) -> Self {
        let [bl, br, tr, tl] = detection.corners_px.map(Vector2::from);
        let middle = (bl + br + tr + tl) / 4.0;
        let seconds = (detection.time - track.detections[0].time).as_secs_f64();
        Self {
            first_s: seconds - middle.y * stated_row_s,
            middle,
            sides: Matrix2::from_columns(&[(br + tr - bl - tl) / 4.0, (bl + br - tl - tr) / 4.0]),
        }
    }
}

/// Row time in seconds with its standard error.
pub(super) fn row_time_by_tag(track: &Track<PiSensor>, stated_row_s: f64) -> Option<[f64; 2]> {
    let shape = |detection| TagShape::of(detection, stated_row_s, track);
    let shapes: Vec<TagShape> = track.detections.iter().map(shape).collect();
    (0..ITERATIONS).try_fold([stated_row_s, 0.0], |[row_s, _], _| solve(&shapes, row_s))
}

fn solve(shapes: &[TagShape], row_s: f64) -> Option<[f64; 2]> {
    let rows = rows(shapes, row_s)?;
    let mut normal = SMatrix::<f64, UNKNOWNS, UNKNOWNS>::zeros();
    let mut right = StrainRow::zeros();
    for (row, strain) in rows.iter().flatten() {
        normal += row * row.transpose();
        right += row * *strain;
    }
    let inverse = normal.try_inverse()?;
    let found = inverse * right;
    let residual = |pair: &[(StrainRow, f64); 2]| -> StrainRow {
        pair.iter().map(|(row, strain)| row * (strain - row.dot(&found))).sum()
    };
    let scores: Vec<StrainRow> = rows.iter().map(residual).collect();
    let error_s = clustered_covariance(&inverse, &scores)[(0, 0)]
        .max(0.0)
        .sqrt()
        .hypot(EDGE_ERROR * found[0]);
    (found[0].is_finite() && error_s.is_finite()).then_some([found[0], error_s])
}

/// Both strains of each observation between two others, with their regressors.
fn rows(shapes: &[TagShape], row_s: f64) -> Option<Vec<[(StrainRow, f64); 2]>> {
    let n = shapes.len() as f64;
    let rest = shapes.iter().map(|shape| shape.sides).sum::<Matrix2<f64>>() / n;
    let back = rest.try_inverse()?;
    let centre = shapes.iter().map(|shape| shape.middle).sum::<Vector2<f64>>() / n;
    // Side of the mean tag in pixels, the unit of positions.
    let size = rest.determinant().abs().sqrt().max(1e-9);
    let time_s = |shape: &TagShape| shape.first_s + shape.middle.y * row_s;
    let strains = |three: &[TagShape]| {
        let [before, shape, after] = three else { return None };
        let length_s = time_s(after) - time_s(before);
        if !(length_s > 0.0 && length_s <= 2.0 * MAX_NEIGHBOUR_S) {
            return None;
        }
        let speed = (after.middle - before.middle) / length_s;
        let turned = shape.sides * back;
        let seen = turned / turned.determinant().abs().sqrt().max(1e-9);
        let turn = (seen[(1, 0)] - seen[(0, 1)]).atan2(seen[(0, 0)] + seen[(1, 1)]);
        let (sin, cos) = turn.sin_cos();
        let [x, y] = [0, 1].map(|i| (shape.middle[i] - centre[i]) / size);
        let sum = StrainRow::from([speed.x * cos + speed.y * sin, 1.0, x, y, 0.0, 0.0, 0.0]);
        let difference = StrainRow::from([speed.y * cos - speed.x * sin, 0.0, 0.0, 0.0, 1.0, x, y]);
        Some([(sum, seen[(0, 1)] + seen[(1, 0)]), (difference, seen[(1, 1)] - seen[(0, 0)])])
    };
    let rows: Vec<_> = shapes.windows(3).filter_map(strains).collect();
    (rows.len() >= MIN_OBSERVATIONS).then_some(rows)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A tag on a figure of eight, rotated by up to `turn`, with row time `row_s`.
    fn shapes(row_s: f64, turn: f64) -> Vec<TagShape> {
        let place =
            |t: f64| Vector2::new(400.0 + 60.0 * (3.0 * t).sin(), 350.0 + 40.0 * (6.0 * t).sin());
        (0..240)
            .map(|frame| {
                let first_s = f64::from(frame) / 120.0;
                // The row on which the moving centre is imaged.
                let t = (0..20).fold(first_s, |t, _| first_s + place(t).y * row_s);
                let speed = (place(t + 1e-5) - place(t - 1e-5)) / 2e-5;
                let (sin, cos) = (turn * t.sin()).sin_cos();
                let rolled = Matrix2::new(1.0, row_s * speed.x, 0.0, 1.0 + row_s * speed.y);
                let scale = 54.0 * (1.0 + 0.01 * (2.0 * t).cos());
                let sides = rolled * Matrix2::new(cos, -sin, sin, cos) * scale;
                TagShape { first_s, middle: place(t), sides }
            })
            .collect()
    }

    #[test]
    fn a_tag_that_moves_tells_the_row_time_although_it_turns_and_sinks() {
        for (row_s, turn) in [(3e-5, 0.02), (-2e-5, 0.02), (9.21e-6, 1.2)] {
            let shapes = shapes(row_s, turn);
            let found = (0..ITERATIONS).fold(9.21e-6, |row_s, _| solve(&shapes, row_s).unwrap()[0]);
            let off = (found / row_s - 1.0).abs();
            assert!(off < 0.01, "{found} for {row_s} where it turns by {turn}");
        }
    }

    #[test]
    fn a_tag_at_rest_tells_nothing() {
        let still = |frame| TagShape {
            first_s: f64::from(frame) / 120.0,
            middle: Vector2::new(400.0, 350.0),
            sides: Matrix2::identity() * 54.0,
        };
        let shapes: Vec<TagShape> = (0..240).map(still).collect();
        assert!(solve(&shapes, 1e-5).is_none());
    }
}
