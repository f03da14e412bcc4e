//! What the cameras look at: the target, its light; and the clocks of a rig description.

use super::fields::DescriptionFields;
use evrig_core::units::{Degrees, Hertz, Millimetres};
use std::str::FromStr;

/// The print (or screen) with its tag: the picture lies to the left of the tag, bottoms aligned.
#[derive(Debug, Clone, PartialEq)]
pub struct TargetDescription {
    /// The tag's family.
    pub tag_family: String,
    /// The tag's number in its family.
    pub tag_id: u32,
    /// Side of the tag's black border.
    pub tag_side: Millimetres,
    /// Side of the picture.
    pub picture_side: Millimetres,
    /// From the picture's right edge to the tag's left edge.
    pub gap: Millimetres,
    /// From the cameras' optical centres to the target along their axis.
    pub stand_off: Millimetres,
    /// Middle of picture and tag together in the base frame, where it is known.
    pub centre: Option<[Millimetres; 3]>,
    /// Turn of the target in the DAVIS's picture, clockwise.
    pub rotation: Degrees,
}

/// What is known of the light.
#[derive(Debug, Clone, PartialEq)]
pub struct LightDescription {
    /// In words: which lamps, which screen.
    pub source: String,
    /// Illuminance on the target in lux, where it was measured.
    pub illuminance_lx: Option<f64>,
    /// Frequency of its flicker, where it has any.
    pub flicker: Option<Hertz>,
    /// The arm's output (1..=20) that switches it, where one does.
    pub switched_by_output: Option<u8>,
}

/// How a host's clock is kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ClockDiscipline {
    /// The simulated clock of the simulated rig.
    Sim,
    /// chrony keeps it.
    Chrony,
    /// systemd-timesyncd keeps it.
    Timesyncd,
    /// Nothing keeps it.
    None,
}

/// The clocks of host and Pi.
#[derive(Debug, Clone, PartialEq)]
pub struct ClocksDescription {
    /// Which machine's clock the others are mapped to.
    pub reference: String,
    /// How the host's clock is kept.
    pub host: ClockDiscipline,
    /// How the Pi's clock is kept.
    pub pi: ClockDiscipline,
    /// The time server, where there is one.
    pub ntp_server: Option<String>,
}

/// A way to keep a clock that is none.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("`{0}` is no way to keep a clock; expected sim, chrony, timesyncd or none")]
pub struct UnknownDiscipline(String);

impl FromStr for ClockDiscipline {
    type Err = UnknownDiscipline;

    fn from_str(text: &str) -> Result<Self, UnknownDiscipline> {
        match text {
            "sim" => Ok(Self::Sim),
            "chrony" => Ok(Self::Chrony),
            "timesyncd" => Ok(Self::Timesyncd),
            "none" => Ok(Self::None),
            other => Err(UnknownDiscipline(other.to_owned())),
        }
    }
}

/// Tag families the tracker knows.
const TAG_FAMILIES: &[&str] =
    &["tag36h11", "tag25h9", "tag16h5", "tagCircle21h7", "tagCircle49h12", "tagStandard41h12"];

impl TargetDescription {
    /// Width of picture, gap and tag together.
    #[must_use]
    pub fn width(&self) -> Millimetres {
        self.picture_side + self.gap + self.tag_side
    }

    pub(super) fn read(fields: &DescriptionFields<'_, '_>) -> Self {
        let mm = |key, low: f64| Millimetres(fields.number(key, low..=5000.0));
        let tag_family = fields.text("tag_family");
        if !tag_family.is_empty() && !TAG_FAMILIES.contains(&tag_family.as_str()) {
            let known = TAG_FAMILIES.join(", ");
            fields.complain_about("tag_family", format!("`{tag_family}` is none of {known}"));
        }
        let has_centre = fields.has("centre_mm");
        Self {
            tag_family,
            tag_id: fields.integer("tag_id", 0.0..=100_000.0),
            tag_side: mm("tag_side_mm", 0.1),
            picture_side: mm("picture_side_mm", 0.1),
            gap: mm("gap_mm", 0.0),
            stand_off: mm("stand_off_mm", 1.0),
            centre: has_centre
                .then(|| fields.numbers("centre_mm", -5000.0..=5000.0).map(Millimetres)),
            rotation: Degrees(
                fields.optional_number("rotation_deg", -360.0..=360.0).unwrap_or(0.0),
            ),
        }
    }
}

impl LightDescription {
    pub(super) fn read(fields: &DescriptionFields<'_, '_>) -> Self {
        Self {
            source: fields.text("source"),
            illuminance_lx: fields.optional_number("illuminance_lx", 0.0..=200_000.0),
            flicker: fields.optional_number("flicker_hz", 0.0..=1e5).map(Hertz),
            switched_by_output: fields.optional_integer("switched_by_output", 1.0..=20.0),
        }
    }
}

impl ClocksDescription {
    pub(super) fn read(fields: &DescriptionFields<'_, '_>) -> Self {
        fields.require("host");
        fields.require("pi");
        Self {
            reference: fields.text("reference"),
            host: fields.parsed("host").unwrap_or(ClockDiscipline::None),
            pi: fields.parsed("pi").unwrap_or(ClockDiscipline::None),
            ntp_server: fields.optional_text("ntp_server"),
        }
    }
}
