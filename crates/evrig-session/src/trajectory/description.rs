//! A trajectory file, independent of a rig.

use super::segment::{DrawingPlane, RatesOverride, Segment};
use crate::rig::{DescriptionError, Pose, find_text, read_description, read_text};
use std::path::Path;

/// A motion description.
#[derive(Debug, Clone, PartialEq)]
pub struct Trajectory {
    /// Its name.
    pub name: String,
    /// One sentence for people.
    pub description: Option<String>,
    /// Where it begins.
    pub start: Pose,
    /// Default plane of its segments.
    pub plane: DrawingPlane,
    /// Default rates of its segments.
    pub rates: RatesOverride,
    /// What it does, in order.
    pub segments: Vec<Segment>,
    /// The description as it was read, for the manifest.
    pub text: String,
}

/// The current version of the keys, and the former one, which is still read.
const SCHEMAS: [&str; 2] = ["evrig.trajectory/2", "evrig.trajectory/1"];

macro_rules! bundled {
    ($name:literal) => {{
        const TEXT: &str = include_str!(concat!("../../../../trajectories/", $name, ".toml"));
        ($name, concat!("trajectories/", $name, ".toml"), TEXT)
    }};
}

/// The descriptions that every copy of the program carries: name, file, text.
const BUNDLED: &[(&str, &str, &str)] = &[
    bundled!("circle"),
    bundled!("line"),
    bundled!("figure-eight"),
    bundled!("speed-sweep"),
    bundled!("protocol"),
    bundled!("protocol-short"),
];

impl Trajectory {
    /// The names of the descriptions that every copy of the program carries.
    pub fn bundled_names() -> impl Iterator<Item = &'static str> {
        BUNDLED.iter().map(|(name, _, _)| *name)
    }

    /// The trajectory that a user names: a file, or the name of a bundled description.
    ///
    /// # Errors
    /// When it is neither, cannot be read, or with all its mistakes.
    pub fn find(named: &str) -> Result<Self, DescriptionError> {
        let (file, text) = find_text("trajectory", named, BUNDLED)?;
        Self::parse(&file, &text)
    }

    /// Reads a trajectory file.
    ///
    /// # Errors
    /// When the file cannot be read, or with all its mistakes.
    pub fn read(path: &Path) -> Result<Self, DescriptionError> {
        Self::parse(&path.display().to_string(), &read_text(path)?)
    }

    /// Parses the text of a trajectory file; `file` is its name in messages.
    ///
    /// # Errors
    /// With all the mistakes in the text.
    pub fn parse(file: &str, text: &str) -> Result<Self, DescriptionError> {
        read_description(file, text, |fields| {
            let description = fields.description(SCHEMAS);
            let mut labels = Vec::new();
            let segments = fields.tables("segment", |number, fields| {
                let segment = Segment::read(fields, number, &labels);
                labels.push(segment.label.clone());
                segment
            });
            if segments.is_empty() && fields.has("segment") {
                fields.complain_about("segment", "a trajectory needs at least one segment");
            }
            Self {
                name: fields.text("name"),
                description,
                start: fields.table("start", Pose::read),
                plane: fields.parsed("plane").unwrap_or(DrawingPlane::Image),
                rates: fields.table("rates", |rates| {
                    rates.require("speed_mm_per_s");
                    rates.require("acceleration_mm_per_s2");
                    RatesOverride::read(rates)
                }),
                segments,
                text: text.to_owned(),
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CIRCLE: &str = include_str!("../../../../trajectories/circle.toml");

    #[test]
    fn a_description_of_the_former_schema_is_read() {
        let former = CIRCLE
            .replace("evrig.trajectory/2", "evrig.trajectory/1")
            .replace("description =", "says =");
        let read = Trajectory::parse("mine.toml", &former).unwrap();
        let current = Trajectory::find("circle").unwrap();
        assert!(read.description.is_some());
        assert_eq!(Trajectory { text: current.text.clone(), ..read }, current);
    }

    #[test]
    fn every_bundled_description_parses_under_its_own_name() {
        for name in Trajectory::bundled_names() {
            let trajectory = Trajectory::find(name).unwrap_or_else(|e| panic!("{e}"));
            assert_eq!(trajectory.name, name);
        }
    }

    #[test]
    fn every_file_in_the_folder_is_bundled() {
        for entry in
            std::fs::read_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/../../trajectories")).unwrap()
        {
            let path = entry.unwrap().path();
            let name = path.file_stem().unwrap().to_str().unwrap();
            assert!(Trajectory::bundled_names().any(|bundled| bundled == name), "{name}");
        }
    }

    #[test]
    fn mistakes_in_several_segments_are_named_with_their_lines() {
        let text = format!(
            "{CIRCLE}\n[[segment]]\nkind = \"cirle\"\nduration_s = 1\n\n[[segment]]\nkind \
             = \"repeat\"\n\
             of = [\"circel\"]\ntimes = 0\nspeed_mm_s = 3\n"
        );
        let error = Trajectory::parse("mine.toml", &text).unwrap_err();
        let message = error.to_string();
        for part in [
            "did you mean `circle`?",
            "no earlier segment is called `circel`",
            "0 is outside 1 to 10000",
            "did you mean `speed_mm_per_s`?",
        ] {
            assert!(message.contains(part), "`{part}` is not in: {message}");
        }
        let last = text.lines().count();
        assert!(message.contains(&format!("mine.toml:{last}: ")), "{message}");
    }

    #[test]
    fn turns_and_duration_exclude_each_other() {
        let text = CIRCLE.replace("turns = 1", "turns = 1\nduration_s = 3");
        let error = Trajectory::parse("mine.toml", &text).unwrap_err();
        assert!(error.to_string().contains("exclude each other"), "{error}");
    }

    #[test]
    fn two_segments_of_one_name_are_refused() {
        let text =
            format!("{CIRCLE}\n[[segment]]\nkind = \"dwell\"\nlabel = \"circle\"\nduration_s = 1");
        let error = Trajectory::parse("mine.toml", &text).unwrap_err();
        assert!(error.to_string().contains("earlier segment"), "{error}");
    }
}
