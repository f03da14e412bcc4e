//! Target, light and clocks of a rig description.

use super::fields::DescriptionFields;
use evrig_core::keyword::UnknownKeyword;
use evrig_core::units::{Degrees, Hertz, Millimetres};
use std::str::FromStr;

/// The target (print or screen) with its tag: the image is to the left of the tag, bottoms aligned.
#[derive(Debug, Clone, PartialEq)]
pub struct TargetDescription {
    /// The tag's family.
    pub tag_family: String,
    /// The tag's number in its family.
    pub tag_id: u32,
    /// Side of the tag's black border.
    pub tag_side: Millimetres,
    /// Side of the image.
    pub picture_side: Millimetres,
    /// From the image's right edge to the tag's left edge.
    pub gap: Millimetres,
    /// From the cameras' optical centres to the target along their axis.
    pub stand_off: Millimetres,
    /// Middle of image and tag together in the base frame, where it is known.
    pub centre: Option<[Millimetres; 3]>,
    /// Rotation of the target in the DAVIS's image, clockwise.
    pub rotation: Degrees,
}

/// Properties of the light.
#[derive(Debug, Clone, PartialEq)]
pub struct LightDescription {
    /// Description of the lamps or the screen.
    pub source: String,
    /// Illuminance on the target in lux, where it was measured.
    pub illuminance_lx: Option<f64>,
    /// Frequency of its flicker, where it has any.
    pub flicker: Option<Hertz>,
    /// The arm's output (1..=20) that switches it, where one does.
    pub switched_by_output: Option<u8>,
}

/// How a clock is disciplined.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ClockDiscipline {
    /// The simulated clock of the simulated rig.
    Sim,
    /// chrony disciplines it.
    Chrony,
    /// systemd-timesyncd disciplines it.
    Timesyncd,
    /// It is not disciplined.
    None,
}

/// The clocks of host and Pi.
#[derive(Debug, Clone, PartialEq)]
pub struct ClocksDescription {
    /// Which machine's clock the others are mapped to.
    pub reference: String,
    /// Discipline of the host's clock.
    pub host: ClockDiscipline,
    /// Discipline of the Pi's clock.
    pub pi: ClockDiscipline,
    /// The time server, where there is one.
    pub ntp_server: Option<String>,
}

impl FromStr for ClockDiscipline {
    type Err = UnknownKeyword;

    fn from_str(text: &str) -> Result<Self, UnknownKeyword> {
        match text {
            "sim" => Ok(Self::Sim),
            "chrony" => Ok(Self::Chrony),
            "timesyncd" => Ok(Self::Timesyncd),
            "none" => Ok(Self::None),
            other => Err(UnknownKeyword::new(other, "sim, chrony, timesyncd or none")),
        }
    }
}

/// Tag families the tracker knows.
const TAG_FAMILIES: &[&str] =
    &["tag36h11", "tag25h9", "tag16h5", "tagCircle21h7", "tagCircle49h12", "tagStandard41h12"];

impl TargetDescription {
    /// Width of image, gap and tag together.
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
