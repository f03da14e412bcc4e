//! The driver of the Dobot Magician, for each value of `arm.port`.

use super::driver::{ArmDriver, DriverError, OpenArm};
use crate::program::program;
use evrig_core::time::Span;
use evrig_device::dobot::find::{find_port, open_and_check};
use evrig_device::dobot::{ArmClient, ArmError, ArmTimeouts, Magician, guard, port};
use evrig_record::{EmergencyStop, Finding, GuardEnd};
use evrig_session::rig::{ArmDescription, ArmPort};
use evrig_session::trajectory;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// How long homing may take; a Magician needs about fifteen seconds.
const HOMING: Span = Span::from_micros(60_000_000);

pub(super) struct MagicianDriver;

impl ArmDriver for MagicianDriver {
    fn open(
        &self,
        description: &ArmDescription,
        simulated_port: Option<&Path>,
        home: bool,
    ) -> Result<OpenArm, DriverError> {
        let mut arm = open(description, simulated_port)?;
        if home {
            arm.home(HOMING)?;
        }
        let emergency_stop = arm.stopper().map(|it| Arc::new(it) as Arc<dyn EmergencyStop>);
        Ok(OpenArm { arm: Box::new(arm), emergency_stop })
    }

    fn check(
        &self,
        description: &ArmDescription,
        simulated_port: Option<&Path>,
        path: Option<&trajectory::ToolPath>,
    ) -> Vec<Finding> {
        match program() {
            Ok(program) => open_and_check(&program, description, simulated_port, path),
            Err(error) => vec![Finding::bad("port", DriverError::from(error).to_string())],
        }
    }
}

impl From<ArmError> for DriverError {
    fn from(error: ArmError) -> Self {
        Self::Arm(error.into())
    }
}

/// Behind its guard, unless the arm is simulated in this process.
fn open(
    description: &ArmDescription,
    simulated_port: Option<&Path>,
) -> Result<Magician, DriverError> {
    let (timeouts, own) = (ArmTimeouts::default(), description.clone());
    let port = find_port(&description.port, simulated_port).map_err(ArmError::from)?;
    if description.port == ArmPort::Sim {
        let link = port::open(&port).map_err(ArmError::from)?;
        return Ok(Magician::over(ArmClient::new(Box::new(link), timeouts), own));
    }
    Ok(Magician::guarded(&program()?, &port, own, timeouts)?)
}

/// Owns the arm's serial port for an evrig at the other end of this process's standard input and
/// output, and stops the arm when that evrig is gone. `is_signalled` is set by signals, each of
/// which stops the arm as well.
pub fn serve_guard(port: &Path, is_signalled: &AtomicBool) -> GuardEnd {
    guard::serve(port, std::io::stdin(), std::io::stdout(), is_signalled)
}
