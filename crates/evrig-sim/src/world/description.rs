//! The description of a world: everything that is not in the rig file.

use super::effects::WorldEffects;
use super::error::WorldError;
use serde::{Deserialize, Serialize};

/// A world: target, lenses, sensors, clocks, and the active effects.
///
/// Every key has a default, so an empty file is the nominal world: a target with the bundled image,
/// steady light, a DAVIS346 with ideal threshold-crossing pixels, frames with shot and read noise.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct WorldDescription {
    /// The printed target.
    #[serde(alias = "print")]
    pub target: PrintedTargetDescription,
    /// The event camera.
    pub davis: DavisSensor,
    /// The inertial unit in the event camera.
    pub imu: ImuSensor,
    /// The frame camera.
    pub pi: PiSensorDescription,
    /// The clocks.
    pub clocks: WorldClocksDescription,
    /// The effects that are on.
    pub effects: WorldEffects,
}

/// The printed target.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PrintedTargetDescription {
    /// `leaves-SEED` (bundled, any seed), `file:PATH`, `plain`, or `stripes-PERIOD_MM-ANGLE_DEG`.
    #[serde(alias = "picture")]
    pub image: String,
    /// Reflectance of the paper, the unit of all intensities: "white".
    pub white: f64,
    /// Reflectance of the darkest ink, as a share of white.
    pub black: f64,
    /// Whether six grey patches are printed above the tag.
    pub patches: bool,
}

/// The DAVIS's lens and pixels.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DavisSensor {
    /// Threshold in log intensity; 0.19 fits a DAVIS346 (the published DVS-Voltmeter calibration).
    pub threshold: f64,
    /// Standard deviation of the lens's point spread, in pixels, on top of the pixel's own
    /// aperture.
    pub psf_sigma_px: f64,
    /// Value of white in a frame at the rig's exposure and full light, DN.
    pub aps_white_dn: f64,
    /// Read noise of a frame, in its DN.
    pub aps_read_noise_dn: f64,
    /// Electrons behind one DN of a frame.
    pub aps_electrons_per_dn: f64,
}

/// The inertial unit: an MPU-6500, its defaults those of its sheet.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ImuSensor {
    /// Density of the gyroscope's noise, degrees a second in a bandwidth of one hertz.
    pub rotation_noise_deg_per_s_per_rthz: f64,
    /// Bound of the zero-rate offset, drawn for each axis, degrees per second.
    pub rotation_zero_deg_per_s: f64,
    /// Density of the accelerometer's noise, millionths of g in a bandwidth of one hertz.
    pub acceleration_noise_ug_per_rthz: f64,
    /// Bound of the zero-g offset, drawn for each axis, mg.
    pub acceleration_zero_mg: f64,
    /// Temperature of the chip.
    pub temperature_c: f64,
}

/// The Pi camera's lens, sensor, image processing and interface.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PiSensorDescription {
    /// Standard deviation of the lens's point spread, in pixels, on top of the pixel's own
    /// aperture.
    pub psf_sigma_px: f64,
    /// Value of white in a green pixel above the black level, at the rig's exposure and full light,
    /// DN.
    pub white_dn: f64,
    /// Read noise in DN.
    pub read_noise_dn: f64,
    /// Electrons behind one DN at gain 1 (6,000 on 959 DN of a binned IMX708 pixel).
    pub electrons_per_dn: f64,
    /// Response of red, green and blue pixels to the lamp, green being 1.
    pub colour_response: [f64; 3],
    /// Exponent of the RGB path's tone curve.
    pub rgb_gamma: f64,
    /// Column and row of the crop's first pixel in the sensor's mode (692 x 520 of 1536 x 864).
    pub crop_origin_px: [i16; 2],
    /// Smallest time from the end of a frame's readout to RealTime being read.
    pub latency_us: f64,
    /// Mean of the exponential delay on top of it.
    pub latency_spread_us: f64,
    /// Share of frames that the interface loses.
    pub drop_fraction: f64,
}

/// The clocks. World time zero is the beginning of the path.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct WorldClocksDescription {
    /// Unix time at world time zero, microseconds.
    pub unix_start_us: i64,
    /// The Pi's sensor clock at world time zero: nanoseconds since its boot.
    pub pi_boot_ns: i64,
    /// Skew of the Pi's clocks against true time, ppm; positive when fast.
    pub pi_skew_ppm: f64,
    /// Offset of the Pi's wall clock from Unix time, µs.
    pub pi_wall_offset_us: f64,
    /// Steps of the Pi's wall clock: at world time `[0]` seconds by `[1]` microseconds.
    pub pi_wall_steps: Vec<[f64; 2]>,
}

impl Default for PrintedTargetDescription {
    fn default() -> Self {
        Self { image: "leaves-1".to_owned(), white: 1.0, black: 0.04, patches: true }
    }
}

impl Default for DavisSensor {
    fn default() -> Self {
        Self {
            threshold: 0.19,
            psf_sigma_px: 0.5,
            aps_white_dn: 200.0,
            aps_read_noise_dn: 0.5,
            aps_electrons_per_dn: 100.0,
        }
    }
}

impl Default for ImuSensor {
    fn default() -> Self {
        Self {
            rotation_noise_deg_per_s_per_rthz: 0.01,
            rotation_zero_deg_per_s: 5.0,
            acceleration_noise_ug_per_rthz: 300.0,
            acceleration_zero_mg: 60.0,
            temperature_c: 35.0,
        }
    }
}

impl Default for PiSensorDescription {
    fn default() -> Self {
        Self {
            psf_sigma_px: 0.6,
            white_dn: 700.0,
            read_noise_dn: 0.8,
            electrons_per_dn: 6.3,
            colour_response: [0.6, 1.0, 0.7],
            rgb_gamma: 1.0 / 2.2,
            crop_origin_px: [422, 172],
            latency_us: 4_000.0,
            latency_spread_us: 800.0,
            drop_fraction: 0.0,
        }
    }
}

impl Default for WorldClocksDescription {
    fn default() -> Self {
        Self {
            unix_start_us: 1_700_000_000_000_000,
            pi_boot_ns: 54_321_000_000_000,
            pi_skew_ppm: 0.0,
            pi_wall_offset_us: 0.0,
            pi_wall_steps: Vec::new(),
        }
    }
}

impl WorldDescription {
    /// Reads a description; `file` is its name in messages.
    ///
    /// # Errors
    /// On a wrong key or type, with its line; on a value that no world can have.
    pub fn parse(file: &str, text: &str) -> Result<Self, WorldError> {
        let description: Self = toml::from_str(text).map_err(|error| WorldError::Description {
            file: file.to_owned(),
            what: error.to_string(),
        })?;
        description.check()?;
        Ok(description)
    }

    /// The description as a file would have it; reads back as the same world.
    ///
    /// # Errors
    /// Never for a description that [`Self::check`] accepts.
    pub fn to_toml(&self) -> Result<String, WorldError> {
        toml::to_string(self).map_err(|error| WorldError::Description {
            file: "the world".to_owned(),
            what: error.to_string(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_empty_file_is_the_nominal_world_with_every_effect_off() {
        let world = WorldDescription::parse("w.toml", "").unwrap();
        assert_eq!(world, WorldDescription::default());
        assert!(world.effects.keys_on().is_empty());
    }

    #[test]
    fn the_file_in_the_repository_shows_every_key_with_its_default() {
        let text = include_str!("../../../../rig/world.toml");
        assert_eq!(
            WorldDescription::parse("rig/world.toml", text).unwrap(),
            WorldDescription::default()
        );
        let shown: toml::Table = toml::from_str(text).unwrap();
        let all: toml::Table =
            toml::from_str(&WorldDescription::default().to_toml().unwrap()).unwrap();
        for (name, table) in &all {
            for key in table.as_table().unwrap().keys() {
                assert!(shown[name].as_table().unwrap().contains_key(key), "{name}.{key}");
            }
        }
    }

    #[test]
    fn a_world_can_be_sealed_as_text_and_read_back() {
        let text = "[print]\npicture = \"leaves-7\"\n[effects]\nrefractory_period = \
            { refractory_us = 812.5 }\n";
        let world = WorldDescription::parse("w.toml", text).unwrap();
        let sealed = world.to_toml().unwrap();
        assert_eq!(WorldDescription::parse("sealed", &sealed).unwrap(), world);
        assert!(!sealed.contains("flicker"), "what is off is not written: {sealed}");
    }

    #[test]
    fn a_wrong_key_is_named_with_its_line() {
        let error = WorldDescription::parse("w.toml", "[effects]\nrefractory = 3\n").unwrap_err();
        let message = error.to_string();
        assert!(message.contains("w.toml") && message.contains("line 2"), "{message}");
    }

    #[test]
    fn a_value_that_no_world_can_have_is_refused_with_its_key() {
        for (text, key) in [
            ("[davis]\nthreshold = 0.0", "davis.threshold"),
            ("[effects]\nevent_drop = { fraction = 1.5 }", "event_drop.fraction"),
            ("[effects]\nflicker = { frequency_hz = nan, depth = 0.1 }", "flicker.frequency_hz"),
            ("[pi]\nelectrons_per_dn = -1.0", "pi.electrons_per_dn"),
            ("[imu]\ntemperature_c = 400", "imu.temperature_c"),
        ] {
            let error = WorldDescription::parse("w.toml", text).unwrap_err().to_string();
            assert!(error.contains(key), "{key} is not in: {error}");
        }
    }
}
