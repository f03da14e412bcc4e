//! The devices that a rig file names, opened.

use evrig_core::time::Span;
use evrig_device::davis::{NetworkDavis, Pace, Patience as DavisPatience, ReplayDavis};
use evrig_device::dobot::check::find_port;
use evrig_device::dobot::guard::Stopper;
use evrig_device::dobot::{ArmError, Client, Magician, Patience as ArmPatience, port};
use evrig_device::pi::{NetworkPi, Patience as PiPatience, Reach};
use evrig_pi::keys;
use evrig_pi::order::{Delivery, Order, Settings};
use evrig_record::Devices;
use evrig_record::recorder::{Recorder, RecorderError};
use evrig_session::rig::{ArmPort, CameraTransport, Pose, Rig};
use evrig_sim::arm::{Clock, Emulator, EmulatorError, Options};
use evrig_sim::live::LiveWorld;
use evrig_sim::recorder::SimulatedCamera;
use evrig_sim::world::{WorldDescription, WorldError};
use std::path::{Path, PathBuf};

/// How long homing may take; a Magician needs about fifteen seconds.
const HOMING: Span = Span::from_micros(60_000_000);

/// And a simulated one, which nobody wants to wait for.
const SIMULATED_HOMING: Span = Span::from_micros(500_000);

/// What a rig file does not say of a recording.
#[derive(Debug, Clone, Copy)]
pub struct Opening<'a> {
    /// How a recording in the DAVIS's place is played.
    pub pace: Pace,
    /// Whether the arm is homed first; a simulated one always is: it is new every time.
    pub home: bool,
    /// Where the path begins: simulated cameras see the print from there.
    pub start: Pose,
    /// The world of simulated cameras.
    pub world: &'a WorldDescription,
    /// Of everything that is random in it.
    pub seed: u64,
}

/// Why a rig's devices cannot be opened.
#[derive(Debug, thiserror::Error)]
pub enum BenchError {
    /// The arm.
    #[error(transparent)]
    Arm(#[from] ArmError),
    /// The simulated arm.
    #[error(transparent)]
    Emulator(#[from] EmulatorError),
    /// The simulated world.
    #[error(transparent)]
    World(#[from] WorldError),
    /// A simulated camera.
    #[error(transparent)]
    Camera(#[from] RecorderError),
    /// Simulated cameras sit on the simulated arm.
    #[error(
        "rig: {key} = \"sim\" needs arm.port = \"sim\": a simulated camera sits on the simulated arm"
    )]
    NoSimulatedArm {
        /// The key of the rig file.
        key: &'static str,
    },
    /// This program cannot be found, and the arm's guard is this program.
    #[error("cannot find this program to start the guard of the arm: {0}")]
    Program(#[from] std::io::Error),
    /// A camera is named in a way that this version cannot open.
    #[error("rig: {key} = \"{found}\" cannot be recorded by this version; use {remedy}")]
    Transport {
        /// The key of the rig file.
        key: &'static str,
        /// What stands there.
        found: &'static str,
        /// What can.
        remedy: &'static str,
    },
}

/// A rig's devices, and what must live as long as they do.
pub struct Bench {
    /// What the engine gets.
    pub devices: Devices,
    /// Halts the arm from any thread; none for a simulated one.
    pub stopper: Option<Stopper>,
    /// Dropped last: the arm's port is served by it.
    _simulated: Option<Emulator>,
}

impl Bench {
    /// Opens the arm, homes it if asked to, and names the cameras.
    ///
    /// # Errors
    /// When the arm's port cannot be opened, there is no such world, or a camera's transport is not
    /// of this version.
    pub fn open(rig: &Rig, opening: &Opening<'_>) -> Result<Self, BenchError> {
        let simulated = match rig.arm.port {
            ArmPort::Sim => {
                let options = Options { homing: SIMULATED_HOMING, ..Options::default() };
                Some(Emulator::start(options, Clock::Scaled(1.0), Vec::new())?)
            }
            _ => None,
        };
        let recorders = cameras(rig, opening, simulated.as_ref())?;
        let port = find_port(&rig.arm.port, simulated.as_ref().map(Emulator::port))
            .map_err(ArmError::from)?;
        let mut arm = open_arm(rig, &port, simulated.is_some())?;
        if opening.home || simulated.is_some() {
            arm.home(HOMING)?;
        }
        let stopper = arm.stopper();
        let devices = Devices { arm: Box::new(arm), recorders };
        Ok(Self { devices, stopper, _simulated: simulated })
    }
}

/// The cameras by their transports. Simulated ones look at one world, which the simulated arm moves.
///
/// # Errors
/// When there is no such world, or a transport is not of this version.
pub fn cameras(
    rig: &Rig,
    opening: &Opening<'_>,
    arm: Option<&Emulator>,
) -> Result<Vec<Box<dyn Recorder>>, BenchError> {
    let transports = [
        ("davis.transport", &rig.davis.camera.transport),
        ("pi.transport", &rig.pi.camera.transport),
    ];
    let live =
        match transports.into_iter().find(|(_, transport)| **transport == CameraTransport::Sim) {
            Some((key, _)) => {
                let arm = arm.ok_or(BenchError::NoSimulatedArm { key })?;
                Some(LiveWorld::moved_by(arm, rig, opening.start, opening.world, opening.seed)?)
            }
            None => None,
        };
    let davis: Box<dyn Recorder> = match (&rig.davis.camera.transport, &live) {
        (CameraTransport::Tcp(address), _) => {
            Box::new(NetworkDavis::new(address, DavisPatience::default()))
        }
        (CameraTransport::File(path), _) => {
            Box::new(ReplayDavis::new(Path::new(path), opening.pace))
        }
        (CameraTransport::Sim, Some(live)) => Box::new(SimulatedCamera::davis(live)?),
        #[cfg(feature = "usb")]
        (CameraTransport::Usb, _) => Box::new(evrig_device::davis::UsbDavis::new(&rig.davis)),
        (other, _) => {
            let remedy =
                "usb (in an evrig built with `--features usb`), tcp://HOST:PORT or file:PATH";
            return Err(refused("davis.transport", other, remedy));
        }
    };
    let pi: Box<dyn Recorder> = match (&rig.pi.camera.transport, &live) {
        (CameraTransport::Sim, Some(live)) => Box::new(SimulatedCamera::pi(live, order(rig))?),
        (other, _) => match network_pi(rig) {
            Some(pi) => Box::new(pi),
            None => {
                let remedy = "tls://HOST:PORT of an agent, or tcp://HOST:PORT on this machine";
                return Err(refused("pi.transport", other, remedy));
            }
        },
    };
    Ok(vec![davis, pi])
}

/// The arm at a port: behind its guard, unless it is simulated in this process.
fn open_arm(rig: &Rig, port: &Path, is_simulated: bool) -> Result<Magician, BenchError> {
    let (description, patience) = (rig.arm.clone(), ArmPatience::default());
    if is_simulated {
        let link = port::open(port).map_err(ArmError::from)?;
        return Ok(Magician::over(Client::new(Box::new(link), patience), description));
    }
    Ok(Magician::guarded(&std::env::current_exe()?, port, description, patience)?)
}

/// The Pi's camera behind its agent; none when the rig names no agent.
fn network_pi(rig: &Rig) -> Option<NetworkPi> {
    let pi = &rig.pi;
    let reach = match &pi.camera.transport {
        CameraTransport::Tcp(address) => Reach::Local { address: address.clone() },
        CameraTransport::Tls(address) => {
            let own = || keys::default_directory().join("host");
            let keys = pi.keys.as_ref().map_or_else(own, PathBuf::from);
            Reach::Tls { address: address.clone(), keys }
        }
        CameraTransport::Sim | CameraTransport::Usb | CameraTransport::File(_) => return None,
    };
    Some(NetworkPi::reached(reach, order(rig), PiPatience::default()))
}

/// What the rig file says of the Pi's frames.
fn order(rig: &Rig) -> Order {
    let pi = &rig.pi;
    let settings = Settings {
        size: pi.camera.size,
        frame_rate: pi.camera.frame_rate,
        exposure: pi.camera.exposure,
        gain: pi.camera.gain,
        raw: pi.raw,
        rgb: pi.rgb,
    };
    let delivery = Delivery { coding: pi.coding, rgb: pi.rgb_delivery };
    Order { settings, focus: pi.focus, delivery }
}

fn refused(key: &'static str, found: &CameraTransport, remedy: &'static str) -> BenchError {
    let found = match found {
        CameraTransport::Sim => "sim",
        CameraTransport::Usb => "usb",
        CameraTransport::Tcp(_) => "tcp://",
        CameraTransport::Tls(_) => "tls://",
        CameraTransport::File(_) => "file:",
    };
    BenchError::Transport { key, found, remedy }
}
