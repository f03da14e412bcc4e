//! What the journal and the manifest state about a recording; the journal alone suffices to make
//! the manifest of a recording that died.

use evrig_session::rig::Rig;
use evrig_session::trajectory::Trajectory;
use evrig_session::{DeviceEntry, HostTime, Recording};
use serde_json::{Value, json};

/// The journal's line `recording`: rig, trajectory and clocks.
pub fn recording_line(rig: &Rig, trajectory: &Trajectory) -> Value {
    json!({
        "rig": {"name": rig.name, "text": rig.text},
        "trajectory": {"name": trajectory.name, "text": trajectory.text},
        "clocks": clocks(rig),
    })
}

/// How the clocks are disciplined, as the rig states it.
pub fn clocks(rig: &Rig) -> Value {
    json!({
        "reference": rig.clocks.reference,
        "host": format!("{:?}", rig.clocks.host).to_lowercase(),
        "pi": format!("{:?}", rig.clocks.pi).to_lowercase(),
        "ntp_server": rig.clocks.ntp_server,
    })
}

/// The manifest's entry on the recording.
pub fn recording(
    rig: &Rig,
    trajectory: &Trajectory,
    devices: Vec<DeviceEntry>,
    ended: String,
    began: Option<HostTime>,
) -> Recording {
    Recording {
        rig: rig.text.clone(),
        trajectory: trajectory.text.clone(),
        devices,
        ended,
        trajectory_began_ns: began.map(|began| began.unix.as_nanos()),
        clocks: clocks(rig),
    }
}
