//! The geometry of one move of the simulated arm.

use evrig_device::dobot::alarm::Alarm;
use nalgebra::Vector3;

/// Where the tool is on its way: by joints or by place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum ArmPoint {
    /// Four joint angles, deg.
    Joints([f64; 4]),
    /// x, y, z (mm), r (deg).
    Xyzr([f64; 4]),
}

/// A way from here to there, by the share of its length that is covered.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum LegPath {
    /// Straight in joint space.
    Joint {
        /// Joints at the start.
        from: [f64; 4],
        /// Joints at the end.
        to: [f64; 4],
    },
    /// Straight in space.
    Line {
        /// Pose at the start.
        from: [f64; 4],
        /// Pose at the end.
        to: [f64; 4],
    },
    /// Around a centre.
    Arc(SimulatedArc),
}

/// A piece of a circle, or several turns of it.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct SimulatedArc {
    centre: Vector3<f64>,
    /// From the centre to the start.
    out: Vector3<f64>,
    /// As long as `out`, at right angles to it, in the direction of motion.
    ahead: Vector3<f64>,
    angle: f64,
    r_from: f64,
    r_to: f64,
}

impl SimulatedArc {
    /// The arc from `from` through `via` to `to`, and on around for `turns` whole turns when
    /// given (it then ends where it started).
    ///
    /// # Errors
    /// The alarm for points given twice or lying on a line.
    pub(super) fn through(
        from: [f64; 4],
        via: [f64; 4],
        to: [f64; 4],
        turns: Option<u32>,
    ) -> Result<Self, Alarm> {
        let [a, b, c] = [from, via, to].map(|p| Vector3::new(p[0], p[1], p[2]));
        let (ab, ac) = (b - a, c - a);
        if ab.norm() < 1e-6 || ac.norm() < 1e-6 || (c - b).norm() < 1e-6 {
            return Err(Alarm::PLAN_REPEATED_POINT);
        }
        let normal = ab.cross(&ac);
        // Twice the triangle's area against its sides: the points lie on a line.
        if normal.norm() < 1e-6 * ab.norm() * ac.norm() {
            return Err(Alarm::PLAN_ARC_INPUT);
        }
        let to_centre = (normal.cross(&ab) * ac.norm_squared()
            + ac.cross(&normal) * ab.norm_squared())
            / (2.0 * normal.norm_squared());
        let centre = a + to_centre;
        let out = a - centre;
        let ahead = normal.normalize().cross(&out);
        let end = c - centre;
        let once = end.dot(&ahead).atan2(end.dot(&out)).rem_euclid(std::f64::consts::TAU);
        let (angle, r_to) = match turns {
            Some(turns) => (std::f64::consts::TAU * f64::from(turns.max(1)), from[3]),
            None => (once, to[3]),
        };
        Ok(Self { centre, out, ahead, angle, r_from: from[3], r_to })
    }

    /// Radius, mm.
    #[must_use]
    pub(super) fn radius(&self) -> f64 {
        self.out.norm()
    }

    fn at(&self, fraction: f64) -> [f64; 4] {
        let (sin, cos) = (self.angle * fraction).sin_cos();
        let place = self.centre + self.out * cos + self.ahead * sin;
        [place.x, place.y, place.z, self.r_from + (self.r_to - self.r_from) * fraction]
    }
}

impl LegPath {
    /// Length of the tool's way, mm; zero for a joint path, which has no length.
    #[must_use]
    pub(super) fn length(&self) -> f64 {
        match self {
            Self::Joint { .. } => 0.0,
            Self::Line { from, to } => {
                (0..3).map(|axis| (to[axis] - from[axis]).powi(2)).sum::<f64>().sqrt()
            }
            Self::Arc(arc) => arc.radius() * arc.angle,
        }
    }

    /// How far r turns, deg.
    #[must_use]
    pub(super) fn turn(&self) -> f64 {
        match self {
            Self::Joint { .. } => 0.0,
            Self::Line { from, to } => (to[3] - from[3]).abs(),
            Self::Arc(arc) => (arc.r_to - arc.r_from).abs(),
        }
    }

    /// The point at a share of the length, 0..=1.
    #[must_use]
    pub(super) fn at(&self, fraction: f64) -> ArmPoint {
        let between = |from: &[f64; 4], to: &[f64; 4]| {
            std::array::from_fn(|axis| from[axis] + (to[axis] - from[axis]) * fraction)
        };
        match self {
            Self::Joint { from, to } => ArmPoint::Joints(between(from, to)),
            Self::Line { from, to } => ArmPoint::Xyzr(between(from, to)),
            Self::Arc(arc) => ArmPoint::Xyzr(arc.at(fraction)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const START: [f64; 4] = [240.0, 0.0, 100.0, 90.0];
    const VIA: [f64; 4] = [252.0, 12.0, 100.0, 90.0];
    const OPPOSITE: [f64; 4] = [264.0, 0.0, 100.0, 90.0];

    #[test]
    fn the_papers_circle_lies_around_252_0_100_and_closes() {
        let arc = SimulatedArc::through(START, VIA, OPPOSITE, Some(1)).unwrap();
        let path = LegPath::Arc(arc);
        assert!((path.length() - std::f64::consts::TAU * 12.0).abs() < 1e-9);
        for step in 0..=16 {
            let ArmPoint::Xyzr([x, y, z, r]) = path.at(f64::from(step) / 16.0) else { panic!() };
            assert!(((x - 252.0).hypot(y) - 12.0).abs() < 1e-9);
            assert!((z - 100.0).abs() < 1e-9 && (r - 90.0).abs() < 1e-9);
        }
        let ArmPoint::Xyzr(quarter) = path.at(0.25) else { panic!() };
        assert!((quarter[0] - 252.0).abs() < 1e-9 && (quarter[1] - 12.0).abs() < 1e-9);
        let ArmPoint::Xyzr(end) = path.at(1.0) else { panic!() };
        assert!((end[0] - 240.0).abs() < 1e-9 && end[1].abs() < 1e-9);
    }

    #[test]
    fn an_arc_goes_through_its_points_the_way_they_are_given() {
        let below = [252.0, -12.0, 100.0, 90.0];
        let path = LegPath::Arc(SimulatedArc::through(START, VIA, below, None).unwrap());
        assert!((path.length() - std::f64::consts::TAU * 12.0 * 0.75).abs() < 1e-9);
        let ArmPoint::Xyzr(end) = path.at(1.0) else { panic!() };
        assert!((end[1] + 12.0).abs() < 1e-9);
    }

    #[test]
    fn points_that_make_no_circle_raise_the_firmwares_alarms() {
        let middle = [252.0, 0.0, 100.0, 90.0];
        assert_eq!(SimulatedArc::through(START, START, VIA, None), Err(Alarm::PLAN_REPEATED_POINT));
        assert_eq!(
            SimulatedArc::through(START, middle, OPPOSITE, None),
            Err(Alarm::PLAN_ARC_INPUT)
        );
    }
}
