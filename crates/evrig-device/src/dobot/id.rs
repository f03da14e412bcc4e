//! The ids of the Magician's commands (protocol V1.1.5, API description V1.2.3).

macro_rules! ids {
    ($($(#[$doc:meta])* $name:ident = $value:literal),+ $(,)?) => {
        $($(#[$doc])* pub const $name: u8 = $value;)+

        /// The name of an id, or `None` when no document knows it.
        #[must_use]
        pub const fn name(id: u8) -> Option<&'static str> {
            match id {
                $($value => Some(stringify!($name)),)+
                _ => None,
            }
        }
    };
}

ids! {
    /// Serial number: ASCII and NUL.
    DEVICE_SERIAL = 0,
    /// Name: ASCII and NUL.
    DEVICE_NAME = 1,
    /// Firmware version: major, minor, revision and, by firmware, more.
    DEVICE_VERSION = 2,
    /// Whether the arm is mounted on the sliding rail.
    DEVICE_WITH_RAIL = 3,
    /// Milliseconds since boot, u32.
    DEVICE_TIME = 4,
    /// Chip id, three u32.
    DEVICE_ID = 5,
    /// Pose: x, y, z (mm), r (deg), then the four joints (deg), f32.
    POSE = 10,
    /// Sets the planner's pose from the angle sensors.
    RESET_POSE = 11,
    /// Velocity and acceleration, f32.
    KINEMATICS = 12,
    /// Position on the rail, f32 mm.
    POSE_RAIL = 13,
    /// Whether a pose is within the limits (newer firmware).
    CHECK_POSE = 15,
    /// Alarms, 16 bytes of bits; written with rw = 1 it clears them.
    ALARMS = 20,
    /// Clears alarms in some clients; the arm's own is [`ALARMS`] with rw = 1.
    ALARMS_CLEAR_OLD = 21,
    /// Where homing ends.
    HOME_PARAMS = 30,
    /// Homing.
    HOME = 31,
    /// Levelling.
    AUTO_LEVELING = 32,
    /// Whether homing has ended (newer clients).
    HOME_STATUS = 33,
    /// Hand-hold teaching: what triggers it.
    TEACH_TRIGGER_MODE = 40,
    /// Hand-hold teaching: on or off.
    TEACH_TRIGGER_ENABLE = 41,
    /// Hand-hold teaching: whether it is triggered.
    TEACH_TRIGGER = 42,
    /// Tool offset from the flange, mm.
    END_EFFECTOR = 60,
    /// Laser.
    LASER = 61,
    /// Suction cup.
    SUCTION_CUP = 62,
    /// Gripper.
    GRIPPER = 63,
    /// Jog speeds of the joints.
    JOG_JOINT = 70,
    /// Jog speeds of the axes.
    JOG_COORDINATE = 71,
    /// Jog ratios.
    JOG_COMMON = 72,
    /// Jog.
    JOG = 73,
    /// Jog speed of the rail.
    JOG_RAIL = 74,
    /// Point-to-point joint speeds and accelerations.
    PTP_JOINT = 80,
    /// Point-to-point Cartesian speeds and accelerations.
    PTP_COORDINATE = 81,
    /// Jump height and limit.
    PTP_JUMP = 82,
    /// Ratios of speed and acceleration, percent.
    PTP_COMMON = 83,
    /// Point-to-point move.
    PTP = 84,
    /// Rail speed of point-to-point moves.
    PTP_RAIL = 85,
    /// Point-to-point move with the rail.
    PTP_WITH_RAIL = 86,
    /// Jump with two heights.
    PTP_JUMP_2 = 87,
    /// Point-to-point move with outputs on the way.
    PTP_WITH_OUTPUT = 88,
    /// Continuous-path limits.
    CP_PARAMS = 90,
    /// Continuous-path move.
    CP = 91,
    /// Continuous-path move with laser power.
    CP_LASER = 92,
    /// Continuous path: hold r.
    CP_HOLD_R = 93,
    /// Continuous path: ratios.
    CP_COMMON = 94,
    /// Arc speeds and accelerations.
    ARC_PARAMS = 100,
    /// Arc through a point to a point.
    ARC = 101,
    /// Whole circles through two points.
    CIRCLE = 102,
    /// Ratios of arcs.
    ARC_COMMON = 103,
    /// Waits in the queue, u32 ms.
    WAIT = 110,
    /// Waits in the queue for an input.
    TRIGGER = 120,
    /// What a pin is used for.
    IO_MULTIPLEXING = 130,
    /// Digital output.
    IO_OUTPUT = 131,
    /// Pulse-width modulation.
    IO_PWM = 132,
    /// Digital input.
    IO_INPUT = 133,
    /// Analogue input.
    IO_ADC = 134,
    /// Stepper motor at an extra port.
    MOTOR = 135,
    /// Stepper motor over a distance.
    MOTOR_STEPS = 136,
    /// Colour sensor.
    COLOR_SENSOR = 137,
    /// Infrared switch.
    IR_SWITCH = 138,
    /// Static error of the angle sensors.
    ANGLE_SENSOR_ERROR = 140,
    /// Coefficients of the angle sensors.
    ANGLE_SENSOR_COEFFICIENT = 141,
    /// Wireless: on or off.
    WIFI_ENABLE = 150,
    /// How many lost steps raise an alarm.
    LOST_STEP_PARAMS = 170,
    /// Checks for lost steps in the queue.
    LOST_STEP = 171,
    /// Runs the queue.
    QUEUE_START = 240,
    /// Stops the queue when the current command has ended.
    QUEUE_STOP = 241,
    /// Breaks off the current command and stops the queue.
    QUEUE_FORCE_STOP = 242,
    /// Begins an offline program.
    DOWNLOAD_START = 243,
    /// Ends an offline program.
    DOWNLOAD_STOP = 244,
    /// Empties the queue.
    QUEUE_CLEAR = 245,
    /// Index of the last finished command, u64.
    QUEUE_INDEX = 246,
    /// Free places in the queue, u32 (u64 on a Magician Lite).
    QUEUE_SPACE = 247,
}
