//! Devices over their real protocols: arm, cameras, agent of the Pi, and recordings with faults.

#![allow(
    clippy::expect_used,
    clippy::print_stderr,
    clippy::print_stdout,
    clippy::unwrap_used,
    unreachable_pub
)]

#[path = "../support/camera.rs"]
mod camera;
#[path = "../support/devtools.rs"]
mod devtools;
#[path = "../support/rig.rs"]
mod rig;
#[path = "../support/small_rig.rs"]
mod small_rig;
#[path = "../support/wire.rs"]
mod wire;

#[cfg(unix)]
mod arm_guard;
#[cfg(unix)]
mod arm_trajectories;
mod check;
mod crash;
mod davis;
mod davis_dv;
#[cfg(unix)]
mod dobot_clients;
mod doubtful_recordings;
#[cfg(unix)]
mod emulate_arm;
#[cfg(unix)]
mod faults;
#[cfg(target_os = "linux")]
mod full_disk;
mod hardware;
mod live;
mod pi_agent;
mod pi_camera;
mod pi_commands;
mod plan;
mod record;
mod simulated_rig;
mod stimulus;
