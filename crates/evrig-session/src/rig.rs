//! The rig description: arm, mount, cameras, target, light and clocks, and the arm's kinematics.

mod arm;
mod camera;
mod fields;
mod kinematics;
mod limits;
mod mount;
mod pose;
mod problems;
pub mod tag;
mod target;
mod text;

pub use arm::{ArmDescription, ArmPort};
pub use camera::{
    CameraDescription, CameraTransport, DAVIS_BIASES, DavisDescription, PiDescription,
    middle_crop_origin_px,
};
pub use fields::{DescriptionFields, closest, read_description};
pub use kinematics::{Kinematics, Unreachable};
pub use limits::{Gauge, JointLimits, SpeedLimits, ToolRates, Workspace};
pub use mount::{CameraFrame, Mount, Mounting};
pub use pose::{Joints, Pose};
pub use problems::{DescriptionError, Problem};
pub use target::{ClockDiscipline, ClocksDescription, LightDescription, TargetDescription};

pub use text::{find_text, read_text};

use std::path::Path;

/// One set-up: arm, mount, cameras, target, light, clocks.
#[derive(Debug, Clone, PartialEq)]
pub struct Rig {
    /// Its name.
    pub name: String,
    /// One sentence for people.
    pub description: Option<String>,
    /// The arm.
    pub arm: ArmDescription,
    /// Mounting of the cameras.
    pub mount: Mount,
    /// The event camera.
    pub davis: DavisDescription,
    /// The frame camera.
    pub pi: PiDescription,
    /// The target.
    pub target: TargetDescription,
    /// The light.
    pub light: LightDescription,
    /// The clocks.
    pub clocks: ClocksDescription,
    /// The description as it was read, for the manifest.
    pub text: String,
}

/// The description of the simulated rig that every copy of the program carries.
const SIM: &str = include_str!("../../../rig/sim.toml");

/// All the descriptions that every copy of the program carries: name, file, text.
const BUNDLED: &[(&str, &str, &str)] = &[
    ("sim", "rig/sim.toml", SIM),
    ("magician", "rig/magician.toml", include_str!("../../../rig/magician.toml")),
];

/// The current version of the keys, and the former one, which is still read.
const SCHEMAS: [&str; 2] = ["evrig.rig/2", "evrig.rig/1"];

impl Rig {
    /// The simulated rig.
    ///
    /// # Errors
    /// Never, as long as the tests pass: they parse the same text.
    pub fn simulated() -> Result<Self, DescriptionError> {
        Self::parse("rig/sim.toml", SIM)
    }

    /// The rig that a user names: a file, or the name of a bundled description (`sim`, `magician`).
    ///
    /// # Errors
    /// When it is neither, cannot be read, or with all its mistakes.
    pub fn find(named: &str) -> Result<Self, DescriptionError> {
        let (file, text) = find_text("rig", named, BUNDLED)?;
        Self::parse(&file, &text)
    }

    /// The same rig with the Pi's RGB path off, in its text too: a session holds the rig as it was
    /// used.
    ///
    /// # Errors
    /// Never for a rig that was parsed: its text is a table with a `[pi]` in it.
    pub fn without_rgb(&self) -> Result<Self, DescriptionError> {
        let named = format!("{} without RGB", self.name);
        let mut text: toml::Table = toml::from_str(&self.text).unwrap_or_default();
        if let Some(pi) = text.get_mut("pi").and_then(toml::Value::as_table_mut) {
            pi.insert("rgb".to_owned(), false.into());
        }
        Self::parse(&named, &toml::to_string(&text).unwrap_or_default())
    }

    /// Reads a rig file.
    ///
    /// # Errors
    /// When the file cannot be read, or with all its mistakes.
    pub fn read(path: &Path) -> Result<Self, DescriptionError> {
        Self::parse(&path.display().to_string(), &read_text(path)?)
    }

    /// Parses the text of a rig file; `file` is its name in messages.
    ///
    /// # Errors
    /// With all the mistakes in the text.
    pub fn parse(file: &str, text: &str) -> Result<Self, DescriptionError> {
        read_description(file, text, |fields| Self {
            description: fields.description(SCHEMAS),
            name: fields.text("name"),
            arm: fields.table("arm", |arm_fields| {
                let arm = ArmDescription::read(arm_fields);
                arm.check_home(arm_fields);
                arm
            }),
            mount: fields.table("mount", Mount::read),
            davis: fields.table("davis", DavisDescription::read),
            pi: fields.table("pi", PiDescription::read),
            target: fields.table("target", TargetDescription::read),
            light: fields.table("light", LightDescription::read),
            clocks: fields.table("clocks", ClocksDescription::read),
            text: text.to_owned(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const MAGICIAN: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../rig/magician.toml");

    #[test]
    fn the_rig_files_in_the_repository_parse() {
        let sim = Rig::simulated().unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(sim.arm.port, ArmPort::Sim);
        let template = Rig::read(Path::new(MAGICIAN)).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(template.arm.port, ArmPort::Auto);
    }

    #[test]
    fn a_rig_of_the_former_schema_is_read() {
        let former = SIM.replace("evrig.rig/2", "evrig.rig/1").replace("description =", "says =");
        let read = Rig::parse("sim.toml", &former).unwrap();
        assert_eq!(Rig { text: SIM.to_owned(), ..read }, Rig::simulated().unwrap());
    }

    #[test]
    fn a_rig_is_found_by_file_or_by_name_and_else_a_name_is_suggested() {
        assert_eq!(Rig::find(MAGICIAN).unwrap(), Rig::find("magician").unwrap());
        let error = Rig::find("no/such/sim.toml").unwrap_err().to_string();
        assert!(
            error.contains("no/such/sim.toml") && error.contains("did you mean `sim`"),
            "{error}"
        );
    }

    #[test]
    fn a_rig_without_rgb_differs_in_nothing_else_and_states_it_in_its_text() {
        let rig = Rig::simulated().unwrap();
        let plain = rig.without_rgb().unwrap();
        assert!(rig.pi.rgb && !plain.pi.rgb);
        assert_eq!(Rig::parse("again", &plain.text).unwrap(), plain);
        let mut pi = plain.pi.clone();
        pi.rgb = true;
        assert_eq!(Rig { pi, text: rig.text.clone(), ..plain }, rig);
    }

    #[test]
    fn the_simulated_rig_sees_the_whole_target_on_the_whole_circle() {
        let rig = Rig::simulated().unwrap();
        let centre = rig.target.centre.unwrap().map(|c| c.0);
        let cameras = [(rig.mount.davis, &rig.davis.camera), (rig.mount.pi, &rig.pi.camera)];
        for tenth in 0..3600 {
            let angle = (f64::from(tenth) / 10.0).to_radians();
            let (x, y) = (252.0 + 12.0 * angle.cos(), 12.0 * angle.sin());
            let tool = Pose::from_mm_deg([x, y, 100.0, 90.0]);
            for (mounting, camera) in &cameras {
                let frame = mounting.frame(tool);
                let [right, down, forward] = frame.to_camera(centre.into());
                assert!((forward - rig.target.stand_off.0).abs() < 1e-6, "stand-off {forward}");
                let scale = camera.pixels_per_mm(rig.target.stand_off);
                let half = [rig.target.width().0 / 2.0, rig.target.picture_side.0 / 2.0];
                let reach = [right.abs() + half[0], down.abs() + half[1]].map(|mm| mm * scale);
                assert!(reach[0] < f64::from(camera.size.width) / 2.0, "{reach:?}");
                assert!(reach[1] < f64::from(camera.size.height) / 2.0, "{reach:?}");
            }
        }
    }

    #[test]
    fn a_wrong_value_a_wrong_key_and_a_missing_one_are_named_together() {
        let text = SIM
            .replace("focal_length_mm = 8.0", "focal_length_mm = -8.0")
            .replace("j4_deg =", "j4_degr =")
            .replace("tag_side_mm =", "tag_width_mm =");
        let error = Rig::parse("sim.toml", &text).unwrap_err();
        let message = error.to_string();
        for part in
            ["-8 is outside", "`j4_deg` is missing", "it has `j4_degr`", "`tag_side_mm` is missing"]
        {
            assert!(message.contains(part), "`{part}` is not in: {message}");
        }
    }

    #[test]
    fn a_home_out_of_the_arms_own_limits_is_refused() {
        let text = SIM.replace("x_mm = 200.0, y_mm = 0.0", "x_mm = 130.0, y_mm = 0.0");
        let message = Rig::parse("sim.toml", &text).unwrap_err().to_string();
        assert!(message.contains("arm.home: workspace radius is 130.00 mm"), "{message}");
        assert!(message.contains("10.00 mm under"), "{message}");
    }

    proptest! {
        #[test]
        fn a_spoilt_file_is_refused_or_read_but_never_a_panic(
            at in 0..SIM.len(), n_cut in 0..40_usize, put in "[ -~\n]{0,12}",
        ) {
            let mut text = SIM.as_bytes().to_vec();
            let end = (at + n_cut).min(text.len());
            text.splice(at..end, put.bytes());
            if let Err(error) = Rig::parse("spoilt.toml", &String::from_utf8_lossy(&text)) {
                prop_assert!(!error.problems().is_empty());
            }
        }
    }

    #[test]
    fn an_exposure_longer_than_a_frame_is_refused() {
        let text = SIM.replace("frame_rate_hz = 120.0", "frame_rate_hz = 900.0");
        let error = Rig::parse("sim.toml", &text).unwrap_err();
        assert!(error.to_string().contains("pi.exposure_us"), "{error}");
    }
}
