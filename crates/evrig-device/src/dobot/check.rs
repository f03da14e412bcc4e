//! Checks what must hold before the arm moves.

use super::client::{ArmClient, ArmClientError};
use super::id;
use evrig_record::{Finding, Verdict};
use evrig_session::rig::ArmDescription;
use evrig_session::trajectory::{ToolPath, violations};

/// Checks the arm behind an open port, and `path` if there is one. Nothing moves, nothing is set,
/// no alarm is cleared.
pub(super) fn findings(
    client: &mut ArmClient,
    description: &ArmDescription,
    path: Option<&ToolPath>,
) -> Vec<Finding> {
    let mut findings = vec![identity(client)];
    // A device that does not answer as an arm is asked nothing more.
    if findings[0].verdict == Verdict::Good {
        findings.extend(state(client));
        findings.push(tool(client, description));
    }
    findings.extend(path.map(|path| path_limits(path, description)));
    findings
}

/// The path against reach, joints and speeds: the first point beyond each limit.
pub(super) fn path_limits(path: &ToolPath, description: &ArmDescription) -> Finding {
    let violations = violations(path, description);
    if violations.is_empty() {
        let (n_steps, length) = (path.steps().len(), path.length());
        let description =
            format!("{n_steps} steps, {length:.0}, {}, within all limits", path.duration());
        return Finding::good("path", description);
    }
    let texts: Vec<String> = violations.iter().map(ToString::to_string).collect();
    Finding::bad("path", texts.join("; "))
}

fn identity(client: &mut ArmClient) -> Finding {
    match client.identify() {
        Ok(who) => {
            let serial = if who.serial.is_empty() { "no serial number" } else { &who.serial };
            Finding::good("identity", format!("{}, {serial}, firmware {}", who.name, who.firmware))
        }
        Err(error) => Finding::bad("identity", error.to_string()),
    }
}

/// Alarms and homing, from one answer.
fn state(client: &mut ArmClient) -> Vec<Finding> {
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
        // The firmware of a Magician does not report homing; only the power-up bit is available.
        Finding::good("homed", "alarms were cleared since power-up, as homing by evrig does")
    };
    vec![standing, homed]
}

fn tool(client: &mut ArmClient, description: &ArmDescription) -> Finding {
    let expected = description.kinematics.tool_offset.map(|offset| offset.0 as f32);
    match client.floats::<3>(id::END_EFFECTOR) {
        Ok(found) if found == expected => {
            Finding::good("tool", format!("offset {found:?} mm, as in the rig file"))
        }
        Ok(found) => Finding::doubt(
            "tool",
            format!(
                "the arm's tool offset is {found:?} mm, the rig file states {expected:?}; \
                 it is set before the recording"
            ),
        ),
        Err(ArmClientError::Link(error)) => Finding::bad("tool", error.to_string()),
        Err(error) => Finding::bad("tool", error.to_string()),
    }
}
