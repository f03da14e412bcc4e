//! Properties of the simulated arm, and what is assumed where the documents are silent.

use super::dynamics::Imperfections;
use super::kinematics::SimulatedJointLimits;
use evrig_core::time::Span;

/// Parameters that set the speed of arcs and circles; to be measured on a real arm.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ArcSpeed {
    /// The ARC parameters, as the API description states.
    #[default]
    ArcParams,
    /// The PTP Cartesian parameters and ratio, as the vendor's virtual Magician Lite does it.
    PtpCoordinate,
}

/// Effect of a command that cannot be planned on the queue.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum AlarmPolicy {
    /// The queue stops until the alarm is cleared, as users of a Magician report.
    #[default]
    Stall,
    /// The command is dropped and the queue continues, as the virtual Magician Lite does it.
    Skip,
}

/// Options of the simulated arm.
#[derive(Debug, Clone, PartialEq)]
pub struct ArmOptions {
    /// Places in the queue.
    pub queue_depth: usize,
    /// Queue index before the first command.
    pub start_index: u64,
    /// Whether the firmware knows command 102.
    pub has_circle: bool,
    /// Whether the free queue space is reported in eight bytes, as by a Magician Lite.
    pub wide_space: bool,
    /// Whether speeds above 300 mm/s and accelerations above 400 mm/s^2 are silently lowered, as
    /// the virtual Magician Lite does it.
    pub clamps: bool,
    /// Whether it is homed and without alarms at power-up.
    pub is_homed: bool,
    /// Duration of homing.
    pub homing: Span,
    /// Delay of each answer on the host's clock: the wire alone takes 3.8 ms for a pose at 115200
    /// baud.
    pub reply_delay: Span,
    /// Parameters that set the speed of arcs.
    pub arc_speed: ArcSpeed,
    /// Effect of an alarm on the queue.
    pub on_alarm: AlarmPolicy,
    /// Limits of the joints.
    pub limits: SimulatedJointLimits,
    /// Deviation of the tool from the planner.
    pub imperfections: Imperfections,
    /// Its serial number.
    pub serial: String,
}

impl Default for ArmOptions {
    fn default() -> Self {
        Self {
            queue_depth: 32,
            start_index: 0,
            has_circle: true,
            wide_space: false,
            clamps: false,
            is_homed: false,
            homing: Span::from_micros(15_000_000),
            reply_delay: Span::ZERO,
            arc_speed: ArcSpeed::default(),
            on_alarm: AlarmPolicy::default(),
            limits: SimulatedJointLimits::default(),
            imperfections: Imperfections::default(),
            serial: "EVRIG-SIM-0001".to_owned(),
        }
    }
}
