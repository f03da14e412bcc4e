//! What the arm answers, typed.

use super::alarm::Alarms;
use super::fields::{Malformed, PayloadFields};
use super::frame::ArmFrame;
use serde::{Deserialize, Serialize};

/// Position of the planner: where the arm believes it is, not a measurement of the tool.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseReply {
    /// x, y, z (mm) and r (deg).
    pub xyzr: [f32; 4],
    /// Base, rear arm, forearm, end (deg).
    pub joints: [f32; 4],
}

/// Firmware version.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Version {
    /// First number.
    pub major: u8,
    /// Second number.
    pub minor: u8,
    /// Third number.
    pub revision: u8,
}

impl std::fmt::Display for Version {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}.{}.{}", self.major, self.minor, self.revision)
    }
}

fn fields(reply: &ArmFrame) -> PayloadFields<'_> {
    PayloadFields::new(reply.id(), reply.params())
}

/// Reads the reply to [`super::id::POSE`].
///
/// # Errors
/// When it is shorter than 32 bytes.
pub fn pose(reply: &ArmFrame) -> Result<PoseReply, Malformed> {
    let mut fields = fields(reply);
    Ok(PoseReply { xyzr: fields.floats()?, joints: fields.floats()? })
}

/// Reads the reply to [`super::id::ALARMS`].
///
/// # Errors
/// When it is shorter than 16 bytes.
pub fn alarms(reply: &ArmFrame) -> Result<Alarms, Malformed> {
    let short = |params: &[u8]| Malformed::Short {
        id: reply.id(),
        found: params.len(),
        needed: Alarms::N_BYTES,
    };
    let bytes = reply.params().first_chunk().ok_or_else(|| short(reply.params()))?;
    Ok(Alarms::from_bytes(*bytes))
}

/// Reads the reply to [`super::id::DEVICE_VERSION`]; what follows the third byte is ignored.
///
/// # Errors
/// When it is shorter than three bytes.
pub fn version(reply: &ArmFrame) -> Result<Version, Malformed> {
    let mut fields = fields(reply);
    Ok(Version { major: fields.byte()?, minor: fields.byte()?, revision: fields.byte()? })
}

/// Reads a name or a serial number: text up to the first NUL, bytes that are not text replaced.
#[must_use]
pub fn text(reply: &ArmFrame) -> String {
    let bytes = reply.params().split(|byte| *byte == 0).next().unwrap_or_default();
    String::from_utf8_lossy(bytes).trim().to_owned()
}

/// Reads the queue index that answers a queued command; `None` for the empty answer of a
/// firmware that did not take it.
///
/// # Errors
/// When it is neither empty nor eight bytes.
pub fn queued_index(reply: &ArmFrame) -> Result<Option<u64>, Malformed> {
    if reply.params().is_empty() { Ok(None) } else { index(reply).map(Some) }
}

/// Reads the reply to [`super::id::QUEUE_INDEX`].
///
/// # Errors
/// When it is shorter than eight bytes.
pub fn index(reply: &ArmFrame) -> Result<u64, Malformed> {
    fields(reply).long()
}

/// Reads the reply to [`super::id::QUEUE_SPACE`]: u32 on a Magician, u64 on a Magician Lite.
///
/// # Errors
/// When it is shorter than four bytes.
pub fn queue_space(reply: &ArmFrame) -> Result<u64, Malformed> {
    if reply.params().len() >= 8 { index(reply) } else { fields(reply).int().map(u64::from) }
}

/// Reads `N` floats from the front of a reply.
///
/// # Errors
/// When there are fewer.
pub fn floats<const N: usize>(reply: &ArmFrame) -> Result<[f32; N], Malformed> {
    fields(reply).floats()
}

#[cfg(test)]
mod tests {
    use super::super::frame::ArmFrameDecoder;
    use super::super::{frame::Ctrl, id};
    use super::*;

    fn frame(text: &str) -> ArmFrame {
        let bytes: Vec<u8> =
            text.split_whitespace().map(|byte| u8::from_str_radix(byte, 16).unwrap()).collect();
        let mut frames = Vec::new();
        ArmFrameDecoder::default().push(&bytes, |frame| frames.push(frame));
        assert_eq!(frames.len(), 1);
        frames.remove(0)
    }

    #[test]
    fn a_pose_reply_reads_as_printed() {
        let reply = frame(
            "aa aa 22 0a 00 54 8d 81 43 00 00 00 00 b6 c3 07 c1 00 00 00 00 \
             00 00 00 00 00 00 34 42 00 00 34 42 00 00 00 00 24",
        );
        let pose = pose(&reply).unwrap();
        assert!((pose.xyzr[0] - 259.104).abs() < 1e-3, "{pose:?}");
        assert!((pose.xyzr[2] + 8.485).abs() < 1e-3, "{pose:?}");
        assert_eq!(pose.joints, [0.0, 45.0, 45.0, 0.0]);
    }

    #[test]
    fn the_queue_replies_read_as_in_the_traces() {
        let queued = frame("aa aa 0a 54 03 07 00 00 00 00 00 00 00 a2");
        assert_eq!(queued_index(&queued), Ok(Some(7)));
        assert_eq!(index(&frame("aa aa 0a f6 00 07 00 00 00 00 00 00 00 03")), Ok(7));
        assert_eq!(queue_space(&frame("aa aa 06 f7 00 20 00 00 00 e9")), Ok(32));
        let rejected = ArmFrame::bare(id::PTP, Ctrl::QUEUED);
        assert_eq!(queued_index(&rejected), Ok(None));
        let cut = ArmFrame::new(id::PTP, Ctrl::QUEUED, vec![1, 2, 3]).unwrap();
        assert!(queued_index(&cut).is_err());
    }

    #[test]
    fn the_space_of_a_lite_is_eight_bytes() {
        let reply = ArmFrame::new(id::QUEUE_SPACE, Ctrl::READ, 500_u64.to_le_bytes().to_vec());
        assert_eq!(queue_space(&reply.unwrap()), Ok(500));
    }

    #[test]
    fn a_version_with_trailing_bytes_is_its_first_three() {
        let version = version(&frame("aa aa 05 02 00 03 07 00 f4")).unwrap();
        assert_eq!(version.to_string(), "3.7.0");
        let long = ArmFrame::new(id::DEVICE_VERSION, Ctrl::READ, vec![3; 14]).unwrap();
        assert!(super::version(&long).is_ok());
    }

    #[test]
    fn a_name_ends_at_its_nul() {
        let reply = ArmFrame::new(id::DEVICE_NAME, Ctrl::READ, b"Dobot\0rubbish".to_vec()).unwrap();
        assert_eq!(text(&reply), "Dobot");
    }
}
