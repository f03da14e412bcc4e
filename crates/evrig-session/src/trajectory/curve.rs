//! The geometry of one motion: where the tool goes, without saying when.

use crate::rig::Pose;
use evrig_core::units::{Degrees, Millimetres};
use nalgebra::{Unit, Vector3};
use std::f64::consts::TAU;

/// Closer than this two points are the same point (a hundredth of the arm's repeatability).
const SAME_POINT_MM: f64 = 2e-3;

/// A piece of path from one pose to another; the wrist turns in proportion to the way done.
#[derive(Debug, Clone, PartialEq)]
pub struct ToolCurve {
    from: Pose,
    to: Pose,
    length_mm: f64,
    shape: Shape,
}

#[derive(Debug, Clone, PartialEq)]
enum Shape {
    Line,
    Arc(CircularArc),
    Points { poses: Vec<Pose>, way_mm: Vec<f64> },
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct CircularArc {
    centre: Vector3<f64>,
    /// From the centre to the first point, length one.
    outwards: Vector3<f64>,
    /// Direction of travel at the first point, length one.
    forwards: Vector3<f64>,
    radius: f64,
    /// Angle travelled in radians, positive; above one turn for repeated circles.
    sweep: f64,
}

/// A curve in the terms of the arm's commands.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum MotionCommand<'a> {
    /// Dwell.
    Hold,
    /// Straight to the end pose; with equal positions only the wrist turns.
    Line,
    /// Part of a circle through `via` to the end pose.
    Arc {
        /// A pose half way.
        via: Pose,
    },
    /// Whole turns through `via` and `opposite` back to the start, which is the end pose.
    Circle {
        /// A pose a quarter turn on.
        via: Pose,
        /// The pose half a turn on.
        opposite: Pose,
        /// Number of turns without a stop.
        turns: u32,
    },
    /// Through all these poses without a stop, from the first to the last.
    Points(&'a [Pose]),
}

/// Why three points or a list of points make no curve.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum CurveError {
    /// Two of an arc's points coincide; the arm's alarm 0x13.
    #[error("two points of the arc coincide ({0})")]
    RepeatedPoint(Pose),
    /// An arc's points lie on one line; the arm's alarm 0x14.
    #[error("the three points of the arc lie on one line (via {0})")]
    Collinear(Pose),
    /// A list of fewer than two points.
    #[error("a path through points needs at least two of them")]
    TooFewPoints,
}

fn vector(pose: Pose) -> Vector3<f64> {
    Vector3::from(pose.position_mm())
}

impl ToolCurve {
    /// Straight on; equal positions make a turn of the wrist, equal poses a standstill.
    #[must_use]
    pub fn line(from: Pose, to: Pose) -> Self {
        Self { from, to, length_mm: from.distance(to).0, shape: Shape::Line }
    }

    /// Less than one turn from `from` through `via` to `to`, as the arm's ARC command draws it.
    ///
    /// # Errors
    /// When two points coincide or all lie on one line.
    pub fn arc(from: Pose, via: Pose, to: Pose) -> Result<Self, CurveError> {
        let arc = through(from, via, to)?;
        let end = vector(to) - arc.centre;
        let angle = end.dot(&arc.forwards).atan2(end.dot(&arc.outwards)).rem_euclid(TAU);
        let arc = CircularArc { sweep: angle, ..arc };
        Ok(Self { from, to, length_mm: arc.radius * angle, shape: Shape::Arc(arc) })
    }

    /// `turns` whole turns through three points back to `from`, as the arm's CIRCLE command draws
    /// them.
    ///
    /// # Errors
    /// When two points coincide or all lie on one line.
    pub fn circle(from: Pose, via: Pose, third: Pose, turns: u32) -> Result<Self, CurveError> {
        let arc = CircularArc { sweep: f64::from(turns) * TAU, ..through(from, via, third)? };
        Ok(Self { from, to: from, length_mm: arc.radius * arc.sweep, shape: Shape::Arc(arc) })
    }

    /// Through poses without a stop, straight from one to the next.
    ///
    /// # Errors
    /// With fewer than two poses.
    pub fn points(poses: Vec<Pose>) -> Result<Self, CurveError> {
        let (Some(&from), Some(&to), true) = (poses.first(), poses.last(), poses.len() > 1) else {
            return Err(CurveError::TooFewPoints);
        };
        let mut way_mm = vec![0.0];
        let mut length_mm = 0.0;
        for pair in poses.windows(2) {
            length_mm += pair[0].distance(pair[1]).0;
            way_mm.push(length_mm);
        }
        Ok(Self { from, to, length_mm, shape: Shape::Points { poses, way_mm } })
    }

    /// Where it begins.
    #[must_use]
    pub fn from(&self) -> Pose {
        self.from
    }

    /// Where it ends.
    #[must_use]
    pub fn to(&self) -> Pose {
        self.to
    }

    /// Way of the tool point.
    #[must_use]
    pub fn length(&self) -> Millimetres {
        Millimetres(self.length_mm)
    }

    /// How far the wrist turns, in the base frame; signed.
    #[must_use]
    pub fn turn(&self) -> Degrees {
        self.to.r - self.from.r
    }

    /// The curve in the terms of the arm's commands.
    #[must_use]
    pub fn motion(&self) -> MotionCommand<'_> {
        match &self.shape {
            Shape::Line if self.from == self.to => MotionCommand::Hold,
            Shape::Line => MotionCommand::Line,
            Shape::Points { poses, .. } => MotionCommand::Points(poses),
            Shape::Arc(arc) => {
                let turns = (arc.sweep / TAU).round();
                if turns < 1.0 || (arc.sweep - turns * TAU).abs() > 1e-9 {
                    return MotionCommand::Arc { via: self.pose_at(0.5) };
                }
                let on_circle = |part: f64| self.pose_at(part / turns);
                let turns = turns as u32;
                MotionCommand::Circle { via: on_circle(0.25), opposite: on_circle(0.5), turns }
            }
        }
    }

    /// The pose where `part` (0..=1) of the way is done.
    #[must_use]
    pub fn pose_at(&self, part: f64) -> Pose {
        let part = part.clamp(0.0, 1.0);
        let r = self.from.r.0 + part * self.turn().0;
        let at =
            |position: Vector3<f64>| Pose::from_mm_deg([position.x, position.y, position.z, r]);
        match &self.shape {
            Shape::Line => at(vector(self.from).lerp(&vector(self.to), part)),
            Shape::Arc(arc) => at(arc.at(part * arc.sweep)),
            Shape::Points { poses, way_mm } => {
                let way = part * self.length_mm;
                let next = leg_at(way_mm, way);
                let leg = way_mm[next] - way_mm[next - 1];
                let rest = if leg > 0.0 { (way - way_mm[next - 1]) / leg } else { 1.0 };
                let [a, b] = [poses[next - 1], poses[next]];
                let mixed = vector(a).lerp(&vector(b), rest.clamp(0.0, 1.0));
                let r = a.r + (b.r - a.r) * rest.clamp(0.0, 1.0);
                Pose { r, ..at(mixed) }
            }
        }
    }

    /// Change of `[x, y, z, r]` (mm, deg) per part of the way at `part`; along the way at every
    /// point.
    #[must_use]
    pub fn slope_at(&self, part: f64) -> [f64; 4] {
        let turn = self.turn().0;
        let way: Vector3<f64> = match &self.shape {
            Shape::Line => vector(self.to) - vector(self.from),
            Shape::Arc(arc) => {
                let (sin, cos) = (part.clamp(0.0, 1.0) * arc.sweep).sin_cos();
                self.length_mm * (cos * arc.forwards - sin * arc.outwards)
            }
            Shape::Points { poses, way_mm } => {
                let next = leg_at(way_mm, part * self.length_mm);
                let [a, b] = [poses[next - 1], poses[next]];
                let leg = (way_mm[next] - way_mm[next - 1]).max(f64::MIN_POSITIVE);
                let turn = (b.r - a.r).0 * self.length_mm / leg;
                let [x, y, z] = ((vector(b) - vector(a)) * (self.length_mm / leg)).into();
                return [x, y, z, turn];
            }
        };
        [way.x, way.y, way.z, turn]
    }

    /// The smallest radius of curvature on it; none where it is straight.
    ///
    /// Of a curve made of points, that of the circles through every point and its neighbours.
    #[must_use]
    pub fn tightest_radius(&self) -> Option<Millimetres> {
        match &self.shape {
            Shape::Line => None,
            Shape::Arc(arc) => Some(Millimetres(arc.radius)),
            Shape::Points { poses, .. } => poses
                .windows(3)
                .filter_map(|near| through(near[0], near[1], near[2]).ok())
                .map(|arc| arc.radius)
                .min_by(f64::total_cmp)
                .map(Millimetres),
        }
    }

    /// The same way backwards.
    #[must_use]
    pub fn reversed(&self) -> Self {
        let shape = match &self.shape {
            Shape::Line => Shape::Line,
            Shape::Arc(arc) => Shape::Arc(arc.reversed()),
            Shape::Points { poses, way_mm } => Shape::Points {
                poses: poses.iter().rev().copied().collect(),
                way_mm: way_mm.iter().rev().map(|way| self.length_mm - way).collect(),
            },
        };
        Self { from: self.to, to: self.from, length_mm: self.length_mm, shape }
    }
}

/// Index of the point at the end of the leg that contains `way`.
fn leg_at(way_mm: &[f64], way: f64) -> usize {
    way_mm.partition_point(|done| *done < way).clamp(1, way_mm.len() - 1)
}

impl CircularArc {
    fn at(&self, angle: f64) -> Vector3<f64> {
        let (sin, cos) = angle.sin_cos();
        self.centre + self.radius * (cos * self.outwards + sin * self.forwards)
    }

    fn reversed(&self) -> Self {
        let (sin, cos) = self.sweep.sin_cos();
        Self {
            outwards: cos * self.outwards + sin * self.forwards,
            forwards: sin * self.outwards - cos * self.forwards,
            ..*self
        }
    }
}

/// The circle through three points, travelled from the first to the second to the third; no sweep
/// yet.
fn through(from: Pose, via: Pose, to: Pose) -> Result<CircularArc, CurveError> {
    for (a, b) in [(from, via), (via, to), (from, to)] {
        if a.distance(b).0 < SAME_POINT_MM {
            return Err(CurveError::RepeatedPoint(b));
        }
    }
    let (a, b) = (vector(via) - vector(from), vector(to) - vector(from));
    let normal = a.cross(&b);
    // Twice the triangle's area against its sides: the sine of its angle at `from`.
    if normal.norm() < 1e-6 * a.norm() * b.norm() {
        return Err(CurveError::Collinear(via));
    }
    // Circumcentre of a triangle with one corner in the origin.
    let to_centre = (a.norm_squared() * b - b.norm_squared() * a).cross(&normal)
        / (2.0 * normal.norm_squared());
    let outwards = Unit::new_normalize(-to_centre).into_inner();
    let forwards = normal.normalize().cross(&outwards);
    let centre = vector(from) + to_centre;
    Ok(CircularArc { centre, outwards, forwards, radius: to_centre.norm(), sweep: 0.0 })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn pose(x: f64, y: f64) -> Pose {
        Pose::from_mm_deg([x, y, 100.0, 90.0])
    }

    fn near(a: Pose, b: Pose) -> bool {
        a.distance(b).0 < 1e-9 && (a.r - b.r).abs().0 < 1e-9
    }

    #[test]
    fn the_papers_circle_runs_over_plus_y_round_252() {
        let circle =
            ToolCurve::circle(pose(240.0, 0.0), pose(252.0, 12.0), pose(264.0, 0.0), 1).unwrap();
        assert!((circle.length().0 - TAU * 12.0).abs() < 1e-9);
        assert!(near(circle.pose_at(0.25), pose(252.0, 12.0)));
        assert!(near(circle.pose_at(0.5), pose(264.0, 0.0)));
        assert!(near(circle.pose_at(0.75), pose(252.0, -12.0)));
        assert!(near(circle.pose_at(1.0), pose(240.0, 0.0)));
        let MotionCommand::Circle { via, opposite, turns: 1 } = circle.motion() else {
            panic!("{:?}", circle.motion())
        };
        assert!(near(via, pose(252.0, 12.0)) && near(opposite, pose(264.0, 0.0)));
    }

    #[test]
    fn two_half_arcs_are_one_circle() {
        let [a, b, c, d] =
            [(240.0, 0.0), (252.0, 12.0), (264.0, 0.0), (252.0, -12.0)].map(|(x, y)| pose(x, y));
        let there = ToolCurve::arc(a, b, c).unwrap();
        let back = ToolCurve::arc(c, d, a).unwrap();
        assert!((there.length() + back.length() - Millimetres(TAU * 12.0)).abs().0 < 1e-9);
        assert!(near(back.pose_at(0.5), d));
        assert!(matches!(there.motion(), MotionCommand::Arc { via } if near(via, b)));
    }

    #[test]
    fn points_that_make_no_circle_are_named() {
        let a = pose(240.0, 0.0);
        let line = ToolCurve::arc(a, pose(250.0, 0.0), pose(260.0, 0.0));
        assert!(matches!(line, Err(CurveError::Collinear(_))));
        assert!(matches!(
            ToolCurve::arc(a, a, pose(260.0, 0.0)),
            Err(CurveError::RepeatedPoint(_))
        ));
        assert!(matches!(ToolCurve::points(vec![a]), Err(CurveError::TooFewPoints)));
    }

    #[test]
    fn a_standstill_is_a_hold_and_a_turn_of_the_wrist_is_not() {
        let a = pose(240.0, 0.0);
        assert_eq!(ToolCurve::line(a, a).motion(), MotionCommand::Hold);
        let turned = ToolCurve::line(a, Pose { r: Degrees(60.0), ..a });
        assert_eq!(turned.motion(), MotionCommand::Line);
        assert!((turned.pose_at(0.5).r.0 - 75.0).abs() < 1e-12);
    }

    proptest! {
        #[test]
        fn an_arc_meets_its_points_and_backwards_is_the_same_way(
            p in proptest::array::uniform9(-100.0..100.0_f64), part in 0.0..1.0_f64, r in -90.0..90.0_f64,
        ) {
            let at = |i: usize, r: f64| Pose::from_mm_deg([p[i], p[i + 1], p[i + 2], r]);
            let (from, via, to) = (at(0, 0.0), at(3, 0.0), at(6, r));
            prop_assume!(through(from, via, to).is_ok_and(|arc| arc.radius < 1e4));
            let arc = ToolCurve::arc(from, via, to).unwrap();
            prop_assert!(arc.pose_at(1.0).distance(to).0 < 1e-6);
            let nearest = (0..=20_000)
                .map(|i| arc.pose_at(f64::from(i) / 20_000.0).distance(via).0)
                .fold(f64::INFINITY, f64::min);
            prop_assert!(nearest <= arc.length().0 / 20_000.0, "the arc misses its middle point \
                by {nearest}");
            let (h, slope) = (1e-6, arc.slope_at(part));
            let ahead = arc.pose_at((part + h).min(1.0)).to_mm_deg();
            let behind = arc.pose_at((part - h).max(0.0)).to_mm_deg();
            let dt = (part + h).min(1.0) - (part - h).max(0.0);
            for i in 0..4 {
                let change = (ahead[i] - behind[i]) / dt;
                prop_assert!((change - slope[i]).abs() < 1e-3 * (1.0 + arc.length().0), "axis {i}");
            }
            let back = arc.reversed();
            prop_assert!(back.pose_at(1.0 - part).distance(arc.pose_at(part)).0 < 1e-6);
            prop_assert!((back.pose_at(1.0 - part).r - arc.pose_at(part).r).abs().0 < 1e-9);
        }
    }
}
