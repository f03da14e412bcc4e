//! Finds the port of the arm that a rig describes, and checks the arm behind it.

use super::arm::{ArmError, Magician};
use super::check;
use super::client::{ArmClient, ArmTimeouts};
use super::port::{self, PortError};
use evrig_record::Finding;
use evrig_session::rig::{ArmDescription, ArmPort};
use evrig_session::trajectory::ToolPath;
use std::path::{Path as FilePath, PathBuf};

/// Opens the arm of a description behind its guard (`program` is this program) and checks
/// everything that must hold before it moves. `simulated` is the port of the simulated arm, for a
/// description that asks for one.
#[must_use]
pub fn open_and_check(
    program: &FilePath,
    description: &ArmDescription,
    simulated: Option<&FilePath>,
    path: Option<&ToolPath>,
) -> Vec<Finding> {
    let opened = find_port(&description.port, simulated).map_err(ArmError::from).and_then(|port| {
        let timeouts = ArmTimeouts::default();
        let arm = Magician::guarded(program, &port, description.clone(), timeouts)?;
        Ok((arm, port))
    });
    match opened {
        Ok((mut arm, port)) => {
            let mut findings = vec![Finding::good("port", port.display().to_string())];
            findings.extend(check::findings(arm.client(), description, path));
            findings
        }
        Err(error) => {
            let mut findings = vec![Finding::bad("port", error.to_string())];
            findings.extend(path.map(|path| check::path_limits(path, description)));
            findings
        }
    }
}

/// The port a description means.
///
/// # Errors
/// When `auto` finds none, none that answers, or several; or the simulated arm was not started.
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
    let mut client = ArmClient::new(Box::new(link), ArmTimeouts::default());
    client.identify().map_err(|error| error.to_string())?;
    let pose = client.pose().map_err(|error| error.to_string())?;
    if pose.pose.to_mm_deg().iter().all(|value| value.is_finite()) {
        Ok(())
    } else {
        Err("it answers with a pose that is no place".to_owned())
    }
}
