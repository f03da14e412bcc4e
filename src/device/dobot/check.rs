//! What must hold before the arm moves, looked at one by one.

use super::client::Client;
use super::{ClientError, id};
use crate::device::Finding;
use crate::rig::ArmDescription;
use crate::trajectory::Path;

/// Looks at the arm behind an open port, and at `path` if there is one. Nothing moves, nothing is
/// set, no alarm is cleared.
pub fn findings(
    client: &mut Client,
    description: &ArmDescription,
    _path: Option<&Path>,
) -> Vec<Finding> {
    let mut findings = vec![identity(client)];
    // A device that does not answer as an arm is asked nothing more.
    if findings[0].verdict == crate::device::Verdict::Good {
        findings.extend(state(client));
        findings.push(tool(client, description));
    }
    findings
}

fn identity(client: &mut Client) -> Finding {
    match client.identify() {
        Ok(who) => {
            let serial = if who.serial.is_empty() { "no serial number" } else { &who.serial };
            Finding::good("identity", format!("{}, {serial}, firmware {}", who.name, who.firmware))
        }
        Err(error) => Finding::bad("identity", error.to_string()),
    }
}

/// Alarms and homing, which one answer tells.
fn state(client: &mut Client) -> Vec<Finding> {
    let alarms = match client.alarms() {
        Ok(alarms) => alarms,
        Err(error) => return vec![Finding::bad("alarms", error.to_string())],
    };
    let standing = if alarms.has_fault() {
        Finding::bad("alarms", alarms.to_string())
    } else {
        Finding::good("alarms", "none")
    };
    let homed = if alarms.is_fresh_from_power_up() {
        Finding::bad(
            "homed",
            "the arm was switched on and not homed since: its base does not know where it is; \
             clear the table and home it",
        )
    } else {
        // The firmware of a Magician does not tell; a cleared power-up bit is all there is.
        Finding::good("homed", "alarms were cleared since power-up, as homing by evrig does")
    };
    vec![standing, homed]
}

fn tool(client: &mut Client, description: &ArmDescription) -> Finding {
    let expected = description.kinematics.tool_offset.map(|offset| offset.0 as f32);
    match client.floats::<3>(id::END_EFFECTOR) {
        Ok(found) if found == expected => {
            Finding::good("tool", format!("offset {found:?} mm, as in the rig file"))
        }
        Ok(found) => Finding::doubt(
            "tool",
            format!(
                "the arm's tool offset is {found:?} mm, the rig file says {expected:?}; \
                 it is set before the recording"
            ),
        ),
        Err(ClientError::Link(error)) => Finding::bad("tool", error.to_string()),
        Err(error) => Finding::bad("tool", error.to_string()),
    }
}
