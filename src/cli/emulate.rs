//! `emulate`: a simulated device with the real protocol.

use clap::{Args, Subcommand};
use std::path::PathBuf;

/// Arguments of `evrig emulate`.
#[derive(Debug, Args)]
pub struct EmulateArgs {
    /// The device
    #[command(subcommand)]
    pub device: EmulatedDevice,
}

/// The devices.
#[derive(Debug, Subcommand)]
pub enum EmulatedDevice {
    /// A Dobot Magician on a pseudo-terminal, until Ctrl-C
    Arm(EmulateArmArgs),
    /// A DAVIS346 as AEDAT4 over TCP, one stream per port, until Ctrl-C
    Davis(EmulateCameraArgs),
    /// A Raspberry Pi with its camera, with the protocol of `evrig record`, until Ctrl-C
    Pi(EmulateCameraArgs),
}

/// Arguments of `evrig emulate davis` and `evrig emulate pi`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    evrig emulate davis --listen 127.0.0.1:7777\n  \
    evrig emulate pi --rig rig/sim.toml --trajectory line\n\n\
    The addresses are the first line on stdout: for a DAVIS events, frames and inertial samples\n\
    with commas between them, as `davis.transport = \"tcp://...\"` takes them. The camera moves\n\
    along the trajectory and back without end; a machine that is too slow to render in real time\n\
    lags behind and loses nothing.")]
pub struct EmulateCameraArgs {
    /// The rig: a file, or the name of a bundled one
    #[arg(long, default_value = "sim")]
    pub rig: String,

    /// The trajectory of the camera: a file, or the name of a bundled one
    #[arg(long, default_value = "circle")]
    pub trajectory: String,

    /// Description of the simulated world (see rig/world.toml) [default: the nominal world]
    #[arg(long, value_name = "FILE")]
    pub world: Option<PathBuf>,

    /// Seed of all random draws of the world
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,

    /// Where to listen; further streams of a DAVIS come at the next ports, and 0 is any port
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1:0")]
    pub listen: std::net::SocketAddr,
}

/// Arguments of `evrig emulate arm`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  evrig emulate arm --link /tmp/dobot\n  \
    evrig emulate arm --time-scale 20 --journal arm.jsonl\n  \
    evrig emulate arm --fault lost-reply@PTP#2 --fault alarm=0x22@100\n\n\
    The port is the first line on stdout. Faults are KIND[=VALUE][@N | @NAME[#N]]: at the\n\
    N-th request, or at the N-th request of that name. Kinds: lost-request, lost-reply,\n\
    late-reply=150ms, corrupt-reply, trickle, silence, garbage, wedge, unplug,\n\
    alarm=0x22, power-cycle.")]
pub struct EmulateArmArgs {
    /// Also reach the port under this name (a symbolic link)
    #[arg(long, value_name = "PATH")]
    pub link: Option<PathBuf>,

    /// Inject a fault; may be given several times
    #[arg(long = "fault", value_name = "FAULT")]
    pub faults: Vec<String>,

    /// Speed of the arm's clock relative to real time
    #[arg(long, value_name = "X", default_value_t = 1.0)]
    pub time_scale: f64,

    /// Write every request as a JSON line to this file
    #[arg(long, value_name = "FILE")]
    pub journal: Option<PathBuf>,

    /// Depth of the command queue
    #[arg(long, value_name = "N", default_value_t = 32)]
    pub queue_depth: usize,

    /// Duration of homing on the arm's clock, seconds
    #[arg(long, value_name = "SECONDS", default_value_t = 15.0)]
    pub homing: f64,

    /// The arm is already homed
    #[arg(long)]
    pub homed: bool,

    /// Reply delay of the arm, milliseconds (the serial line alone takes 3.8 for a pose)
    #[arg(long, value_name = "MS", default_value_t = 0)]
    pub reply_delay: u32,

    /// Firmware without the circle command (102)
    #[arg(long)]
    pub no_circle: bool,

    /// Firmware that drops a command it cannot plan and continues, instead of waiting for the alarm
    /// to be cleared
    #[arg(long)]
    pub skip_on_alarm: bool,

    /// Firmware whose arcs run at the PTP speeds instead of the ARC speeds
    #[arg(long)]
    pub arc_at_ptp_speed: bool,

    /// Backlash of the base joint, degrees
    #[arg(long, value_name = "DEG", default_value_t = 0.0)]
    pub backlash: f64,

    /// Vibration amplitude of the tool, mm per mm/s^2 of acceleration
    #[arg(long, value_name = "GAIN", default_value_t = 0.0)]
    pub vibration: f64,
}
