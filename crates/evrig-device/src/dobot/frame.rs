//! Frames on the wire, and finding them again after garbage.
//!
//! `AA AA | len | id | ctrl | params | checksum`, `len` counting id, ctrl and
//! params. The checksum makes the bytes from id to checksum sum to zero modulo
//! 256; header and `len` are not covered, so a corrupted `len` must be survived
//! by looking for the next header.

use serde::{Deserialize, Serialize};
use std::fmt;

/// The two bytes that open a frame.
const HEADER: u8 = 0xaa;
/// `len` of a frame without parameters.
const MIN_LEN: usize = 2;
/// The largest `len` the firmware takes.
const MAX_LEN: usize = 250;
/// The most parameter bytes a frame can carry.
pub const MAX_PARAMS: usize = MAX_LEN - MIN_LEN;
/// Bytes of a frame besides those that `len` counts.
const OVERHEAD: usize = 4;

/// The third byte behind the header: what is asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Ctrl(pub u8);

impl Ctrl {
    /// Read a value.
    pub const READ: Self = Self(0);
    /// Write or do at once.
    pub const WRITE: Self = Self(1);
    /// Write or do when its turn in the queue comes.
    pub const QUEUED: Self = Self(3);

    /// Whether the frame writes (bit 0).
    #[must_use]
    pub const fn is_write(self) -> bool {
        self.0 & 1 != 0
    }

    /// Whether the frame goes into the queue (bit 1).
    #[must_use]
    pub const fn is_queued(self) -> bool {
        self.0 & 2 != 0
    }
}

/// One request or reply.
#[derive(Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "FrameParts", into = "FrameParts")]
pub struct ArmFrame {
    id: u8,
    ctrl: Ctrl,
    params: Vec<u8>,
}

impl ArmFrame {
    /// A frame, or `None` when `params` holds more than [`MAX_PARAMS`] bytes.
    #[must_use]
    pub fn new(id: u8, ctrl: Ctrl, params: Vec<u8>) -> Option<Self> {
        (params.len() <= MAX_PARAMS).then_some(Self { id, ctrl, params })
    }

    /// A frame without parameters.
    #[must_use]
    pub const fn bare(id: u8, ctrl: Ctrl) -> Self {
        Self { id, ctrl, params: Vec::new() }
    }

    /// What the frame is about, see [`super::id`].
    #[must_use]
    pub const fn id(&self) -> u8 {
        self.id
    }

    /// Read, write or queue.
    #[must_use]
    pub const fn ctrl(&self) -> Ctrl {
        self.ctrl
    }

    /// The parameter bytes, at most [`MAX_PARAMS`].
    #[must_use]
    pub fn params(&self) -> &[u8] {
        &self.params
    }

    /// The frame as it goes over the wire.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        let len = MIN_LEN + self.params.len();
        let mut bytes = Vec::with_capacity(len + OVERHEAD);
        bytes.extend([HEADER, HEADER, len as u8, self.id, self.ctrl.0]);
        bytes.extend(&self.params);
        bytes.push(checksum(&bytes[3..]));
        bytes
    }

    /// Whether `reply` can be the answer to this request: same id, same ctrl.
    #[must_use]
    pub fn is_answered_by(&self, reply: &Self) -> bool {
        reply.id == self.id && reply.ctrl == self.ctrl
    }
}

/// A frame as it goes through the pipe to the guard: id, ctrl, parameters.
#[derive(Serialize, Deserialize)]
struct FrameParts(u8, u8, Vec<u8>);

impl From<ArmFrame> for FrameParts {
    fn from(frame: ArmFrame) -> Self {
        Self(frame.id, frame.ctrl.0, frame.params)
    }
}

impl TryFrom<FrameParts> for ArmFrame {
    type Error = &'static str;

    fn try_from(FrameParts(id, ctrl, params): FrameParts) -> Result<Self, Self::Error> {
        Self::new(id, Ctrl(ctrl), params).ok_or("a frame has 248 parameter bytes at most")
    }
}

impl fmt::Debug for ArmFrame {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "id {} ctrl {:02x} params", self.id, self.ctrl.0)?;
        self.params.iter().try_for_each(|byte| write!(f, " {byte:02x}"))
    }
}

/// What makes `covered` and itself sum to zero modulo 256.
fn checksum(covered: &[u8]) -> u8 {
    covered.iter().fold(0_u8, |sum, byte| sum.wrapping_add(*byte)).wrapping_neg()
}

/// Finds frames in a stream of bytes; holds less than one frame.
#[derive(Debug, Default)]
pub struct ArmFrameDecoder {
    held: Vec<u8>,
    n_skipped: u64,
}

impl ArmFrameDecoder {
    /// Takes bytes and passes every whole frame to `found`, in order.
    pub fn push(&mut self, bytes: &[u8], mut found: impl FnMut(ArmFrame)) {
        for &byte in bytes {
            self.held.push(byte);
            self.settle(&mut found);
        }
    }

    /// Gives up on the frame that is only partly here and looks for others behind its
    /// first byte. To be called when the line has fallen silent: a corrupted `len`
    /// would otherwise swallow the frames that follow.
    pub fn give_up(&mut self, mut found: impl FnMut(ArmFrame)) {
        while !self.held.is_empty() {
            self.skip(1);
            self.settle(&mut found);
        }
    }

    /// Bytes passed over because they belong to no frame.
    #[must_use]
    pub const fn n_skipped(&self) -> u64 {
        self.n_skipped
    }

    /// Takes frames off the front until more bytes are needed.
    fn settle(&mut self, found: &mut impl FnMut(ArmFrame)) {
        while let Some(step) = self.front() {
            match step {
                Front::Noise => self.skip(1),
                Front::Whole(total) => {
                    let frame = ArmFrame {
                        id: self.held[3],
                        ctrl: Ctrl(self.held[4]),
                        params: self.held[5..total - 1].to_vec(),
                    };
                    self.held.drain(..total);
                    found(frame);
                }
            }
        }
    }

    /// What the held bytes begin with; `None` when that is not decided yet.
    fn front(&self) -> Option<Front> {
        let header = self.held.iter().take(2);
        if header.into_iter().any(|byte| *byte != HEADER) {
            return Some(Front::Noise);
        }
        let len = usize::from(*self.held.get(2)?);
        if !(MIN_LEN..=MAX_LEN).contains(&len) {
            return Some(Front::Noise);
        }
        let total = len + OVERHEAD;
        let covered = self.held.get(3..total)?;
        // Only one byte is passed over on a bad sum: the next header may lie inside.
        Some(if checksum(covered) == 0 { Front::Whole(total) } else { Front::Noise })
    }

    fn skip(&mut self, n: usize) {
        self.held.drain(..n);
        self.n_skipped += n as u64;
    }
}

enum Front {
    Noise,
    Whole(usize),
}

/// Whatever the bytes, decoding ends, holds less than a frame, and what it finds
/// encodes to bytes that were there; `decode` is given each frame. For the fuzzer and for tests.
///
/// # Panics
/// When that is not so.
pub fn fuzz(bytes: &[u8], mut decode: impl FnMut(&ArmFrame)) {
    let mut decoder = ArmFrameDecoder::default();
    let mut frames = Vec::new();
    decoder.push(bytes, |frame| frames.push(frame));
    assert!(decoder.held.len() < MAX_LEN + OVERHEAD, "less than one frame is held");
    decoder.give_up(|frame| frames.push(frame));
    let mut n_in_frames = 0;
    for frame in &frames {
        let encoded = frame.to_bytes();
        assert!(bytes.windows(encoded.len()).any(|window| window == encoded), "{frame:?}");
        n_in_frames += encoded.len() as u64;
        decode(frame);
    }
    assert_eq!(n_in_frames + decoder.n_skipped(), bytes.len() as u64, "no byte is lost");
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn decode(bytes: &[u8]) -> Vec<ArmFrame> {
        let mut frames = Vec::new();
        let mut decoder = ArmFrameDecoder::default();
        decoder.push(bytes, |frame| frames.push(frame));
        frames
    }

    #[test]
    fn the_checksum_of_a_sum_of_zero_is_zero() {
        // A popular Python client sends FF here (modulo 255) and its frame is dropped.
        assert_eq!(ArmFrame::bare(0xff, Ctrl::WRITE).to_bytes().last(), Some(&0x00));
        assert_eq!(ArmFrame::bare(0xfe, Ctrl::WRITE).to_bytes().last(), Some(&0x01));
        assert_eq!(ArmFrame::bare(0x00, Ctrl::WRITE).to_bytes().last(), Some(&0xff));
    }

    #[test]
    fn a_frame_with_a_wrong_checksum_is_passed_over() {
        // A user's trace: EA was ignored by the arm, EB was answered.
        let mut bytes = vec![0xaa, 0xaa, 0x13, 0x54, 0x03, 0x01, 0, 0, 0x7a, 0x43];
        bytes.extend([0; 12]);
        let good = [&bytes[..], &[0xeb]].concat();
        assert!(decode(&[&bytes[..], &[0xea]].concat()).is_empty());
        assert_eq!(decode(&good).len(), 1);
    }

    #[test]
    fn a_header_inside_the_parameters_does_not_end_the_frame() {
        let frame = ArmFrame::new(1, Ctrl::WRITE, vec![0xaa, 0xaa, 0x02, 0x0a]).unwrap();
        assert_eq!(decode(&frame.to_bytes()), [frame]);
    }

    #[test]
    fn a_length_outside_the_firmwares_range_is_noise() {
        let good = ArmFrame::bare(10, Ctrl::READ).to_bytes();
        for len in [0, 1, 251, 255] {
            let bytes = [&[0xaa, 0xaa, len][..], &good].concat();
            assert_eq!(decode(&bytes).len(), 1, "len {len}");
        }
        assert!(ArmFrame::new(1, Ctrl::WRITE, vec![0; MAX_PARAMS + 1]).is_none());
    }

    #[test]
    fn a_corrupted_length_costs_its_own_frame_only() {
        let frame = ArmFrame::bare(10, Ctrl::READ);
        let mut first = frame.to_bytes();
        first[2] = 200;
        let mut decoder = ArmFrameDecoder::default();
        let mut frames = Vec::new();
        decoder.push(&[first, frame.to_bytes()].concat(), |frame| frames.push(frame));
        assert!(frames.is_empty(), "the decoder still waits for 200 bytes");
        decoder.give_up(|frame| frames.push(frame));
        assert_eq!(frames, [frame]);
    }

    prop_compose! {
        fn any_frame()(
            id: u8, ctrl in 0_u8..4, params in prop::collection::vec(any::<u8>(), 0..=MAX_PARAMS),
        ) -> ArmFrame {
            ArmFrame::new(id, Ctrl(ctrl), params).unwrap()
        }
    }

    proptest! {
        #[test]
        fn what_is_encoded_is_decoded_however_it_is_cut(
            frames in prop::collection::vec(any_frame(), 1..5), chunk in 1_usize..40,
        ) {
            let bytes: Vec<u8> = frames.iter().flat_map(ArmFrame::to_bytes).collect();
            let mut found = Vec::new();
            let mut decoder = ArmFrameDecoder::default();
            for part in bytes.chunks(chunk) {
                decoder.push(part, |frame| found.push(frame));
            }
            prop_assert_eq!(found, frames);
            prop_assert_eq!(decoder.n_skipped(), 0);
        }

        #[test]
        fn a_frame_behind_garbage_is_found(
            garbage in prop::collection::vec(any::<u8>(), 0..300), frame in any_frame(),
        ) {
            // Garbage that happens to hold a header may swallow what follows, until the line is
            // silent.
            let mut found = Vec::new();
            let mut decoder = ArmFrameDecoder::default();
            decoder.push(&garbage, |_| ());
            decoder.give_up(|_| ());
            decoder.push(&frame.to_bytes(), |frame| found.push(frame));
            prop_assert_eq!(found, vec![frame]);
        }

        #[test]
        fn any_bytes_decode_without_losing_one(bytes in prop::collection::vec(any::<u8>(), 0..600)) {
            fuzz(&bytes, |_| {});
        }

        #[test]
        fn any_bytes_made_of_headers_decode(
            bytes in prop::collection::vec(prop::sample::select(vec![0xaa_u8, 2, 4, 10, 0xf6]), 0..600),
        ) {
            fuzz(&bytes, |_| {});
        }
    }
}
