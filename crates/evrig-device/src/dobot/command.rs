//! The arm's commands and their encoding.
//!
//! Everything here is a write. Reads carry no parameters but a pin's address,
//! see [`read`]. All numbers are little-endian, floats IEEE 754 single.

use super::fields::{Malformed, PayloadFields};
use super::frame::{ArmFrame, Ctrl};
use super::id;

pub use super::params::{CartesianLimits, CpLimits, PtpMode, Ratios, XyzR};

/// A write: what to set or to do.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ArmCommand {
    /// Clears all alarms whose cause is gone.
    ClearAlarms,
    /// Where homing ends.
    HomeParams(XyzR),
    /// Homing.
    Home,
    /// Tool offset from the flange, mm.
    EndEffector([f32; 3]),
    /// Joint speeds (deg/s) and accelerations (deg/s^2) of point-to-point moves.
    PtpJoint {
        /// One a joint.
        velocity: [f32; 4],
        /// One a joint.
        acceleration: [f32; 4],
    },
    /// Cartesian speeds of point-to-point moves.
    PtpCoordinate(CartesianLimits),
    /// Percentages for point-to-point moves.
    PtpCommon(Ratios),
    /// A point-to-point move.
    Ptp {
        /// How.
        mode: PtpMode,
        /// Whereto: x, y, z, r or four joints, by the mode.
        target: XyzR,
    },
    /// Moves one joint or axis on until the next jog; key 0 ends it.
    Jog {
        /// Joints 1 to 4 instead of x, y, z, r.
        is_joint: bool,
        /// 1, 2 the first forwards and back, and so on to 7, 8.
        key: u8,
    },
    /// Limits of continuous-path moves.
    CpParams(CpLimits),
    /// A continuous-path move; blended with its neighbours in the queue.
    Cp {
        /// Whether `xyz` is a position, not an increment.
        is_absolute: bool,
        /// Millimetres.
        xyz: [f32; 3],
        /// Reserved by the documents, mm/s.
        velocity: f32,
    },
    /// Speeds of arcs and circles.
    ArcParams(CartesianLimits),
    /// An arc from the current pose.
    Arc {
        /// A point on the arc.
        via: XyzR,
        /// Its end.
        to: XyzR,
    },
    /// Whole circles from the current pose, through both points, back to it.
    Circle {
        /// The first point on the circle.
        via: XyzR,
        /// The second.
        to: XyzR,
        /// Number of turns.
        turns: u32,
    },
    /// Percentages for arcs.
    ArcCommon(Ratios),
    /// Waits in the queue, milliseconds.
    Wait(u32),
    /// What a pin is used for; [`ArmCommand::PIN_IS_OUTPUT`] makes it a digital output.
    Multiplex {
        /// Pin 1..=20.
        address: u8,
        /// 0 none, 1 output, 2 PWM, 3 input, 4 ADC, 5 input with pull-up, 6 with pull-down.
        function: u8,
    },
    /// Sets a digital output.
    Output {
        /// Pin 1..=20.
        address: u8,
        /// High or low.
        is_high: bool,
    },
    /// Runs the queue.
    StartQueue,
    /// Stops the queue behind the current command.
    StopQueue,
    /// Breaks off the current command and stops the queue.
    ForceStop,
    /// Empties the queue.
    ClearQueue,
}

impl ArmCommand {
    /// The function of a pin that makes it a digital output.
    pub const PIN_IS_OUTPUT: u8 = 1;

    /// Id of the command, see [`id`].
    #[must_use]
    pub const fn id(&self) -> u8 {
        match self {
            Self::ClearAlarms => id::ALARMS,
            Self::HomeParams(_) => id::HOME_PARAMS,
            Self::Home => id::HOME,
            Self::EndEffector(_) => id::END_EFFECTOR,
            Self::PtpJoint { .. } => id::PTP_JOINT,
            Self::PtpCoordinate(_) => id::PTP_COORDINATE,
            Self::PtpCommon(_) => id::PTP_COMMON,
            Self::Ptp { .. } => id::PTP,
            Self::Jog { .. } => id::JOG,
            Self::CpParams(_) => id::CP_PARAMS,
            Self::Cp { .. } => id::CP,
            Self::ArcParams(_) => id::ARC_PARAMS,
            Self::Arc { .. } => id::ARC,
            Self::Circle { .. } => id::CIRCLE,
            Self::ArcCommon(_) => id::ARC_COMMON,
            Self::Wait(_) => id::WAIT,
            Self::Multiplex { .. } => id::IO_MULTIPLEXING,
            Self::Output { .. } => id::IO_OUTPUT,
            Self::StartQueue => id::QUEUE_START,
            Self::StopQueue => id::QUEUE_STOP,
            Self::ForceStop => id::QUEUE_FORCE_STOP,
            Self::ClearQueue => id::QUEUE_CLEAR,
        }
    }

    /// The frame that does it at once ([`Ctrl::WRITE`]) or in its turn ([`Ctrl::QUEUED`]).
    #[must_use]
    pub fn frame(&self, ctrl: Ctrl) -> ArmFrame {
        // The longest command has 36 parameter bytes, so a frame always holds it.
        ArmFrame::new(self.id(), ctrl, self.params())
            .unwrap_or_else(|| ArmFrame::bare(id::QUEUE_FORCE_STOP, Ctrl::WRITE))
    }

    fn params(&self) -> Vec<u8> {
        let mut out = Vec::new();
        let mut floats = |values: &[f32]| {
            values.iter().for_each(|value| out.extend(value.to_le_bytes()));
        };
        match self {
            Self::HomeParams(pose) => floats(pose),
            Self::EndEffector(bias) => floats(bias),
            Self::PtpJoint { velocity, acceleration } => {
                floats(velocity);
                floats(acceleration);
            }
            Self::PtpCoordinate(limits) | Self::ArcParams(limits) => floats(&[
                limits.xyz_velocity,
                limits.r_velocity,
                limits.xyz_acceleration,
                limits.r_acceleration,
            ]),
            Self::PtpCommon(ratios) | Self::ArcCommon(ratios) => {
                floats(&[ratios.velocity, ratios.acceleration]);
            }
            Self::CpParams(limits) => {
                floats(&[limits.plan_acceleration, limits.junction_velocity, limits.acceleration]);
                out.push(u8::from(limits.is_real_time));
            }
            Self::Ptp { mode, target } => {
                floats(target);
                out.insert(0, *mode as u8);
            }
            Self::Cp { is_absolute, xyz, velocity } => {
                floats(xyz);
                floats(&[*velocity]);
                out.insert(0, u8::from(*is_absolute));
            }
            Self::Arc { via, to } => {
                floats(via);
                floats(to);
            }
            Self::Circle { via, to, turns } => {
                floats(via);
                floats(to);
                out.extend(turns.to_le_bytes());
            }
            Self::Home => out.extend(0_u32.to_le_bytes()),
            Self::Wait(milliseconds) => out.extend(milliseconds.to_le_bytes()),
            Self::Jog { is_joint, key } => out.extend([u8::from(*is_joint), *key]),
            Self::Multiplex { address, function } => out.extend([*address, *function]),
            Self::Output { address, is_high } => out.extend([*address, u8::from(*is_high)]),
            Self::ClearAlarms
            | Self::StartQueue
            | Self::StopQueue
            | Self::ForceStop
            | Self::ClearQueue => {}
        }
        out
    }

    /// Reads a written frame the way the firmware does: forgiving where clients in use
    /// send too little or too much (homing with 0, 1 or 4 bytes, CP with 14, circle with 32).
    ///
    /// `Ok(None)` for a read or for an id this enum does not know.
    ///
    /// # Errors
    /// When the parameters are too short or hold a mode that does not exist.
    pub fn decode(frame: &ArmFrame) -> Result<Option<Self>, Malformed> {
        if !frame.ctrl().is_write() {
            return Ok(None);
        }
        let mut fields = PayloadFields::new(frame.id(), frame.params());
        Self::decode_motion(&mut fields)
            .transpose()
            .or_else(|| Self::decode_rest(&mut fields).transpose())
            .transpose()
    }

    fn decode_motion(fields: &mut PayloadFields<'_>) -> Result<Option<Self>, Malformed> {
        Ok(Some(match fields.id() {
            id::HOME => Self::Home,
            id::PTP => {
                let number = fields.byte()?;
                let mode = PtpMode::ALL.get(usize::from(number)).copied();
                let mode = mode.ok_or_else(|| fields.wrong("mode 0..=9", number))?;
                Self::Ptp { mode, target: fields.floats()? }
            }
            id::CP => Self::Cp {
                is_absolute: fields.byte()? != 0,
                xyz: fields.floats()?,
                velocity: fields.float_or(0.0),
            },
            id::ARC => Self::Arc { via: fields.floats()?, to: fields.floats()? },
            id::CIRCLE => Self::Circle {
                via: fields.floats()?,
                to: fields.floats()?,
                turns: fields.int_or(1),
            },
            id::WAIT => Self::Wait(fields.int()?),
            id::JOG => Self::Jog { is_joint: fields.byte()? != 0, key: fields.byte()? },
            _ => return Ok(None),
        }))
    }

    fn decode_rest(fields: &mut PayloadFields<'_>) -> Result<Option<Self>, Malformed> {
        Ok(Some(match fields.id() {
            id::ALARMS => Self::ClearAlarms,
            id::HOME_PARAMS => Self::HomeParams(fields.floats()?),
            id::END_EFFECTOR => Self::EndEffector(fields.floats()?),
            id::PTP_JOINT => {
                Self::PtpJoint { velocity: fields.floats()?, acceleration: fields.floats()? }
            }
            id::PTP_COORDINATE => Self::PtpCoordinate(CartesianLimits::read(fields)?),
            id::PTP_COMMON => Self::PtpCommon(Ratios::read(fields)?),
            id::CP_PARAMS => Self::CpParams(CpLimits::read(fields)?),
            id::ARC_PARAMS => Self::ArcParams(CartesianLimits::read(fields)?),
            id::ARC_COMMON => Self::ArcCommon(Ratios::read(fields)?),
            id::IO_MULTIPLEXING => {
                Self::Multiplex { address: fields.byte()?, function: fields.byte()? }
            }
            id::IO_OUTPUT => Self::Output { address: fields.byte()?, is_high: fields.byte()? != 0 },
            id::QUEUE_START => Self::StartQueue,
            id::QUEUE_STOP => Self::StopQueue,
            id::QUEUE_FORCE_STOP => Self::ForceStop,
            id::QUEUE_CLEAR => Self::ClearQueue,
            _ => return Ok(None),
        }))
    }
}

/// The request for a value that needs no parameter.
#[must_use]
pub const fn read(id: u8) -> ArmFrame {
    ArmFrame::bare(id, Ctrl::READ)
}

/// Force stop, ready to be written: nothing is computed when it counts.
pub const FORCE_STOP_BYTES: [u8; 6] = [0xaa, 0xaa, 0x02, id::QUEUE_FORCE_STOP, 0x01, 0x0d];
/// Clearing the queue, ready to be written.
pub const CLEAR_QUEUE_BYTES: [u8; 6] = [0xaa, 0xaa, 0x02, id::QUEUE_CLEAR, 0x01, 0x0a];

#[cfg(test)]
mod tests {
    use super::super::frame::ArmFrameDecoder;
    use super::*;
    use proptest::prelude::*;

    fn hex(text: &str) -> Vec<u8> {
        text.split_whitespace().map(|byte| u8::from_str_radix(byte, 16).unwrap()).collect()
    }

    fn limits(velocity: f32) -> CartesianLimits {
        CartesianLimits::uniform(velocity, velocity)
    }

    /// Settings and orders as clients in use send them, byte by byte.
    fn settings() -> Vec<(ArmCommand, Ctrl, &'static str)> {
        vec![
            (ArmCommand::StartQueue, Ctrl::WRITE, "aa aa 02 f0 01 0f"),
            (ArmCommand::ClearQueue, Ctrl::WRITE, "aa aa 02 f5 01 0a"),
            (ArmCommand::ForceStop, Ctrl::WRITE, "aa aa 02 f2 01 0d"),
            (ArmCommand::ClearAlarms, Ctrl::WRITE, "aa aa 02 14 01 eb"),
            (ArmCommand::Home, Ctrl::QUEUED, "aa aa 06 1f 03 00 00 00 00 de"),
            (ArmCommand::Wait(200), Ctrl::QUEUED, "aa aa 06 6e 03 c8 00 00 00 c7"),
            (
                ArmCommand::PtpJoint { velocity: [200.0; 4], acceleration: [200.0; 4] },
                Ctrl::QUEUED,
                "aa aa 22 50 03 00 00 48 43 00 00 48 43 00 00 48 43 00 00 48 43 \
                 00 00 48 43 00 00 48 43 00 00 48 43 00 00 48 43 55",
            ),
            (
                ArmCommand::PtpCoordinate(limits(200.0)),
                Ctrl::QUEUED,
                "aa aa 12 51 03 00 00 48 43 00 00 48 43 00 00 48 43 00 00 48 43 80",
            ),
            (
                ArmCommand::PtpCommon(Ratios { velocity: 100.0, acceleration: 100.0 }),
                Ctrl::QUEUED,
                "aa aa 0a 53 03 00 00 c8 42 00 00 c8 42 96",
            ),
            (
                ArmCommand::PtpCommon(Ratios { velocity: 15.0, acceleration: 15.0 }),
                Ctrl::WRITE,
                "aa aa 0a 53 01 00 00 70 41 00 00 70 41 4a",
            ),
            (
                ArmCommand::ArcParams(limits(50.0)),
                Ctrl::WRITE,
                "aa aa 12 64 01 00 00 48 42 00 00 48 42 00 00 48 42 00 00 48 42 73",
            ),
        ]
    }

    /// Motions as clients in use send them, byte by byte.
    fn motions() -> Vec<(ArmCommand, Ctrl, &'static str)> {
        let via = [252.0, 12.0, 100.0, 90.0];
        let to = [264.0, 0.0, 100.0, 90.0];
        let start = [240.0, 0.0, 100.0, 90.0];
        let line = [239.104_13, 0.0, 11.514_719, 0.0];
        let mode = PtpMode::MoveJointXyz;
        vec![
            (
                ArmCommand::Ptp { mode: PtpMode::MoveLineXyz, target: line },
                Ctrl::QUEUED,
                "aa aa 13 54 03 02 a8 1a 6f 43 00 00 00 00 4a 3c 38 41 00 00 00 00 34",
            ),
            (
                ArmCommand::Ptp { mode, target: start },
                Ctrl::QUEUED,
                "aa aa 13 54 03 01 00 00 70 43 00 00 00 00 00 00 c8 42 00 00 b4 42 f5",
            ),
            (
                ArmCommand::Ptp { mode, target: [250.0, 0.0, 0.0, 0.0] },
                Ctrl::QUEUED,
                "aa aa 13 54 03 01 00 00 7a 43 00 00 00 00 00 00 00 00 00 00 00 00 eb",
            ),
            (
                ArmCommand::Arc { via, to },
                Ctrl::QUEUED,
                "aa aa 22 65 03 00 00 7c 43 00 00 40 41 00 00 c8 42 00 00 b4 42 \
                 00 00 84 43 00 00 00 00 00 00 c8 42 00 00 b4 42 91",
            ),
            (
                ArmCommand::Circle { via, to, turns: 1 },
                Ctrl::QUEUED,
                "aa aa 26 66 03 00 00 7c 43 00 00 40 41 00 00 c8 42 00 00 b4 42 \
                 00 00 84 43 00 00 00 00 00 00 c8 42 00 00 b4 42 01 00 00 00 8f",
            ),
        ]
    }

    #[test]
    fn commands_encode_to_the_bytes_clients_in_use_send() {
        for (command, ctrl, bytes) in settings().into_iter().chain(motions()) {
            assert_eq!(command.frame(ctrl).to_bytes(), hex(bytes), "{command:?}");
        }
    }

    #[test]
    fn the_bytes_clients_in_use_send_decode_to_commands() {
        for (command, ctrl, bytes) in settings().into_iter().chain(motions()) {
            let mut frames = Vec::new();
            ArmFrameDecoder::default().push(&hex(bytes), |frame| frames.push(frame));
            assert_eq!(frames.len(), 1, "{command:?}");
            assert_eq!(frames[0].ctrl(), ctrl);
            assert_eq!(ArmCommand::decode(&frames[0]).unwrap(), Some(command));
        }
    }

    #[test]
    fn the_ready_made_stop_is_the_encoded_one() {
        assert_eq!(ArmCommand::ForceStop.frame(Ctrl::WRITE).to_bytes(), FORCE_STOP_BYTES);
        assert_eq!(ArmCommand::ClearQueue.frame(Ctrl::WRITE).to_bytes(), CLEAR_QUEUE_BYTES);
    }

    #[test]
    fn reads_encode_as_in_the_traces() {
        let table = [
            (id::POSE, "aa aa 02 0a 00 f6"),
            (id::QUEUE_INDEX, "aa aa 02 f6 00 0a"),
            (id::QUEUE_SPACE, "aa aa 02 f7 00 09"),
            (id::ALARMS, "aa aa 02 14 00 ec"),
            (id::DEVICE_VERSION, "aa aa 02 02 00 fe"),
        ];
        for (id, bytes) in table {
            assert_eq!(read(id).to_bytes(), hex(bytes), "{:?}", id::name(id));
        }
    }

    #[test]
    fn malformed_commands_that_clients_send_are_understood() {
        let short_home = ArmFrame::new(id::HOME, Ctrl::WRITE, vec![0]).unwrap();
        assert_eq!(ArmCommand::decode(&short_home), Ok(Some(ArmCommand::Home)));
        let cp = hex("aa aa 10 5b 03 01 00 00 48 43 00 00 00 00 00 00 00 00 00 16");
        let mut frames = Vec::new();
        ArmFrameDecoder::default().push(&cp, |frame| frames.push(frame));
        let expected = ArmCommand::Cp { is_absolute: true, xyz: [200.0, 0.0, 0.0], velocity: 0.0 };
        assert_eq!(ArmCommand::decode(&frames[0]), Ok(Some(expected)));
        let circle = ArmFrame::new(id::CIRCLE, Ctrl::QUEUED, vec![0; 32]).unwrap();
        assert!(matches!(
            ArmCommand::decode(&circle),
            Ok(Some(ArmCommand::Circle { turns: 1, .. }))
        ));
    }

    #[test]
    fn too_few_bytes_are_named() {
        let frame = ArmFrame::new(id::ARC, Ctrl::QUEUED, vec![0; 31]).unwrap();
        let error = ArmCommand::decode(&frame).unwrap_err().to_string();
        assert!(error.contains("ARC") && error.contains("31"), "{error}");
        let frame = ArmFrame::new(id::PTP, Ctrl::QUEUED, vec![10; 17]).unwrap();
        let error = ArmCommand::decode(&frame).unwrap_err().to_string();
        assert!(error.contains("mode 0..=9") && error.contains("10"), "{error}");
    }

    fn any_command() -> impl Strategy<Value = ArmCommand> {
        let number = || -1e4_f32..1e4;
        let pose = || [number(), number(), number(), number()];
        let three = || [number(), number(), number()];
        prop_oneof![
            pose().prop_map(ArmCommand::HomeParams),
            three().prop_map(ArmCommand::EndEffector),
            (pose(), pose()).prop_map(|(velocity, acceleration)| ArmCommand::PtpJoint {
                velocity,
                acceleration
            }),
            (number(), number())
                .prop_map(|(v, a)| ArmCommand::ArcParams(CartesianLimits::uniform(v, a))),
            (number(), number()).prop_map(|(velocity, acceleration)| ArmCommand::ArcCommon(
                Ratios { velocity, acceleration }
            )),
            (prop::sample::select(PtpMode::ALL.to_vec()), pose())
                .prop_map(|(mode, target)| ArmCommand::Ptp { mode, target }),
            (three(), any::<bool>()).prop_map(|(v, is_real_time)| ArmCommand::CpParams(CpLimits {
                plan_acceleration: v[0],
                junction_velocity: v[1],
                acceleration: v[2],
                is_real_time,
            })),
            (any::<bool>(), three(), number()).prop_map(|(is_absolute, xyz, velocity)| {
                ArmCommand::Cp { is_absolute, xyz, velocity }
            }),
            (pose(), pose()).prop_map(|(via, to)| ArmCommand::Arc { via, to }),
            (pose(), pose(), any::<u32>()).prop_map(|(via, to, turns)| ArmCommand::Circle {
                via,
                to,
                turns
            }),
            any::<u32>().prop_map(ArmCommand::Wait),
            (any::<bool>(), any::<u8>())
                .prop_map(|(is_joint, key)| ArmCommand::Jog { is_joint, key }),
            (any::<u8>(), any::<u8>())
                .prop_map(|(address, function)| ArmCommand::Multiplex { address, function }),
            (any::<u8>(), any::<bool>())
                .prop_map(|(address, is_high)| ArmCommand::Output { address, is_high }),
        ]
    }

    proptest! {
        #[test]
        fn a_command_comes_back_from_the_wire_unchanged(command in any_command()) {
            let bytes = command.frame(Ctrl::QUEUED).to_bytes();
            let mut frames = Vec::new();
            ArmFrameDecoder::default().push(&bytes, |frame| frames.push(frame));
            prop_assert_eq!(frames.len(), 1);
            prop_assert_eq!(ArmCommand::decode(&frames[0]), Ok(Some(command)));
        }
    }
}
