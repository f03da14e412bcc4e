//! The segments of a trajectory description.

use super::StepSettings;
use crate::rig::{DAVIS_BIASES, DescriptionFields, Pose};
use evrig_core::keyword::UnknownKeyword;
use evrig_core::time::Span;
use std::collections::BTreeMap;
use std::str::FromStr;

/// A day, in seconds: a longer duration is a mistake of the unit.
pub(super) const MAX_DURATION_S: f64 = 86_400.0;
const MAX_TURNS: f64 = 10_000.0;
/// Beyond the rates of any such arm: a value outside is a mistake of the unit.
const RATE_RANGE: std::ops::RangeInclusive<f64> = 0.01..=1e5;
const DISPLACEMENT_RANGE_MM: std::ops::RangeInclusive<f64> = -1000.0..=1000.0;

/// The plane in which a motion is drawn, with its first (u) and second (v) axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DrawingPlane {
    /// The DAVIS's image plane at the start pose: u to the right, v up.
    Image,
    /// u along the base's x, v along its y.
    Xy,
    /// u along the base's x, v along its z.
    Xz,
    /// u along the base's y, v along its z.
    Yz,
}

/// Which way round, as seen from the cameras towards the target.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Direction {
    /// With the clock.
    Clockwise,
    /// Against the clock.
    Anticlockwise,
}

impl FromStr for DrawingPlane {
    type Err = UnknownKeyword;
    fn from_str(text: &str) -> Result<Self, UnknownKeyword> {
        match text {
            "image" => Ok(Self::Image),
            "xy" => Ok(Self::Xy),
            "xz" => Ok(Self::Xz),
            "yz" => Ok(Self::Yz),
            _ => Err(UnknownKeyword::new(text, "image, xy, xz, yz")),
        }
    }
}

impl FromStr for Direction {
    type Err = UnknownKeyword;
    fn from_str(text: &str) -> Result<Self, UnknownKeyword> {
        match text {
            "clockwise" => Ok(Self::Clockwise),
            "anticlockwise" => Ok(Self::Anticlockwise),
            _ => Err(UnknownKeyword::new(text, "clockwise, anticlockwise")),
        }
    }
}

/// How often a closed curve is run without a stop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Turns {
    /// So often.
    Count(u32),
    /// The smallest number of whole turns that lasts at least so long.
    Lasting(Span),
}

/// Rates that differ from the trajectory's; the units are in the names.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct RatesOverride {
    pub(super) speed_mm_per_s: Option<f64>,
    pub(super) acceleration_mm_per_s2: Option<f64>,
    pub(super) turn_speed_deg_per_s: Option<f64>,
    pub(super) turn_acceleration_deg_per_s2: Option<f64>,
}

/// What a segment does; lengths in millimetres, angles in degrees.
#[derive(Debug, Clone, PartialEq)]
pub enum SegmentKind {
    /// Dwells.
    Dwell {
        /// How long.
        duration: Span,
    },
    /// Goes straight, by (u, v) in the plane or to a pose, and turns the wrist meanwhile.
    Line {
        /// Way in the plane.
        by_mm: [f64; 2],
        /// Where to instead, if stated.
        to: Option<Pose>,
        /// Turn of the wrist.
        turn_deg: f64,
    },
    /// Goes along a part of a circle.
    Arc {
        /// Of the circle.
        radius_mm: f64,
        /// Which way round.
        direction: Direction,
        /// Where on the circle it begins: angle from u towards v, seen from its centre.
        start_deg: f64,
        /// How far.
        sweep_deg: f64,
    },
    /// Goes round a circle.
    Circle {
        /// Of the circle.
        radius_mm: f64,
        /// Which way round.
        direction: Direction,
        /// Where on the circle it begins: angle from u towards v, seen from its centre.
        start_deg: f64,
        /// How often.
        turns: Turns,
    },
    /// Goes round the figure (a sin(m s + phase), b sin(n s)), s from 0 to a full turn.
    Lissajous {
        /// Half width and half height (a, b).
        amplitude_mm: [f64; 2],
        /// (m, n); a figure of eight on its side is (1, 2) with no phase.
        cycles: [u32; 2],
        /// Of the first.
        phase_deg: f64,
        /// How often.
        turns: Turns,
    },
    /// Runs earlier segments again, in the order given.
    Repeat {
        /// Their numbers.
        of: Vec<usize>,
        /// How often.
        times: u32,
    },
    /// Runs the way of earlier segments backwards, the last one first.
    Reverse {
        /// Their numbers.
        of: Vec<usize>,
    },
    /// Runs one earlier segment at one speed after another.
    Sweep {
        /// Its number.
        of: usize,
        /// The speeds.
        speeds_mm_per_s: Vec<f64>,
        /// Whether every second run goes backwards.
        alternate: bool,
    },
}

/// One segment of a description.
#[derive(Debug, Clone, PartialEq)]
pub struct Segment {
    /// Its name, unique in the description.
    pub label: String,
    /// What it does.
    pub kind: SegmentKind,
    /// Where it is drawn, if not in the trajectory's plane.
    pub plane: Option<DrawingPlane>,
    /// How fast, where it differs from the trajectory.
    pub rates: RatesOverride,
    /// What else holds meanwhile.
    pub settings: StepSettings,
    /// Whether it may be left out (a step that needs the operator).
    pub is_optional: bool,
}

/// Every kind, as the description writes it.
const KIND_NAMES: &[&str] =
    &["dwell", "line", "arc", "circle", "lissajous", "repeat", "reverse", "sweep"];

impl RatesOverride {
    pub(super) fn read(fields: &DescriptionFields<'_, '_>) -> Self {
        let rate = |key| fields.optional_number(key, RATE_RANGE);
        Self {
            speed_mm_per_s: rate("speed_mm_per_s"),
            acceleration_mm_per_s2: rate("acceleration_mm_per_s2"),
            turn_speed_deg_per_s: rate("turn_speed_deg_per_s"),
            turn_acceleration_deg_per_s2: rate("turn_acceleration_deg_per_s2"),
        }
    }

    /// These, and where they are absent, those of `others`.
    pub(super) fn or(self, others: Self) -> Self {
        Self {
            speed_mm_per_s: self.speed_mm_per_s.or(others.speed_mm_per_s),
            acceleration_mm_per_s2: self.acceleration_mm_per_s2.or(others.acceleration_mm_per_s2),
            turn_speed_deg_per_s: self.turn_speed_deg_per_s.or(others.turn_speed_deg_per_s),
            turn_acceleration_deg_per_s2: self
                .turn_acceleration_deg_per_s2
                .or(others.turn_acceleration_deg_per_s2),
        }
    }
}

impl StepSettings {
    fn read(fields: &DescriptionFields<'_, '_>) -> Self {
        let set = fields.optional_table("set", |set| Self {
            prompt: None,
            aps: set.optional_bool("aps"),
            exposure_scale: set.optional_number("exposure_scale", 0.01..=100.0),
            light_level: set.optional_number("light_level", 0.0..=1.0),
            n_flashes: set.optional_integer("n_flashes", 0.0..=100.0).unwrap_or(0),
            biases: set
                .optional_table("biases", |biases| {
                    biases
                        .named_integers(DAVIS_BIASES, 0.0..=2040.0)
                        .into_iter()
                        .map(|(name, value)| (name.to_owned(), value))
                        .collect::<BTreeMap<_, _>>()
                })
                .unwrap_or_default(),
        });
        Self { prompt: fields.optional_text("prompt"), ..set.unwrap_or_default() }
    }

    /// These, and where they are absent, those of `others`.
    pub(super) fn over(&self, others: &Self) -> Self {
        let mut biases = others.biases.clone();
        biases.extend(self.biases.clone());
        Self {
            prompt: self.prompt.clone().or_else(|| others.prompt.clone()),
            aps: self.aps.or(others.aps),
            exposure_scale: self.exposure_scale.or(others.exposure_scale),
            light_level: self.light_level.or(others.light_level),
            n_flashes: self.n_flashes.max(others.n_flashes),
            biases,
        }
    }
}

impl Segment {
    /// Reads segment number `number`; `earlier` are the labels it may refer to.
    pub(super) fn read(
        fields: &DescriptionFields<'_, '_>,
        number: usize,
        earlier: &[String],
    ) -> Self {
        let word = fields.text("kind");
        let label =
            fields.optional_text("label").unwrap_or_else(|| format!("{word}-{}", number + 1));
        if earlier.contains(&label) {
            fields.complain_about("label", format!("`{label}` is the name of an earlier segment"));
        }
        Self {
            kind: SegmentKind::read(fields, &word, earlier),
            plane: fields.parsed("plane"),
            rates: RatesOverride::read(fields),
            settings: StepSettings::read(fields),
            is_optional: fields.optional_bool("optional").unwrap_or(false),
            label,
        }
    }
}

impl SegmentKind {
    fn read(fields: &DescriptionFields<'_, '_>, word: &str, earlier: &[String]) -> Self {
        match word {
            "line" => Self::read_line(fields),
            "arc" => Self::Arc {
                radius_mm: fields.number("radius_mm", 0.1..=1000.0),
                direction: read_direction(fields),
                start_deg: fields.number("start_deg", -360.0..=360.0),
                sweep_deg: fields.number("sweep_deg", 1.0..=359.0),
            },
            "circle" => Self::Circle {
                radius_mm: fields.number("radius_mm", 0.1..=1000.0),
                direction: read_direction(fields),
                start_deg: fields.number("start_deg", -360.0..=360.0),
                turns: Turns::read(fields),
            },
            "lissajous" => Self::Lissajous {
                amplitude_mm: fields.numbers("amplitude_mm", 0.1..=1000.0),
                cycles: fields.numbers("cycles", 1.0..=20.0).map(|cycles| cycles as u32),
                phase_deg: fields.optional_number("phase_deg", -360.0..=360.0).unwrap_or(0.0),
                turns: Turns::read(fields),
            },
            "repeat" => {
                let of = read_labels(fields, earlier);
                Self::Repeat { of, times: fields.integer("times", 1.0..=MAX_TURNS) }
            }
            "reverse" => Self::Reverse { of: read_labels(fields, earlier) },
            "sweep" => Self::read_sweep(fields, earlier),
            other => {
                if !other.is_empty() && other != "dwell" {
                    let known = KIND_NAMES.join(", ");
                    let hint = crate::rig::closest(other, KIND_NAMES.iter().copied())
                        .map_or(String::new(), |kind| format!("; did you mean `{kind}`?"));
                    fields.complain_about("kind", format!("`{other}` is none of {known}{hint}"));
                }
                let seconds = fields.number("duration_s", 0.001..=MAX_DURATION_S);
                Self::Dwell { duration: Span::from_secs_f64(seconds) }
            }
        }
    }

    fn read_line(fields: &DescriptionFields<'_, '_>) -> Self {
        let to = fields.optional_table("to", Pose::read);
        let by_mm = fields.has("by_mm").then(|| fields.numbers("by_mm", DISPLACEMENT_RANGE_MM));
        let turn_deg = fields.optional_number("turn_deg", -360.0..=360.0);
        match (to, by_mm, turn_deg) {
            (None, None, None) => fields.complain("a line needs `by_mm`, `turn_deg` or `to`"),
            (Some(_), None, None) | (None, _, _) => {}
            _ => fields.complain("`to` is the whole goal: leave out `by_mm` and `turn_deg`"),
        }
        Self::Line { by_mm: by_mm.unwrap_or_default(), to, turn_deg: turn_deg.unwrap_or(0.0) }
    }

    fn read_sweep(fields: &DescriptionFields<'_, '_>, earlier: &[String]) -> Self {
        let of = read_labels(fields, earlier);
        if of.len() > 1 {
            fields.complain_about("of", "a sweep runs one segment; name one");
        }
        let speeds_mm_per_s = fields.list("speeds_mm_per_s", &RATE_RANGE);
        if speeds_mm_per_s.is_empty() {
            fields.complain_about("speeds_mm_per_s", "expected at least one speed");
        }
        Self::Sweep {
            of: of.first().copied().unwrap_or(0),
            speeds_mm_per_s,
            alternate: fields.optional_bool("alternate").unwrap_or(false),
        }
    }
}

impl Turns {
    fn read(fields: &DescriptionFields<'_, '_>) -> Self {
        let count = fields.optional_integer("turns", 1.0..=MAX_TURNS);
        let seconds = fields.optional_number("duration_s", 0.001..=MAX_DURATION_S);
        match (count, seconds) {
            (Some(_), Some(_)) => fields.complain("`turns` and `duration_s` exclude each other"),
            (None, None) => fields.complain("needs `turns` or `duration_s`"),
            _ => {}
        }
        seconds.map_or(Self::Count(count.unwrap_or(1)), |s| Self::Lasting(Span::from_secs_f64(s)))
    }
}

fn read_direction(fields: &DescriptionFields<'_, '_>) -> Direction {
    fields.require("direction");
    fields.parsed("direction").unwrap_or(Direction::Clockwise)
}

/// The numbers of the earlier segments that `of` names.
fn read_labels(fields: &DescriptionFields<'_, '_>, earlier: &[String]) -> Vec<usize> {
    let labels = fields.texts("of");
    if labels.is_empty() {
        fields.complain_about("of", "expected the labels of earlier segments");
    }
    let numbers = labels.iter().filter_map(|label| {
        let number = earlier.iter().position(|other| other == label);
        if number.is_none() {
            let hint = crate::rig::closest(label, earlier.iter().map(String::as_str))
                .map_or(String::new(), |near| format!("; did you mean `{near}`?"));
            fields.complain_about("of", format!("no earlier segment is called `{label}`{hint}"));
        }
        number
    });
    numbers.collect()
}
