//! From a description to a path: each segment begins where the last one ended.

use super::segment::{Direction, Kind, Plane, RatesOverride, Segment, Turns};
use super::{Curve, CurveError, Path, Rates, Settings, Trajectory, Trapezoid};
use crate::rig::{Pose, Rig};
use crate::units::{
    DegreesPerSecond, DegreesPerSecond2, Millimetres, MillimetresPerSecond, MillimetresPerSecond2,
};
use nalgebra::Vector3;
use std::f64::consts::TAU;

/// More motions than any recording has; keeps repeats of repeats from filling memory.
const MAX_STEPS: usize = 100_000;

/// Spacing of the points of a drawn curve: the corner between two chords stays below 0.1 degree
/// on a radius of 60 mm, and their sagitta far below the arm's repeatability.
const CHORD_MM: f64 = 0.1;

/// The ARC parameters of the published recordings, where a description states no turn rates.
const TURN_RATES: [f64; 2] = [50.0, 50.0];

/// Why a description makes no path on this rig.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PathError {
    /// Seen edge on, nothing turns clockwise.
    #[error(
        "segment `{segment}`: its plane contains the DAVIS's optical axis, so that clockwise means \
         nothing; draw it in the plane `image`"
    )]
    EdgeOn {
        /// Its label.
        segment: String,
    },
    /// A way backwards that does not begin here.
    #[error(
        "segment `{segment}` runs `{of}` backwards, which must begin where that ended ({expected}), \
         but the tool is {away:.2} away ({got})"
    )]
    NotAtEnd {
        /// Its label.
        segment: String,
        /// What it reverses.
        of: String,
        /// Where that ended.
        expected: Pose,
        /// Where the tool is.
        got: Pose,
        /// How far it is from there.
        away: Millimetres,
    },
    /// A way backwards of what was not run.
    #[error("segment `{segment}` refers to `{of}`, which was left out before it")]
    NotRun {
        /// Its label.
        segment: String,
        /// What it refers to.
        of: String,
    },
    /// Points that make no curve.
    #[error("segment `{segment}`: {source}")]
    Curve {
        /// Its label.
        segment: String,
        /// What is wrong with them.
        source: CurveError,
    },
    /// Repeats of repeats without end.
    #[error("segment `{segment}`: the trajectory has more than {MAX_STEPS} motions")]
    TooManySteps {
        /// Its label.
        segment: String,
    },
}

/// Which segments become motions.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Optional {
    /// All of them.
    Included,
    /// Without those that the description calls optional.
    LeftOut,
}

impl Trajectory {
    /// The path on this rig: its mount says what the cameras see, and so which way is clockwise.
    ///
    /// # Errors
    /// When a segment makes no curve. Reach and speed are not looked at here: see [`super::plan`].
    pub fn path(&self, rig: &Rig, optional: Optional) -> Result<Path, PathError> {
        let camera = rig.mount.davis.frame(self.start);
        let mut builder = Builder {
            trajectory: self,
            picture: [camera.right, -camera.down],
            forward: camera.forward,
            path: Path::new(self.start),
            runs: vec![Vec::new(); self.segments.len()],
        };
        for (number, segment) in self.segments.iter().enumerate() {
            if optional == Optional::Included || !segment.is_optional {
                builder.run(number, &As::itself(segment, number))?;
            }
        }
        Ok(builder.path)
    }
}

struct Builder<'t> {
    trajectory: &'t Trajectory,
    /// Right and up in the DAVIS's picture at the start pose.
    picture: [Vector3<f64>; 2],
    /// Its optical axis there.
    forward: Vector3<f64>,
    path: Path,
    /// The steps of each segment's last run.
    runs: Vec<Vec<usize>>,
}

/// As what a segment runs: as itself, or as part of a later one.
#[derive(Clone)]
struct As {
    label: String,
    number: usize,
    rates: RatesOverride,
    settings: Settings,
}

impl As {
    fn itself(segment: &Segment, number: usize) -> Self {
        Self {
            label: segment.label.clone(),
            number,
            rates: segment.rates,
            settings: segment.settings.clone(),
        }
    }

    /// As part `label` of a segment that is itself run as `self`.
    fn part(&self, label: &str, segment: &Segment) -> Self {
        Self {
            label: format!("{}/{label}", self.label),
            number: self.number,
            rates: self.rates.or(segment.rates),
            settings: self.settings.over(&segment.settings),
        }
    }
}

impl Builder<'_> {
    fn run(&mut self, number: usize, as_what: &As) -> Result<(), PathError> {
        let trajectory = self.trajectory;
        let segment = &trajectory.segments[number];
        let first = self.path.steps().len();
        match &segment.kind {
            Kind::Dwell { duration } => {
                let rates = self.rates(as_what);
                let settings = as_what.settings.clone();
                self.path.push_hold(&as_what.label, as_what.number, *duration, rates, settings);
            }
            Kind::Repeat { of, times } => {
                for time in 1..=*times {
                    for &part in of {
                        let name = &trajectory.segments[part].label;
                        let label =
                            if *times > 1 { format!("{name}#{time}") } else { name.clone() };
                        self.run(part, &as_what.part(&label, &trajectory.segments[part]))?;
                    }
                }
            }
            Kind::Reverse { of } => {
                for &part in of.iter().rev() {
                    self.run_backwards(part, as_what)?;
                }
            }
            Kind::Sweep { of, speeds_mm_per_s, alternate } => {
                for (i, speed) in speeds_mm_per_s.iter().enumerate() {
                    let label = format!("{speed}mm/s");
                    let mut part = as_what.part(&label, &trajectory.segments[*of]);
                    part.rates.speed_mm_per_s = Some(*speed);
                    if *alternate && i % 2 == 1 {
                        self.run_backwards(*of, &part)?;
                    } else {
                        self.run(*of, &part)?;
                    }
                }
            }
            _ => {
                let curve = self.curve(segment, as_what)?;
                self.push(curve, as_what);
            }
        }
        if self.path.steps().len() > MAX_STEPS {
            return Err(PathError::TooManySteps { segment: as_what.label.clone() });
        }
        self.runs[number] = (first..self.path.steps().len()).collect();
        Ok(())
    }

    fn push(&mut self, curve: Curve, as_what: &As) {
        let rates = self.rates(as_what);
        let settings = as_what.settings.clone();
        self.path.push(&as_what.label, as_what.number, curve, rates, settings);
    }

    fn run_backwards(&mut self, part: usize, as_what: &As) -> Result<(), PathError> {
        let of = self.trajectory.segments[part].label.clone();
        let segment = || as_what.label.clone();
        let run = std::mem::take(&mut self.runs[part]);
        if run.is_empty() {
            return Err(PathError::NotRun { segment: segment(), of });
        }
        for &step in run.iter().rev() {
            let there = &self.path.steps()[step];
            let (duration, curve) = (there.duration, there.curve.reversed());
            let (expected, got) = (curve.from(), self.path.end());
            let away = expected.distance(got);
            if away.0 > 1e-6 || (expected.r - got.r).abs().0 > 1e-6 {
                return Err(PathError::NotAtEnd { segment: segment(), of, expected, got, away });
            }
            if curve.length().0 > 0.0 || curve.turn().0 != 0.0 {
                self.push(curve, as_what);
            } else {
                let (rates, settings) = (self.rates(as_what), as_what.settings.clone());
                self.path.push_hold(&as_what.label, as_what.number, duration, rates, settings);
            }
        }
        self.runs[part] = run;
        Ok(())
    }

    fn rates(&self, as_what: &As) -> Rates {
        let rates = as_what.rates.or(self.trajectory.rates);
        let [turn_speed, turn_acceleration] = TURN_RATES;
        Rates {
            speed: MillimetresPerSecond(rates.speed_mm_per_s.unwrap_or(0.0)),
            acceleration: MillimetresPerSecond2(rates.acceleration_mm_per_s2.unwrap_or(0.0)),
            turn_speed: DegreesPerSecond(rates.turn_speed_deg_per_s.unwrap_or(turn_speed)),
            turn_acceleration: DegreesPerSecond2(
                rates.turn_acceleration_deg_per_s2.unwrap_or(turn_acceleration),
            ),
        }
    }

    /// The axes (u, v) of a segment's plane in the base frame.
    fn plane(&self, segment: &Segment) -> [Vector3<f64>; 2] {
        match segment.plane.unwrap_or(self.trajectory.plane) {
            Plane::Image => self.picture,
            Plane::Xy => [Vector3::x(), Vector3::y()],
            Plane::Xz => [Vector3::x(), Vector3::z()],
            Plane::Yz => [Vector3::y(), Vector3::z()],
        }
    }

    fn curve(&self, segment: &Segment, as_what: &As) -> Result<Curve, PathError> {
        let from = self.path.end();
        let [u, v] = self.plane(segment);
        let failed = |source| PathError::Curve { segment: as_what.label.clone(), source };
        match &segment.kind {
            Kind::Line { to: Some(to), .. } => Ok(Curve::line(from, *to)),
            Kind::Line { by_mm, turn_deg, to: None } => {
                let to = moved(from, by_mm[0] * u + by_mm[1] * v);
                let r = crate::units::Degrees(from.r.0 + turn_deg);
                Ok(Curve::line(from, Pose { r, ..to }))
            }
            Kind::Arc { radius_mm, direction, start_deg, sweep_deg } => {
                let turn = self.sense(*direction, [u, v], as_what)? * sweep_deg;
                let [via, to] = [0.5, 1.0].map(|part| {
                    moved(from, on_circle([u, v], *radius_mm, *start_deg, part * turn))
                });
                Curve::arc(from, via, to).map_err(failed)
            }
            Kind::Circle { radius_mm, direction, start_deg, turns } => {
                let turn = self.sense(*direction, [u, v], as_what)? * 360.0;
                let [via, opposite] = [0.25, 0.5].map(|part| {
                    moved(from, on_circle([u, v], *radius_mm, *start_deg, part * turn))
                });
                let n_turns = self.count(*turns, radius_mm * TAU, as_what);
                Curve::circle(from, via, opposite, n_turns).map_err(failed)
            }
            Kind::Lissajous { amplitude_mm, cycles, phase_deg, turns } => {
                let figure = figure(from, [u, v], *amplitude_mm, *cycles, *phase_deg);
                let once = Curve::points(figure.clone()).map_err(failed)?;
                let n_turns = self.count(*turns, once.length().0, as_what) as usize;
                if n_turns.saturating_mul(figure.len()) > 100 * MAX_STEPS {
                    return Err(PathError::TooManySteps { segment: as_what.label.clone() });
                }
                let again = figure.iter().skip(1).cycle().take((n_turns - 1) * (figure.len() - 1));
                let all = figure.iter().chain(again).copied().collect();
                Curve::points(all).map_err(failed)
            }
            Kind::Dwell { .. }
            | Kind::Repeat { .. }
            | Kind::Reverse { .. }
            | Kind::Sweep { .. } => Ok(Curve::line(from, from)),
        }
    }

    /// +1 where the direction turns u towards v, -1 where it turns v towards u.
    fn sense(
        &self,
        direction: Direction,
        [u, v]: [Vector3<f64>; 2],
        as_what: &As,
    ) -> Result<f64, PathError> {
        // Where u x v points away from the camera, u towards v looks clockwise to it.
        let away = u.cross(&v).dot(&self.forward);
        if away.abs() < 0.02 {
            return Err(PathError::EdgeOn { segment: as_what.label.clone() });
        }
        Ok(match direction {
            Direction::Clockwise => away.signum(),
            Direction::Anticlockwise => -away.signum(),
        })
    }

    fn count(&self, turns: Turns, length_mm: f64, as_what: &As) -> u32 {
        let duration = match turns {
            Turns::Count(count) => return count,
            Turns::Lasting(duration) => duration.as_secs_f64(),
        };
        let rates = self.rates(as_what);
        let lasts = |count: u32| {
            let length = f64::from(count) * length_mm;
            Trapezoid::new(length, rates.speed.0, rates.acceleration.0).seconds()
        };
        // The ramps cost speed / acceleration; rounding may leave it one short.
        let ramps = rates.speed.0 / rates.acceleration.0;
        let about = ((duration - ramps).max(0.0) * rates.speed.0 / length_mm).floor();
        let about = (about as u32).max(1);
        (about..about.saturating_add(3))
            .find(|count| lasts(*count) >= duration - 1e-9)
            .unwrap_or(about)
    }
}

fn moved(from: Pose, by: Vector3<f64>) -> Pose {
    let [x, y, z, r] = from.to_mm_deg();
    Pose::from_mm_deg([x + by.x, y + by.y, z + by.z, r])
}

/// From the start of a circle to where it is after `turn_deg`.
fn on_circle(
    [u, v]: [Vector3<f64>; 2],
    radius_mm: f64,
    start_deg: f64,
    turn_deg: f64,
) -> Vector3<f64> {
    let at = |degrees: f64| {
        let (sin, cos) = degrees.to_radians().sin_cos();
        radius_mm * (cos * u + sin * v)
    };
    at(start_deg + turn_deg) - at(start_deg)
}

/// One turn of a Lissajous figure through points no farther apart than [`CHORD_MM`].
fn figure(
    from: Pose,
    [u, v]: [Vector3<f64>; 2],
    [a, b]: [f64; 2],
    [m, n]: [u32; 2],
    phase_deg: f64,
) -> Vec<Pose> {
    let at = |turn: f64| {
        let first = (f64::from(m) * turn + phase_deg.to_radians()).sin();
        a * first * u + b * (f64::from(n) * turn).sin() * v
    };
    // The speed in `turn` is nowhere above this, so no chord is longer than CHORD_MM.
    let fastest = (a * f64::from(m)).hypot(b * f64::from(n));
    let n_points = (TAU * fastest / CHORD_MM).ceil().clamp(16.0, 1e6) as usize;
    let begin = at(0.0);
    let point = |i: usize| moved(from, at(TAU * i as f64 / n_points as f64) - begin);
    (0..n_points).map(point).chain(std::iter::once(from)).collect()
}
