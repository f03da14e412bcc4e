//! From a description to a path: each segment begins where the last one ended.

use super::path_error::PathError;
use super::segment::{
    Direction, DrawingPlane, MAX_DURATION_S, RatesOverride, Segment, SegmentKind, Turns,
};
use super::{MotionCommand, Rates, StepSettings, ToolCurve, ToolPath, Trajectory, Trapezoid};
use crate::rig::{Pose, Rig};
use evrig_core::units::{
    DegreesPerSecond, DegreesPerSecond2, MillimetresPerSecond, MillimetresPerSecond2,
};
use nalgebra::Vector3;
use std::f64::consts::TAU;

/// More motions than any recording has; bounds the memory of nested repeats.
pub(super) const MAX_STEPS: usize = 20_000;

/// More points of drawn curves than any recording has, for the same reason.
pub(super) const MAX_POINTS: usize = 2_000_000;

/// Repeats within repeats.
pub(super) const MAX_DEPTH: usize = 16;

/// Spacing of the points of a drawn curve: the corner between two chords stays below 0.1 degree
/// on a radius of 60 mm, and their sagitta far below the arm's repeatability.
const MAX_CHORD_MM: f64 = 0.1;

/// The ARC parameters of the published recordings, where a description states no turn rates.
const DEFAULT_TURN_RATES: [f64; 2] = [50.0, 50.0];

/// Which segments become motions.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OptionalSegments {
    /// All of them.
    Included,
    /// Without those that the description calls optional.
    LeftOut,
}

impl Trajectory {
    /// The path on this rig, whose mount determines the image plane and the sense of rotation.
    ///
    /// # Errors
    /// When a segment makes no curve. Reach and speed are not checked here: see [`super::Plan`].
    pub fn path(&self, rig: &Rig, optional: OptionalSegments) -> Result<ToolPath, PathError> {
        let camera = rig.mount.davis.frame(self.start);
        let mut builder = Builder {
            trajectory: self,
            image: [camera.right, -camera.down],
            forward: camera.forward,
            path: ToolPath::new(self.start),
            runs: vec![Vec::new(); self.segments.len()],
            n_points: 0,
            optional,
        };
        for (number, segment) in self.segments.iter().enumerate() {
            if !builder.leaves_out(segment) {
                builder.run(number, &SegmentRun::itself(segment, number))?;
            }
        }
        Ok(builder.path)
    }
}

struct Builder<'t> {
    trajectory: &'t Trajectory,
    /// Right and up in the DAVIS's image at the start pose.
    image: [Vector3<f64>; 2],
    /// Its optical axis there.
    forward: Vector3<f64>,
    path: ToolPath,
    /// The steps of each segment's last run.
    runs: Vec<Vec<usize>>,
    /// Points of drawn curves so far.
    n_points: usize,
    optional: OptionalSegments,
}

/// One run of a segment: by itself, or as part of a later one.
#[derive(Clone)]
struct SegmentRun {
    label: String,
    number: usize,
    /// Repeats around it.
    depth: usize,
    rates: RatesOverride,
    settings: StepSettings,
}

impl SegmentRun {
    fn itself(segment: &Segment, number: usize) -> Self {
        Self {
            label: segment.label.clone(),
            number,
            depth: 0,
            rates: segment.rates,
            settings: segment.settings.clone(),
        }
    }

    /// A prompt is shown, and the light flashes, before the first of several motions only.
    fn consume_prompt(&mut self) {
        self.settings.prompt = None;
        self.settings.n_flashes = 0;
    }

    fn too_many(&self, of_what: &'static str, limit: usize) -> PathError {
        PathError::TooMuch { segment: self.label.clone(), of_what, limit }
    }

    /// Part `label` of a segment that is itself run as `self`.
    fn part(&self, label: &str, segment: &Segment) -> Self {
        Self {
            label: format!("{}/{label}", self.label),
            number: self.number,
            depth: self.depth + 1,
            rates: self.rates.or(segment.rates),
            settings: self.settings.over(&segment.settings),
        }
    }
}

impl Builder<'_> {
    fn leaves_out(&self, segment: &Segment) -> bool {
        self.optional == OptionalSegments::LeftOut && segment.is_optional
    }

    fn run(&mut self, number: usize, run: &SegmentRun) -> Result<(), PathError> {
        let segments = &self.trajectory.segments;
        let segment = &segments[number];
        if run.depth > MAX_DEPTH {
            return Err(run.too_many("repeats within repeats", MAX_DEPTH));
        }
        let first = self.path.steps().len();
        let mut around = run.clone();
        match &segment.kind {
            SegmentKind::Dwell { duration } => {
                let rates = self.rates(run);
                let settings = run.settings.clone();
                self.path.push_hold(&run.label, run.number, *duration, rates, settings);
                self.check_bounds(run)?;
            }
            SegmentKind::Repeat { of, times } => {
                for time in 1..=*times {
                    for &part in of {
                        if self.leaves_out(&segments[part]) {
                            continue;
                        }
                        let name = &segments[part].label;
                        let label =
                            if *times > 1 { format!("{name}#{time}") } else { name.clone() };
                        self.run(part, &around.part(&label, &segments[part]))?;
                        around.consume_prompt();
                    }
                }
            }
            SegmentKind::Reverse { of } => {
                for &part in of.iter().rev() {
                    self.run_backwards(part, &mut around)?;
                }
            }
            SegmentKind::Sweep { of, speeds_mm_per_s, alternate } => {
                for (i, speed) in speeds_mm_per_s.iter().enumerate() {
                    let label = format!("{speed}mm/s");
                    let mut part = around.part(&label, &segments[*of]);
                    part.rates.speed_mm_per_s = Some(*speed);
                    if *alternate && i % 2 == 1 {
                        self.run_backwards(*of, &mut part)?;
                    } else {
                        self.run(*of, &part)?;
                    }
                    around.consume_prompt();
                }
            }
            _ => {
                let curve = self.curve(segment, run)?;
                self.push(curve, run)?;
            }
        }
        self.runs[number] = (first..self.path.steps().len()).collect();
        Ok(())
    }

    fn push(&mut self, curve: ToolCurve, run: &SegmentRun) -> Result<(), PathError> {
        if let MotionCommand::Points(poses) = curve.motion() {
            self.n_points += poses.len();
        }
        let rates = self.rates(run);
        let settings = run.settings.clone();
        self.path.push(&run.label, run.number, curve, rates, settings);
        self.check_bounds(run)
    }

    fn check_bounds(&self, run: &SegmentRun) -> Result<(), PathError> {
        if self.path.steps().len() > MAX_STEPS {
            return Err(run.too_many("motions", MAX_STEPS));
        }
        if self.n_points > MAX_POINTS {
            return Err(run.too_many("points of drawn curves", MAX_POINTS));
        }
        if self.path.duration().as_secs_f64() > MAX_DURATION_S {
            return Err(run.too_many("seconds", MAX_DURATION_S as usize));
        }
        Ok(())
    }

    fn run_backwards(&mut self, part: usize, run: &mut SegmentRun) -> Result<(), PathError> {
        let of = self.trajectory.segments[part].label.clone();
        let name = run.label.clone();
        let steps = std::mem::take(&mut self.runs[part]);
        if steps.is_empty() {
            return Err(PathError::NotRun { segment: name, of });
        }
        for &step in steps.iter().rev() {
            let there = &self.path.steps()[step];
            let (duration, curve) = (there.duration, there.curve.reversed());
            let (expected, got) = (curve.from(), self.path.end());
            let away = expected.distance(got);
            if away.0 > 1e-6 || (expected.r - got.r).abs().0 > 1e-6 {
                return Err(PathError::NotAtEnd { segment: name, of, expected, got, away });
            }
            if curve.length().0 > 0.0 || curve.turn().0 != 0.0 {
                self.push(curve, run)?;
            } else {
                let (rates, settings) = (self.rates(run), run.settings.clone());
                self.path.push_hold(&run.label, run.number, duration, rates, settings);
                self.check_bounds(run)?;
            }
            run.consume_prompt();
        }
        self.runs[part] = steps;
        Ok(())
    }

    fn rates(&self, run: &SegmentRun) -> Rates {
        let rates = run.rates.or(self.trajectory.rates);
        let [turn_speed, turn_acceleration] = DEFAULT_TURN_RATES;
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
            DrawingPlane::Image => self.image,
            DrawingPlane::Xy => [Vector3::x(), Vector3::y()],
            DrawingPlane::Xz => [Vector3::x(), Vector3::z()],
            DrawingPlane::Yz => [Vector3::y(), Vector3::z()],
        }
    }

    fn curve(&self, segment: &Segment, run: &SegmentRun) -> Result<ToolCurve, PathError> {
        let from = self.path.end();
        let [u, v] = self.plane(segment);
        let failed = |source| PathError::Curve { segment: run.label.clone(), source };
        match &segment.kind {
            SegmentKind::Line { to: Some(to), .. } => Ok(ToolCurve::line(from, *to)),
            SegmentKind::Line { by_mm, turn_deg, to: None } => {
                let to = moved(from, by_mm[0] * u + by_mm[1] * v);
                let r = evrig_core::units::Degrees(from.r.0 + turn_deg);
                Ok(ToolCurve::line(from, Pose { r, ..to }))
            }
            SegmentKind::Arc { radius_mm, direction, start_deg, sweep_deg } => {
                let turn = self.sense(*direction, [u, v], run)? * sweep_deg;
                let [via, to] = [0.5, 1.0].map(|part| {
                    moved(from, on_circle([u, v], *radius_mm, *start_deg, part * turn))
                });
                ToolCurve::arc(from, via, to).map_err(failed)
            }
            SegmentKind::Circle { radius_mm, direction, start_deg, turns } => {
                let turn = self.sense(*direction, [u, v], run)? * 360.0;
                let [via, opposite] = [0.25, 0.5].map(|part| {
                    moved(from, on_circle([u, v], *radius_mm, *start_deg, part * turn))
                });
                let n_turns = self.count(*turns, radius_mm * TAU, run);
                ToolCurve::circle(from, via, opposite, n_turns).map_err(failed)
            }
            SegmentKind::Lissajous { amplitude_mm, cycles, phase_deg, turns } => {
                let figure = figure(from, [u, v], *amplitude_mm, *cycles, *phase_deg);
                let once = ToolCurve::points(figure.clone()).map_err(failed)?;
                let n_turns = self.count(*turns, once.length().0, run) as usize;
                if n_turns.saturating_mul(figure.len()) > MAX_POINTS {
                    return Err(run.too_many("points of drawn curves", MAX_POINTS));
                }
                let again = figure.iter().skip(1).cycle().take((n_turns - 1) * (figure.len() - 1));
                let all = figure.iter().chain(again).copied().collect();
                ToolCurve::points(all).map_err(failed)
            }
            SegmentKind::Dwell { .. }
            | SegmentKind::Repeat { .. }
            | SegmentKind::Reverse { .. }
            | SegmentKind::Sweep { .. } => Ok(ToolCurve::line(from, from)),
        }
    }

    /// +1 where the direction turns u towards v, -1 where it turns v towards u.
    fn sense(
        &self,
        direction: Direction,
        [u, v]: [Vector3<f64>; 2],
        run: &SegmentRun,
    ) -> Result<f64, PathError> {
        // Where u x v points away from the camera, u towards v looks clockwise to it.
        let away = u.cross(&v).dot(&self.forward);
        if away.abs() < 0.02 {
            return Err(PathError::EdgeOn { segment: run.label.clone() });
        }
        Ok(match direction {
            Direction::Clockwise => away.signum(),
            Direction::Anticlockwise => -away.signum(),
        })
    }

    fn count(&self, turns: Turns, length_mm: f64, run: &SegmentRun) -> u32 {
        let duration = match turns {
            Turns::Count(count) => return count,
            Turns::Lasting(duration) => duration.as_secs_f64(),
        };
        let rates = self.rates(run);
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

/// One turn of a Lissajous figure through points no farther apart than [`MAX_CHORD_MM`].
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
    // The speed in `turn` is nowhere above this, so no chord is longer than MAX_CHORD_MM.
    let fastest = (a * f64::from(m)).hypot(b * f64::from(n));
    let n_points = (TAU * fastest / MAX_CHORD_MM).ceil().clamp(16.0, 1e6) as usize;
    let begin = at(0.0);
    let point = |i: usize| moved(from, at(TAU * i as f64 / n_points as f64) - begin);
    (0..n_points).map(point).chain(std::iter::once(from)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use evrig_core::time::Span;
    use proptest::prelude::*;

    const HEAD: &str = "schema = 'evrig.trajectory/1'\nname = 't'\n\
        [start]\nx_mm = 240\ny_mm = 0\nz_mm = 100\nr_deg = 90\n\
        [rates]\nspeed_mm_per_s = 50\nacceleration_mm_per_s2 = 50\n";
    const CIRCLE: &str = "[[segment]]\nkind = 'circle'\nlabel = 'c'\nradius_mm = 12\n\
        direction = 'clockwise'\nstart_deg = 180\nturns = 1\n";

    fn path_on(rig: &Rig, segments: &str) -> Result<ToolPath, PathError> {
        let text = format!("{HEAD}{segments}");
        let trajectory = Trajectory::parse("t.toml", &text).unwrap_or_else(|e| panic!("{e}"));
        trajectory.path(rig, OptionalSegments::Included)
    }

    fn path(segments: &str) -> Result<ToolPath, PathError> {
        path_on(&Rig::simulated().unwrap(), segments)
    }

    /// Signed area of a path in the DAVIS's image, columns to the right and rows down:
    /// positive when it runs clockwise as the camera sees it.
    fn area_seen(path: &ToolPath, rig: &Rig) -> f64 {
        let camera = rig.mount.davis.frame(path.start());
        let n = 1000;
        let at = |i: i32| {
            let share = f64::from(i) / f64::from(n);
            let pose = path.pose_at(Span::from_secs_f64(path.duration().as_secs_f64() * share));
            let [x, y, _] = camera.to_camera(Vector3::from(pose.position_mm()));
            [x, y]
        };
        let cross = |[a, b]: [f64; 2], [c, d]: [f64; 2]| a * d - b * c;
        (0..n).map(|i| 0.5 * cross(at(i), at(i + 1))).sum()
    }

    #[test]
    fn clockwise_is_clockwise_as_the_camera_sees_it_wherever_it_looks() {
        for axis in ["[0.0, 0.0, -1.0]", "[0.0, 0.0, 1.0]", "[0.0, -1.0, 0.0]", "[0.3, -0.5, -0.7]"]
        {
            let text = Rig::simulated().unwrap().text;
            let text = text.replacen("axis = [0.0, 0.0, -1.0]", &format!("axis = {axis}"), 1);
            let rig = Rig::parse("tilted.toml", &text).unwrap();
            let circle = std::f64::consts::PI * 144.0;
            for (direction, area) in [("clockwise", circle), ("anticlockwise", -circle)] {
                let path = path_on(&rig, &CIRCLE.replace("clockwise", direction)).unwrap();
                assert!(
                    (area_seen(&path, &rig) - area).abs() < 0.01 * circle,
                    "{axis} {direction}"
                );
            }
        }
    }

    #[test]
    fn in_a_plane_of_the_base_clockwise_is_still_as_the_camera_sees_it() {
        let rig = Rig::simulated().unwrap();
        let flat = path(&format!("{CIRCLE}plane = 'xy'")).unwrap();
        assert!(area_seen(&flat, &rig) > 0.0);
        let edge_on = path(&format!("{CIRCLE}plane = 'xz'"));
        assert!(matches!(edge_on, Err(PathError::EdgeOn { .. })), "{edge_on:?}");
    }

    #[test]
    fn reverse_runs_the_same_way_backwards() {
        let back = "[[segment]]\nkind = 'reverse'\nlabel = 'b'\nof = ['c']\n";
        let path = path(&format!("{CIRCLE}{back}")).unwrap();
        let total = path.duration().as_secs_f64();
        for share in [0.1, 0.3, 0.45] {
            let there = path.pose_at(Span::from_secs_f64(share * total));
            let mirrored = path.pose_at(Span::from_secs_f64((1.0 - share) * total));
            assert!(there.distance(mirrored).0 < 1e-6);
        }
        assert_eq!(path.steps()[1].label, "b");
    }

    #[test]
    fn reverse_from_elsewhere_is_refused_with_both_poses() {
        let line = "[[segment]]\nkind = 'line'\nlabel = 'l'\nby_mm = [5, 0]\n";
        let back = "[[segment]]\nkind = 'reverse'\nlabel = 'b'\nof = ['c']\n";
        let error = path(&format!("{CIRCLE}{line}{back}")).unwrap_err();
        let PathError::NotAtEnd { away, .. } = &error else { panic!("{error:?}") };
        assert!((away.0 - 5.0).abs() < 1e-9, "{error}");
    }

    #[test]
    fn whole_turns_fill_a_duration_and_not_one_more() {
        for seconds in [0.1, 2.6, 10.0, 61.0] {
            let by_time = CIRCLE.replace("turns = 1", &format!("duration_s = {seconds}"));
            let path = path(&by_time).unwrap();
            let crate::trajectory::MotionCommand::Circle { turns, .. } =
                path.steps()[0].curve.motion()
            else {
                panic!("{:?}", path.steps()[0])
            };
            let lasting = |n: u32| TAU * 12.0 * f64::from(n) / 50.0 + 1.0;
            assert!((path.duration().as_secs_f64() - lasting(turns)).abs() < 1e-6);
            assert!(lasting(turns) >= seconds && (turns == 1 || lasting(turns - 1) < seconds));
        }
    }

    #[test]
    fn a_sweep_runs_every_speed_and_alternates() {
        let sweep = "[[segment]]\nkind = 'sweep'\nlabel = 's'\nof = 'c'\n\
            speeds_mm_per_s = [10, 20, 40]\nalternate = true\n";
        let path = path(&format!("{CIRCLE}{sweep}")).unwrap();
        let labels: Vec<_> = path.steps().iter().map(|step| step.label.as_str()).collect();
        assert_eq!(labels, ["c", "s/10mm/s", "s/20mm/s", "s/40mm/s"]);
        let early = |step: usize| {
            let step = &path.steps()[step];
            step.pose_at(Span::from_secs_f64(0.25 * step.duration.as_secs_f64())).y.0
        };
        assert!(early(1) > 0.0 && early(2) < 0.0 && early(3) > 0.0);
        assert!((path.steps()[2].peak_speed().0 - 20.0).abs() < 1e-9);
    }

    #[test]
    fn a_figure_of_eight_closes_and_is_as_wide_and_high_as_stated() {
        let eight = "[[segment]]\nkind = 'lissajous'\nlabel = 'e'\namplitude_mm = [12, 8]\n\
            cycles = [1, 2]\nturns = 2\n";
        let path = path(eight).unwrap();
        assert!(path.end().distance(path.start()).0 < 1e-9);
        let extent = |axis: usize| {
            (0..=4000)
                .map(|i| path.steps()[0].curve.pose_at(f64::from(i) / 4000.0).position_mm()[axis])
                .fold([f64::INFINITY, f64::NEG_INFINITY], |[l, h], v| [l.min(v), h.max(v)])
        };
        let [left, right] = extent(0);
        let [bottom, top] = extent(1);
        assert!((right - left - 24.0).abs() < 0.01 && (top - bottom - 16.0).abs() < 0.01);
        assert!((path.length().0 - 2.0 * EIGHT_MM).abs() < 0.01, "{}", path.length());
    }

    /// Length of one turn of (12 sin s, 8 sin 2s), by Python:
    /// `h = 2*pi/200000; sum(hypot(12*cos(i*h), 16*cos(2*i*h)) for i in range(200000)) * h`.
    const EIGHT_MM: f64 = 85.730_350;

    #[test]
    fn repeats_of_repeats_end_at_a_limit_instead_of_filling_memory() {
        let mut text = CIRCLE.to_owned();
        for (i, of) in ["c", "r0", "r1"].iter().enumerate() {
            text += &format!(
                "[[segment]]\nkind = 'repeat'\nlabel = 'r{i}'\nof = ['{of}']\ntimes = 10000\n"
            );
        }
        assert!(matches!(path(&text), Err(PathError::TooMuch { .. })));
    }

    #[test]
    fn what_is_left_out_is_left_out_of_repeats_too() {
        let dark = "[[segment]]\nkind = 'dwell'\nlabel = 'dark'\nduration_s = 3\noptional = true\n";
        let again = "[[segment]]\nkind = 'repeat'\nlabel = 'r'\nof = ['dark', 'c']\ntimes = 2\n";
        let trajectory =
            Trajectory::parse("t.toml", &format!("{HEAD}{dark}{CIRCLE}{again}")).unwrap();
        let rig = Rig::simulated().unwrap();
        let labels = |optional| -> Vec<String> {
            let path = trajectory.path(&rig, optional).unwrap();
            path.steps().iter().map(|step| step.label.clone()).collect()
        };
        assert_eq!(labels(OptionalSegments::LeftOut), ["c", "r/c#1", "r/c#2"]);
        assert_eq!(labels(OptionalSegments::Included).len(), 6);
    }

    #[test]
    fn what_would_take_days_is_refused() {
        let slow = CIRCLE.replace("turns = 1", "turns = 10000\nspeed_mm_per_s = 0.05");
        let error = path(&slow).unwrap_err();
        assert!(matches!(error, PathError::TooMuch { of_what: "seconds", .. }), "{error}");
    }

    proptest! {
        #[test]
        fn a_path_has_no_jumps_and_keeps_its_rates(
            radius in 1.0..100.0_f64, start in -180.0..180.0_f64, by in -50.0..50.0_f64,
            sweep in 1.0..359.0_f64, turn in -90.0..90.0_f64, speed in 1.0..200.0_f64, at in 0.0..1.0_f64,
        ) {
            let text = format!(
                "{}[[segment]]\nkind = 'line'\nlabel = 'l'\nby_mm = [{by}, 3]\nturn_deg = {turn}\n\
                 [[segment]]\nkind = 'arc'\nlabel = 'a'\nradius_mm = {radius}\nsweep_deg = \
                 {sweep}\n\
                 direction = 'anticlockwise'\nstart_deg = {start}\nspeed_mm_per_s = {speed}\n\
                 [[segment]]\nkind = 'lissajous'\nlabel = 'e'\namplitude_mm = [{radius}, 3]\n\
                 cycles = [2, 3]\nphase_deg = {start}\nturns = 1\n\
                 [[segment]]\nkind = 'reverse'\nlabel = 'back'\nof = ['l', 'a', 'e']\n",
                CIRCLE.replace("= 180", &format!("= {start}"))
            );
            let path = path(&text).unwrap();
            prop_assert!(path.end().distance(path.start()).0 < 1e-6, "back where it began");
            for pair in path.steps().windows(2) {
                prop_assert!(pair[0].curve.to().distance(pair[1].curve.from()).0 < 1e-9);
                prop_assert_eq!(pair[0].start + pair[0].duration, pair[1].start);
            }
            let time = Span::from_secs_f64(path.duration().as_secs_f64() * at);
            let here = path.at(time).unwrap();
            let soon = path.pose_at(time + Span::from_micros(100));
            let limit = path.steps()[here.step].rates.speed.0.max(50.0).max(speed);
            prop_assert!(here.pose.distance(soon).0 <= limit * 1e-4 * 1.001);
            prop_assert!(here.speed.0 <= path.steps()[here.step].rates.speed.0 * (1.0 + 1e-9));
        }
    }

    #[test]
    fn what_a_repeat_sets_holds_for_its_parts() {
        let dim = "[[segment]]\nkind = 'repeat'\nlabel = 'dim'\nof = ['c']\ntimes = 2\n\
            set = { light_level = 0.2, n_flashes = 2 }\nprompt = 'Dim it.'\n";
        let path = path(&format!("{CIRCLE}{dim}")).unwrap();
        let levels: Vec<_> = path.steps().iter().map(|s| s.settings.light_level).collect();
        assert_eq!(levels, [None, Some(0.2), Some(0.2)]);
        assert_eq!(path.steps()[2].label, "dim/c#2");
        let asks: Vec<_> = path.steps().iter().map(|s| s.settings.prompt.is_some()).collect();
        let flashes: Vec<_> = path.steps().iter().map(|s| s.settings.n_flashes).collect();
        assert_eq!((asks, flashes), (vec![false, true, false], vec![0, 2, 0]));
    }
}
