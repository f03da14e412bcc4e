//! What must hold before the arm moves, looked at one by one.

use super::arm::{ArmError, Magician};
use super::client::Client;
use super::port::{self, PortError};
use super::{ClientError, Patience, id};
use evrig_record::{Finding, Verdict};
use evrig_session::rig::{ArmDescription, ArmPort};
use evrig_session::trajectory::{ToolPath, violations};
use std::path::{Path as FilePath, PathBuf};

/// Opens the arm of a description behind its guard (`program` is this program) and looks at
/// everything that must hold before it moves. The arm comes back when it can be spoken to.
/// `simulated` is the port of the simulated arm, for a description that asks for one.
#[must_use]
pub fn open_and_look(
    program: &FilePath,
    description: &ArmDescription,
    simulated: Option<&FilePath>,
    path: Option<&ToolPath>,
) -> (Option<Magician>, Vec<Finding>) {
    let opened = find_port(&description.port, simulated).map_err(ArmError::from).and_then(|port| {
        let arm = Magician::guarded(program, &port, description.clone(), Patience::default())?;
        Ok((arm, port))
    });
    match opened {
        Ok((mut arm, port)) => {
            let mut findings = vec![Finding::good("port", port.display().to_string())];
            findings.extend(self::findings(arm.client(), description, path));
            let is_arm = findings
                .iter()
                .all(|finding| finding.subject != "identity" || finding.verdict == Verdict::Good);
            (is_arm.then_some(arm), findings)
        }
        Err(error) => {
            let mut findings = vec![Finding::bad("port", error.to_string())];
            findings.extend(path.map(|path| reach(path, description)));
            (None, findings)
        }
    }
}

/// The port a description means.
///
/// # Errors
/// When `auto` finds none, none that answers, or several; a simulated arm that nobody started is
/// a port that is missing.
pub fn find_port(port: &ArmPort, simulated: Option<&FilePath>) -> Result<PathBuf, PortError> {
    match port {
        ArmPort::Path(path) => Ok(path.into()),
        ArmPort::Auto => port::find(FilePath::new("/sys"), answers),
        ArmPort::Sim => simulated
            .map(FilePath::to_owned)
            .ok_or_else(|| PortError::Missing { path: "sim".into(), present: Vec::new() }),
    }
}

/// Whether a Magician answers at a port: its version and a pose of finite numbers.
///
/// # Errors
/// Why it is not one, in words.
pub fn answers(path: &FilePath) -> Result<(), String> {
    let link = port::open(path).map_err(|error| error.to_string())?;
    let mut client = Client::new(Box::new(link), Patience::default());
    client.identify().map_err(|error| error.to_string())?;
    let pose = client.pose().map_err(|error| error.to_string())?;
    if pose.pose.to_mm_deg().iter().all(|value| value.is_finite()) {
        Ok(())
    } else {
        Err("it answers with a pose that is no place".to_owned())
    }
}

/// Looks at the arm behind an open port, and at `path` if there is one. Nothing moves, nothing is
/// set, no alarm is cleared.
pub fn findings(
    client: &mut Client,
    description: &ArmDescription,
    path: Option<&ToolPath>,
) -> Vec<Finding> {
    let mut findings = vec![identity(client)];
    // A device that does not answer as an arm is asked nothing more.
    if findings[0].verdict == Verdict::Good {
        findings.extend(state(client));
        findings.push(tool(client, description));
    }
    findings.extend(path.map(|path| reach(path, description)));
    findings
}

/// The path against reach, joints and speeds: the first point beyond each limit.
fn reach(path: &ToolPath, description: &ArmDescription) -> Finding {
    let violations = violations(path, description);
    if violations.is_empty() {
        let (n_steps, length) = (path.steps().len(), path.length());
        let says = format!("{n_steps} steps, {length:.0}, {}, within all limits", path.duration());
        return Finding::good("path", says);
    }
    let says: Vec<String> = violations.iter().map(ToString::to_string).collect();
    Finding::bad("path", says.join("; "))
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
