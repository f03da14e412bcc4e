//! Setting the arm up for a path: what it is told before it may start.

use super::arm::{ArmError, Magician, Marker, ROOM};
use super::client::ClientError;
use super::command::{CartesianLimits, Command, PtpMode, Ratios};
use super::id;
use super::link::LinkError;
use super::steps::{self, CircleAs};
use evrig_core::time::Span;
use evrig_session::rig::Pose;
use evrig_session::trajectory::{MotionCommand, PathStep, ToolPath, violations};

/// How long going to the start may take: across the workspace at the lowest sensible speed.
const APPROACH: Span = Span::from_micros(60_000_000);
/// Share of full speed for going to the start.
const APPROACH_RATIO: Ratios = Ratios { velocity: 15.0, acceleration: 15.0 };
impl Magician {
    /// Sets every speed of the path and reads it back, before anything moves.
    fn try_rates(&mut self, path: &ToolPath) -> Result<(), ArmError> {
        let mut tried: Vec<CartesianLimits> = Vec::new();
        for step in path.steps() {
            let limits = steps::cartesian_limits(&step.rates);
            if step.curve.motion() == MotionCommand::Hold || tried.contains(&limits) {
                continue;
            }
            for command in steps::rate_commands(&step.rates) {
                self.client.set(&command)?;
            }
            self.read_back(id::PTP_COORDINATE, "speed of lines", limits)?;
            self.read_back(id::ARC_PARAMS, "speed of arcs", limits)?;
            tried.push(limits);
        }
        Ok(())
    }

    fn read_back(
        &mut self,
        id: u8,
        what: &'static str,
        limits: CartesianLimits,
    ) -> Result<(), ArmError> {
        let set = [
            limits.xyz_velocity,
            limits.r_velocity,
            limits.xyz_acceleration,
            limits.r_acceleration,
        ];
        let found = self.client.floats::<4>(id)?;
        if found == set {
            return Ok(());
        }
        let (set, found) = (format!("{set:?}"), format!("{found:?}"));
        Err(ClientError::ReadBack { what, set, found }.into())
    }

    fn set_tool(&mut self) -> Result<(), ArmError> {
        let set = self.description.kinematics.tool_offset.map(|offset| offset.0 as f32);
        self.client.set(&Command::EndEffector(set))?;
        let found = self.client.floats::<3>(id::END_EFFECTOR)?;
        if found == set {
            return Ok(());
        }
        let (set, found) = (format!("{set:?}"), format!("{found:?}"));
        Err(ClientError::ReadBack { what: "tool offset", set, found }.into())
    }

    pub(super) fn go_to(&mut self, pose: Pose) -> Result<(), ArmError> {
        self.client.set(&Command::PtpCommon(APPROACH_RATIO))?;
        let command = Command::Ptp { mode: PtpMode::MoveJointXyz, target: steps::wire(pose) };
        let index = self.client.enqueue(&command, ROOM)?;
        Ok(self.client.wait_for(index, APPROACH, &mut |_| ())?)
    }

    /// Tries the circle command on the standing queue; an old firmware is silent about it.
    fn probe_circle(&mut self, path: &ToolPath) -> Result<Option<String>, ArmError> {
        let is_circle =
            |step: &&PathStep| matches!(step.curve.motion(), MotionCommand::Circle { .. });
        let Some(step) = path.steps().iter().find(is_circle) else { return Ok(None) };
        self.circle = CircleAs::Circle;
        // The queue is stopped and cleared before and behind: the command is taken, never run.
        self.client.stop()?;
        let commands = steps::commands(step, CircleAs::Circle);
        let Some(circle) = commands.last() else { return Ok(None) };
        let taken = self.client.enqueue(circle, ROOM);
        self.client.stop()?;
        match taken {
            Ok(_) => Ok(None),
            Err(ClientError::Link(LinkError::Silent { .. }) | ClientError::Rejected { .. }) => {
                self.circle = CircleAs::Arcs;
                // It may have raised "undefined instruction"; anything else comes back below.
                self.client.clear_alarms()?;
                Ok(Some(
                    "this firmware does not know the circle command (102): each turn is driven \
                     as two arcs, between which the arm stops"
                        .to_owned(),
                ))
            }
            Err(error) => Err(error.into()),
        }
    }

    pub(super) fn prepare_path(&mut self, path: &ToolPath) -> Result<Vec<String>, ArmError> {
        if let Some(offence) = violations(path, &self.description).into_iter().next() {
            return Err(ArmError::BeyondLimit(Box::new(offence)));
        }
        self.client.refuse_alarms()?;
        let remarks: Vec<String> = self.probe_circle(path)?.into_iter().collect();
        self.set_tool()?;
        self.try_rates(path)?;
        if let Some(Marker { address }) = self.marker {
            self.client.set(&Command::Multiplex { address, function: Command::PIN_IS_OUTPUT })?;
            self.client.set(&Command::Output { address, is_high: false })?;
        }
        self.client.begin()?;
        self.go_to(path.start())?;
        self.path = Some(path.clone());
        Ok(remarks)
    }
}
