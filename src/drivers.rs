//! The registry of drivers, and a rig's devices opened by them.
//!
//! A driver states which rig-file key and values choose it and opens its device; the device checks
//! itself ([`Recorder::check`], [`ArmDriver::check`]) and each error states what to do.

mod davis;
mod dobot;
mod driver;
mod pi;
mod simulated;

pub use driver::{ArmDriver, DriverError, OpenArm, OpenOptions, RecorderDriver};

use evrig_record::recorder::Recorder;
use evrig_record::{Devices, EmergencyStop, Finding};
use evrig_session::rig::{ArmDescription, ArmPort, CameraTransport, Pose, Rig};
use evrig_session::trajectory;
use evrig_sim::arm::{ArmClock, ArmEmulator, ArmOptions};
use evrig_sim::live::LiveWorld;
use evrig_sim::world::WorldDescription;
use std::path::Path;
use std::sync::Arc;

pub use dobot::serve_guard;

/// Drivers of cameras; for each key the first that takes the rig's value opens the camera.
static RECORDER_DRIVERS: [RecorderDriver; 6] =
    [davis::USB, davis::TCP, davis::FILE, simulated::DAVIS, pi::AGENT, simulated::PI];

/// The driver of an arm. Rig files name no make: all arms are of the one kind that has a driver.
fn arm_driver(_description: &ArmDescription) -> &'static dyn ArmDriver {
    &dobot::MagicianDriver
}

/// A rig's devices, and what must live as long as they do.
pub struct OpenRig {
    /// What the engine gets.
    pub devices: Devices,
    /// Stops the arm from any thread; none for a simulated one.
    pub emergency_stop: Option<Arc<dyn EmergencyStop>>,
    /// Dropped last: it serves the arm's port.
    _simulated: Option<ArmEmulator>,
}

impl OpenRig {
    /// Opens the cameras and the arm, and homes the arm if asked to.
    ///
    /// # Errors
    /// When the arm's port cannot be opened, the simulated world is invalid, or no driver takes the
    /// transport of a camera.
    pub fn open(rig: &Rig, options: &OpenOptions<'_>) -> Result<Self, DriverError> {
        let simulated = start_simulated_arm(rig, false)?;
        let recorders = open_recorders(rig, options, simulated.as_ref())?;
        let port = simulated.as_ref().map(ArmEmulator::port);
        // A simulated arm is new every time.
        let home = options.home || simulated.is_some();
        let OpenArm { arm, emergency_stop } = arm_driver(&rig.arm).open(&rig.arm, port, home)?;
        let devices = Devices { arm, recorders };
        Ok(Self { devices, emergency_stop, _simulated: simulated })
    }
}

/// The simulated arm of a rig that names one, switched on.
///
/// # Errors
/// When there is no pseudo-terminal for it.
pub fn start_simulated_arm(rig: &Rig, is_homed: bool) -> Result<Option<ArmEmulator>, DriverError> {
    if rig.arm.port != ArmPort::Sim {
        return Ok(None);
    }
    let options = ArmOptions { is_homed, homing: simulated::HOMING, ..ArmOptions::default() };
    Ok(Some(ArmEmulator::start(options, ArmClock::Scaled(1.0), Vec::new())?))
}

/// Opens the arm and checks what must hold before it drives `path`. Nothing moves.
#[must_use]
pub fn check_arm(
    rig: &Rig,
    simulated: Option<&ArmEmulator>,
    path: Option<&trajectory::ToolPath>,
) -> Vec<Finding> {
    arm_driver(&rig.arm).check(&rig.arm, simulated.map(ArmEmulator::port), path)
}

/// Checks both cameras over the transports by which they would be recorded.
#[must_use]
pub fn check_recorders(rig: &Rig, start: Pose, simulated: Option<&ArmEmulator>) -> Vec<Finding> {
    let world = WorldDescription::default();
    let options =
        OpenOptions { replay_speed: Some(1.0), home: false, start, world: &world, seed: 1 };
    match open_recorders(rig, &options, simulated) {
        Ok(mut recorders) => recorders.iter_mut().flat_map(|it| it.check()).collect(),
        Err(error) => vec![Finding::bad("cameras", error.to_string())],
    }
}

/// An event-camera recording, replayed `speed` times as fast as it was made.
#[must_use]
pub fn replay(path: &Path, speed: f64) -> Box<dyn Recorder> {
    davis::replay(path, Some(speed))
}

/// The cameras by their transports. Simulated ones see one world, which the simulated arm moves.
fn open_recorders(
    rig: &Rig,
    options: &OpenOptions<'_>,
    simulated_arm: Option<&ArmEmulator>,
) -> Result<Vec<Box<dyn Recorder>>, DriverError> {
    let transports =
        [(davis::KEY, &rig.davis.camera.transport), (pi::KEY, &rig.pi.camera.transport)];
    let world = match transports.iter().find(|(_, transport)| **transport == CameraTransport::Sim) {
        Some((key, _)) => {
            let arm = simulated_arm.ok_or(DriverError::NoSimulatedArm { key })?;
            let OpenOptions { start, world, seed, .. } = *options;
            Some(LiveWorld::moved_by(arm, rig, start, world, seed)?)
        }
        None => None,
    };
    let open = |(key, found): (&'static str, &CameraTransport)| {
        let of_key = || RECORDER_DRIVERS.iter().filter(move |driver| driver.key == key);
        let opened = of_key().find_map(|driver| (driver.open)(rig, options, world.as_ref()));
        opened.unwrap_or_else(|| {
            let values: Vec<_> = of_key().map(|driver| driver.values).collect();
            let found = driver::name_of(found);
            Err(DriverError::NoDriver { key, found, values: values.join(", ") })
        })
    };
    transports.into_iter().map(open).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn error_of(key: &str, value: &str) -> String {
        let section = format!("[{key}]");
        let text = Rig::simulated().unwrap().text;
        let (before, after) = text.split_once(&section).unwrap();
        let (line, value) = ("transport = \"sim\"", format!("transport = \"{value}\""));
        let text = format!("{before}{section}{}", after.replacen(line, &value, 1));
        let rig = Rig::parse("rig.toml", &text).unwrap();
        let world = WorldDescription::default();
        let options = OpenOptions {
            replay_speed: None,
            home: false,
            start: rig.arm.home,
            world: &world,
            seed: 1,
        };
        let simulated = start_simulated_arm(&rig, true).unwrap();
        let opened = open_recorders(&rig, &options, simulated.as_ref());
        opened.err().map_or_else(String::new, |error| error.to_string())
    }

    #[test]
    fn a_transport_without_a_driver_is_refused_with_those_that_have_one() {
        let error = error_of("davis", "tls://pi:7766");
        assert!(error.contains("davis.transport = \"tls://\" has no driver"), "{error}");
        assert!(error.contains("tcp://HOST:PORT, file:PATH, sim"), "{error}");
        let error = error_of("pi", "usb");
        assert!(error.contains("pi.transport = \"usb\" has no driver; use tls://"), "{error}");
    }

    #[cfg(not(feature = "usb"))]
    #[test]
    fn usb_without_its_feature_names_the_feature() {
        let error = error_of("davis", "usb");
        assert_eq!(
            error,
            "rig: davis.transport = \"usb\" needs an evrig built with `--features usb`"
        );
    }
}
