//! What a driver is, and why it cannot open a device.

use evrig_record::recorder::{Recorder, RecorderError};
use evrig_record::{Arm, DeviceError, EmergencyStop, Finding};
use evrig_session::rig::{ArmDescription, CameraTransport, Pose, Rig};
use evrig_session::trajectory;
use evrig_sim::arm::EmulatorError;
use evrig_sim::live::LiveWorld;
use evrig_sim::world::{WorldDescription, WorldError};
use std::path::Path;
use std::sync::Arc;

/// What a recording needs and a rig file does not state.
#[derive(Debug, Clone, Copy)]
pub struct OpenOptions<'a> {
    /// How many times as fast a recording in the event camera's place is replayed; none: as fast as
    /// it is taken, without drops.
    pub replay_speed: Option<f64>,
    /// Whether the arm is homed first; a simulated one always is.
    pub home: bool,
    /// Where the path begins: simulated cameras see the target from there.
    pub start: Pose,
    /// The world of simulated cameras.
    pub world: &'a WorldDescription,
    /// Of everything that is random in it.
    pub seed: u64,
}

/// Why a rig's devices cannot be opened.
#[derive(Debug, thiserror::Error)]
pub enum DriverError {
    /// The arm.
    #[error(transparent)]
    Arm(#[from] DeviceError),
    /// The simulated arm.
    #[error(transparent)]
    Emulator(#[from] EmulatorError),
    /// The simulated world.
    #[error(transparent)]
    World(#[from] WorldError),
    /// A simulated camera.
    #[error(transparent)]
    Camera(#[from] RecorderError),
    /// A simulated camera without a simulated arm.
    #[error(
        "rig: {key} = \"sim\" needs arm.port = \"sim\": a simulated camera sits on the simulated \
         arm"
    )]
    NoSimulatedArm {
        /// The key of the rig file.
        key: &'static str,
    },
    /// The arm's guard is this program, which cannot be found.
    #[error("cannot find this program to start the guard of the arm: {0}")]
    Program(#[from] std::io::Error),
    /// The driver is not in this build.
    #[error("rig: {key} = \"{found}\" needs an evrig built with `--features {feature}`")]
    NotBuilt {
        /// The key of the rig file.
        key: &'static str,
        /// Its value.
        found: &'static str,
        /// The feature that has the driver.
        feature: &'static str,
    },
    /// No driver takes this value.
    #[error("rig: {key} = \"{found}\" has no driver; use {values}")]
    NoDriver {
        /// The key of the rig file.
        key: &'static str,
        /// Its value.
        found: &'static str,
        /// The values that have one.
        values: String,
    },
}

/// An arm and what stops it.
pub struct OpenArm {
    /// The arm.
    pub arm: Box<dyn Arm>,
    /// Stops it from any thread; none without a guard.
    pub emergency_stop: Option<Arc<dyn EmergencyStop>>,
}

/// Opens arms of one make. `simulated_port` is where the simulated arm answers, for a description
/// that asks for it.
pub trait ArmDriver: Sync {
    /// Opens the arm, and homes it if asked to.
    ///
    /// # Errors
    /// When the port cannot be opened or the arm does not answer.
    fn open(
        &self,
        description: &ArmDescription,
        simulated_port: Option<&Path>,
        home: bool,
    ) -> Result<OpenArm, DriverError>;

    /// Opens the arm and checks what must hold before it drives `path`. Nothing moves.
    fn check(
        &self,
        description: &ArmDescription,
        simulated_port: Option<&Path>,
        path: Option<&trajectory::ToolPath>,
    ) -> Vec<Finding>;
}

/// A camera that a driver opened.
pub(super) type OpenedRecorder = Result<Box<dyn Recorder>, DriverError>;

/// Opens cameras of one transport.
#[derive(Debug)]
pub struct RecorderDriver {
    /// The rig-file key whose value chooses it.
    pub key: &'static str,
    /// The values that do, as a message offers them.
    pub values: &'static str,
    /// Opens the camera; none when the rig chooses another driver. Simulated cameras see the world.
    pub open: fn(&Rig, &OpenOptions<'_>, Option<&Arc<LiveWorld>>) -> Option<OpenedRecorder>,
}

/// The kind of a transport, as a rig file begins it.
pub(super) const fn name_of(transport: &CameraTransport) -> &'static str {
    match transport {
        CameraTransport::Sim => "sim",
        CameraTransport::Usb => "usb",
        CameraTransport::Tcp(_) => "tcp://",
        CameraTransport::Tls(_) => "tls://",
        CameraTransport::File(_) => "file:",
    }
}
