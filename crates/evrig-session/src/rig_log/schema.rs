//! The JSON schemas of the log's small messages.

/// Foxglove's time in JSON: whole seconds, and nanoseconds.
macro_rules! time {
    () => {
        r#"{"type":"object","title":"time","properties":{"sec":{"type":"integer","minimum":0},"nsec":{"type":"integer","minimum":0,"maximum":999999999}}}"#
    };
}

/// foxglove.PoseInFrame.
pub(super) const POSE_IN_FRAME: &str = concat!(
    r#"{"title":"foxglove.PoseInFrame","type":"object","properties":{"timestamp":"#,
    time!(),
    r#","frame_id":{"type":"string"},"pose":{"title":"foxglove.Pose","type":"object","properties":{"#,
    r#""position":{"title":"foxglove.Vector3","type":"object","properties":{"x":{"type":"number"},"y":{"type":"number"},"z":{"type":"number"}}},"#,
    r#""orientation":{"title":"foxglove.Quaternion","type":"object","properties":{"x":{"type":"number"},"y":{"type":"number"},"z":{"type":"number"},"w":{"type":"number"}}}}}}}"#
);

/// foxglove.Log.
pub(super) const LOG: &str = concat!(
    r#"{"title":"foxglove.Log","type":"object","properties":{"timestamp":"#,
    time!(),
    r#","level":{"type":"integer"},"message":{"type":"string"},"name":{"type":"string"},"file":{"type":"string"},"line":{"type":"integer","minimum":0}}}"#
);

/// [`evrig_core::pi_camera::FrameMetadata`].
pub(super) const FRAME_METADATA: &str = r#"{"title":"evrig.FrameMetadata","type":"object","properties":{"sequence":{"type":"integer"},"sensor_timestamp_ns":{"type":"integer"},"frame_wall_clock_ns":{"type":["integer","null"]},"real_time_ns":{"type":"integer"},"exposure_ns":{"type":"integer"},"analogue_gain":{"type":"number"},"digital_gain":{"type":"number"},"lens_position":{"type":["number","null"]},"black_levels":{"type":"array","items":{"type":"integer"}},"size":{"type":"object","properties":{"width":{"type":"integer"},"height":{"type":"integer"}}},"bayer":{"type":"string"},"n_dropped":{"type":"integer"}}}"#;

/// [`super::ClockExchange`].
pub(super) const CLOCK_EXCHANGE: &str = r#"{"title":"evrig.ClockExchange","type":"object","properties":{"asked":{"type":"object","properties":{"monotonic_ns":{"type":"integer"},"unix_ns":{"type":"integer"}}},"pi":{"type":"object","properties":{"boottime_before_ns":{"type":"integer"},"realtime_ns":{"type":"integer"},"boottime_after_ns":{"type":"integer"}}},"pi_raw":{"type":["object","null"],"properties":{"monotonic_raw_before_ns":{"type":"integer"},"realtime_ns":{"type":"integer"},"monotonic_raw_after_ns":{"type":"integer"}}},"answered":{"type":"object","properties":{"monotonic_ns":{"type":"integer"},"unix_ns":{"type":"integer"}}}}}"#;

/// [`super::PacketArrival`].
pub(super) const PACKET_ARRIVAL: &str = r#"{"title":"evrig.PacketArrival","type":"object","properties":{"stream":{"type":"integer"},"count":{"type":"integer"},"first_us":{"type":"integer"},"last_us":{"type":"integer"},"arrived":{"type":"object","properties":{"monotonic_ns":{"type":"integer"},"unix_ns":{"type":"integer"}}}}}"#;
