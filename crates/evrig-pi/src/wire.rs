//! The codec: bytes to messages and back, without I/O.

mod images;

use super::coding::{self, CodingError};
use super::discipline::DisciplineReport;
use super::order::{CaptureOrder, CaptureSettings, Coding};
use evrig_core::pi_camera::{ClockSandwich, FrameMetadata, PiFrame, RawClockSandwich};
pub use images::MAX_MESSAGE_BYTES;
use images::{ImageHead, frame};
use serde::{Deserialize, Serialize};

/// The version of the protocol.
pub const VERSION: u32 = 3;
/// What both sides send first, before the version.
const MAGIC: &[u8; 8] = b"EVRIGPI\0";
/// Bytes of magic and version.
pub const PREAMBLE_BYTES: usize = 12;
/// The most that a probe of the link may ask for.
pub const MAX_PROBE_BYTES: usize = 32 << 20;
/// The longest head; real ones have some hundred bytes.
const MAX_HEAD_BYTES: usize = 1 << 16;

/// The Pi's clocks, read in one go.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct PiClockReading {
    /// The wall clock between two readings of the boot clock.
    pub boot: ClockSandwich,
    /// The wall clock between two readings of the clock that nothing steers.
    pub raw: RawClockSandwich,
}

/// What became of a take.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct TakeTally {
    /// Frames that were sent while they came.
    pub n_sent: u64,
    /// Frames that fitted neither memory nor spool.
    pub n_dropped: u64,
    /// Frames that had to wait on the Pi's disk because the network was slower than the camera.
    pub n_spooled: u64,
    /// RGB images sent after the take.
    pub n_late: u64,
    /// RGB images that did not fit the spool.
    pub n_late_dropped: u64,
}

/// A message of either side. Its head is this enum as JSON; frames and fillers have a head of their own.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Message {
    /// Agent: what camera there is.
    Hello {
        /// Model, and version of evrig.
        camera: String,
    },
    /// Host: this is how, please.
    Configure(CaptureOrder),
    /// Agent: this holds.
    Configured {
        /// What the camera read back.
        settings: CaptureSettings,
        /// The camera's description of itself, for the manifest.
        description: serde_json::Value,
    },
    /// Host: let frames come.
    Start,
    /// Agent: one frame.
    #[serde(skip)]
    Frame(Box<PiFrame>),
    /// Agent, after the take: the RGB image of a frame that was sent without it.
    #[serde(skip)]
    LateRgb(Box<PiFrame>),
    /// Host: read your clocks.
    AskClock,
    /// Agent: the clocks.
    Clock(PiClockReading),
    /// Host: what keeps your clock right?
    AskDiscipline,
    /// Agent: this.
    Discipline(DisciplineReport),
    /// Host: send so many bytes, to measure the link.
    Probe {
        /// How many, at most [`MAX_PROBE_BYTES`].
        n_bytes: usize,
    },
    /// Agent: bytes without meaning.
    #[serde(skip)]
    Filler(Vec<u8>),
    /// Host: no more frames.
    Stop,
    /// Agent: no more frames are taken; these are still to be sent.
    Draining {
        /// Messages.
        n_messages: u64,
        /// Bytes of them.
        n_bytes: u64,
    },
    /// Agent: the last frame was sent.
    Stopped(TakeTally),
    /// Agent: I cannot, or not for you.
    Refused {
        /// Why, and what to do.
        because: String,
    },
}

/// The head of a message that is followed by bytes.
#[derive(Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
enum BinaryHead {
    Frame { metadata: FrameMetadata, raw: Option<ImageHead>, rgb: Option<ImageHead> },
    LateRgb { metadata: FrameMetadata, rgb: Option<ImageHead> },
    Filler { n_bytes: usize },
}

/// What every head has.
#[derive(Deserialize)]
struct HeadKind {
    kind: String,
}

/// Bytes that are not what the protocol has there.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum WireError {
    /// Something else listens there.
    #[error(
        "expected the first bytes of an evrig agent, found \"{}\"; is that the agent's port?",
        .found.escape_ascii()
    )]
    NotEvrig {
        /// The first bytes.
        found: Vec<u8>,
    },
    /// Another version.
    #[error(
        "the other side speaks version {found} of the protocol, this evrig {VERSION}; install the \
         same evrig on host and Pi"
    )]
    Version {
        /// Its version.
        found: u32,
    },
    /// A length beyond all measure.
    #[error(
        "message {index}: {what} of {found} bytes, above the limit of {limit}; the connection is \
         damaged"
    )]
    Oversize {
        /// Number of the message.
        index: u64,
        /// Whose length.
        what: &'static str,
        /// What was declared.
        found: usize,
        /// What is allowed.
        limit: usize,
    },
    /// A message that cannot be understood.
    #[error("message {index}: {because}; the connection is damaged or the versions differ")]
    Malformed {
        /// Number of the message.
        index: u64,
        /// Expected and found.
        because: String,
    },
}

/// The first bytes of a side.
#[must_use]
pub fn preamble() -> [u8; PREAMBLE_BYTES] {
    let mut bytes = [0; PREAMBLE_BYTES];
    bytes[..8].copy_from_slice(MAGIC);
    bytes[8..].copy_from_slice(&VERSION.to_le_bytes());
    bytes
}

/// Whether the other side's first bytes are those of this version.
///
/// # Errors
/// When they are another program's or another version's.
pub fn check_preamble(bytes: &[u8; PREAMBLE_BYTES]) -> Result<(), WireError> {
    let Some(version) = bytes.strip_prefix(MAGIC).and_then(|rest| rest.try_into().ok()) else {
        return Err(WireError::NotEvrig { found: bytes.to_vec() });
    };
    match u32::from_le_bytes(version) {
        VERSION => Ok(()),
        found => Err(WireError::Version { found }),
    }
}

/// A message as bytes; images are not coded. See [`encode_frame`].
#[must_use]
pub fn encode(message: &Message) -> Vec<u8> {
    match message {
        Message::Frame(frame) => plain(frame, false),
        Message::LateRgb(frame) => plain(frame, true),
        Message::Filler(bytes) => assemble(&BinaryHead::Filler { n_bytes: bytes.len() }, &[bytes]),
        head => assemble(head, &[]),
    }
}

/// A frame as bytes, its images coded; late ones travel alone.
///
/// # Errors
/// When an image does not have the frame's size.
pub fn encode_frame(
    frame: &PiFrame,
    coding: Coding,
    is_late: bool,
) -> Result<Vec<u8>, CodingError> {
    if coding == Coding::Plain {
        return Ok(plain(frame, is_late));
    }
    let size = frame.metadata.size;
    let raw = frame.raw10.as_ref().filter(|_| !is_late);
    let (raw, rgb) = rayon::join(
        || raw.map(|packed| coding::encode_raw10(packed, size)).transpose(),
        || frame.rgb.as_ref().map(|rgb| coding::encode_rgb(rgb, size)).transpose(),
    );
    Ok(with_images(&frame.metadata, [raw?.as_deref(), rgb?.as_deref()], coding, is_late))
}

fn plain(frame: &PiFrame, is_late: bool) -> Vec<u8> {
    let raw = frame.raw10.as_deref().filter(|_| !is_late);
    with_images(&frame.metadata, [raw, frame.rgb.as_deref()], Coding::Plain, is_late)
}

fn with_images(
    metadata: &FrameMetadata,
    images: [Option<&[u8]>; 2],
    coding: Coding,
    is_late: bool,
) -> Vec<u8> {
    let [raw, rgb] =
        images.map(|bytes| bytes.map(|bytes| ImageHead { n_bytes: bytes.len(), coding }));
    let metadata = metadata.clone();
    let head = if is_late {
        BinaryHead::LateRgb { metadata, rgb }
    } else {
        BinaryHead::Frame { metadata, raw, rgb }
    };
    let images: Vec<&[u8]> = images.into_iter().flatten().collect();
    assemble(&head, &images)
}

fn assemble(head: &impl Serialize, images: &[&[u8]]) -> Vec<u8> {
    // These heads are plain values: JSON can always hold them.
    let head = serde_json::to_vec(head).unwrap_or_default();
    let n_images: usize = images.iter().map(|image| image.len()).sum();
    let mut bytes = Vec::with_capacity(8 + head.len() + n_images);
    bytes.extend(((4 + head.len() + n_images) as u32).to_le_bytes());
    bytes.extend((head.len() as u32).to_le_bytes());
    bytes.extend(head);
    images.iter().for_each(|image| bytes.extend_from_slice(image));
    bytes
}

/// Puts messages together from bytes as they come.
#[derive(Debug, Default)]
pub struct MessageDecoder {
    bytes: Vec<u8>,
    n_messages: u64,
}

impl MessageDecoder {
    /// Takes bytes in.
    pub fn push(&mut self, bytes: &[u8]) {
        self.bytes.extend_from_slice(bytes);
    }

    /// The next whole message, if there is one.
    ///
    /// # Errors
    /// When the bytes are no message; nothing behind them can be found again.
    pub fn take(&mut self) -> Result<Option<Message>, WireError> {
        let index = self.n_messages;
        let word = |at: usize| {
            let bytes = self.bytes.get(at..at + 4)?.try_into().ok()?;
            Some(u32::from_le_bytes(bytes) as usize)
        };
        let Some(length) = word(0) else { return Ok(None) };
        if length > MAX_MESSAGE_BYTES {
            let (what, limit) = ("a message", MAX_MESSAGE_BYTES);
            return Err(WireError::Oversize { index, what, found: length, limit });
        }
        let Some(n_head) = word(4) else { return Ok(None) };
        if n_head > MAX_HEAD_BYTES || n_head + 4 > length {
            let (what, limit) = ("a head", MAX_HEAD_BYTES.min(length.saturating_sub(4)));
            return Err(WireError::Oversize { index, what, found: n_head, limit });
        }
        let Some(body) = self.bytes.get(8..4 + length) else { return Ok(None) };
        let (head, images) = body.split_at(n_head);
        let message =
            parse(head, images).map_err(|because| WireError::Malformed { index, because })?;
        self.bytes.drain(..4 + length);
        self.n_messages += 1;
        Ok(Some(message))
    }
}

fn parse(head: &[u8], images: &[u8]) -> Result<Message, String> {
    let text = |error: serde_json::Error| error.to_string();
    let HeadKind { kind } = serde_json::from_slice(head).map_err(text)?;
    if !["frame", "late_rgb", "filler"].contains(&kind.as_str()) {
        let message = serde_json::from_slice(head).map_err(text)?;
        let n_bytes = images.len();
        return match n_bytes {
            0 => Ok(message),
            _ => Err(format!("{n_bytes} bytes behind a message without images")),
        };
    }
    match serde_json::from_slice(head).map_err(text)? {
        BinaryHead::Frame { metadata, raw, rgb } => {
            Ok(Message::Frame(Box::new(frame(metadata, raw, rgb, images)?)))
        }
        BinaryHead::LateRgb { metadata, rgb } => {
            Ok(Message::LateRgb(Box::new(frame(metadata, None, rgb, images)?)))
        }
        BinaryHead::Filler { n_bytes } if n_bytes == images.len() => {
            Ok(Message::Filler(images.to_vec()))
        }
        BinaryHead::Filler { n_bytes } => {
            Err(format!("{n_bytes} bytes of filler, found {}", images.len()))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::order::{Delivery, Focus};
    use crate::source::{FrameSource, Synthetic};
    use evrig_core::geometry::Size;
    use evrig_core::time::Span;
    use evrig_core::units::Hertz;
    use proptest::prelude::*;

    fn settings() -> CaptureSettings {
        CaptureSettings {
            size: Size::new(8, 4),
            frame_rate: Hertz(120.0),
            exposure: Span::from_micros(4_000),
            gain: 1.0,
            raw: true,
            rgb: true,
        }
    }

    fn frame() -> Message {
        let mut source = Synthetic::unpaced(1);
        source.configure(&settings()).unwrap();
        Message::Frame(Box::new(source.next().unwrap().unwrap()))
    }

    fn late() -> Message {
        let Message::Frame(frame) = frame() else { panic!("a frame") };
        Message::LateRgb(Box::new(PiFrame { raw10: None, ..*frame }))
    }

    fn messages() -> Vec<Message> {
        let reading = crate::read_all_clocks();
        let order = CaptureOrder {
            settings: settings(),
            focus: Focus::Once,
            delivery: Delivery::default(),
        };
        let description = serde_json::json!({"lens": 1});
        vec![
            Message::Hello { camera: "imx708".into() },
            Message::Configure(order),
            Message::Configured { settings: settings(), description },
            Message::Start,
            frame(),
            late(),
            Message::AskDiscipline,
            Message::Discipline(DisciplineReport::Unknown { because: "none".into() }),
            Message::Probe { n_bytes: 7 },
            Message::Filler(vec![3; 7]),
            Message::Draining { n_messages: 2, n_bytes: 9 },
            Message::AskClock,
            Message::Clock(reading),
            Message::Stop,
            Message::Stopped(TakeTally { n_sent: 9, n_dropped: 1, ..TakeTally::default() }),
            Message::Refused { because: "busy".into() },
        ]
    }

    #[test]
    fn a_message_is_two_lengths_a_head_and_its_images() {
        let table: [(Message, &[u8]); 2] = [
            (Message::Start, b"\x14\0\0\0\x10\0\0\0{\"kind\":\"start\"}"),
            (Message::AskClock, b"\x18\0\0\0\x14\0\0\0{\"kind\":\"ask_clock\"}"),
        ];
        for (message, bytes) in table {
            assert_eq!(
                encode(&message).escape_ascii().to_string(),
                bytes.escape_ascii().to_string()
            );
        }
        assert_eq!(&preamble(), b"EVRIGPI\0\x03\0\0\0");
    }

    #[test]
    fn another_version_and_another_program_are_distinguished() {
        assert_eq!(check_preamble(&preamble()), Ok(()));
        let newer = check_preamble(b"EVRIGPI\0\x04\0\0\0").unwrap_err();
        assert_eq!(newer, WireError::Version { found: 4 });
        assert!(newer.to_string().contains("install the same evrig"));
        assert!(matches!(check_preamble(b"HTTP/1.1 400"), Err(WireError::NotEvrig { .. })));
    }

    #[test]
    fn lengths_beyond_measure_are_refused_before_anything_is_kept() {
        for bytes in [[0xff; 8], [9, 0, 0, 0, 6, 0, 0, 0], [0xff, 0xff, 0, 1, 1, 0, 2, 0]] {
            let mut decoder = MessageDecoder::default();
            decoder.push(&bytes);
            assert!(matches!(decoder.take(), Err(WireError::Oversize { .. })), "{bytes:?}");
        }
    }

    #[test]
    fn a_frame_that_does_not_match_its_size_is_refused() {
        let text =
            String::from_utf8_lossy(&encode(&frame())).replace("\"n_bytes\":40", "\"n_bytes\":41");
        let start = text.find('{').unwrap();
        assert!(text.contains("\"n_bytes\":41"), "{text}");
        let head = &text.as_bytes()[start..text.rfind('}').unwrap() + 1];
        assert!(parse(head, &[0; 136]).unwrap_err().contains("images"));
    }

    #[test]
    fn a_coded_frame_comes_back_whole_and_a_late_one_without_its_raw_image() {
        let Message::Frame(sent) = frame() else { panic!("a frame") };
        let late = PiFrame { raw10: None, ..*sent.clone() };
        let expected = [Message::Frame(sent.clone()), Message::LateRgb(Box::new(late))];
        for (is_late, expected) in [false, true].into_iter().zip(expected) {
            let mut decoder = MessageDecoder::default();
            decoder.push(&encode_frame(&sent, Coding::Lossless, is_late).unwrap());
            assert_eq!(decoder.take().unwrap(), Some(expected));
        }
    }

    #[test]
    fn a_size_beyond_measure_is_refused_before_it_is_unpacked() {
        let Message::Frame(mut sent) = frame() else { panic!("a frame") };
        sent.metadata.size = Size::new(65_532, 65_535);
        let mut decoder = MessageDecoder::default();
        decoder.push(&plain(&sent, false));
        let error = decoder.take().unwrap_err().to_string();
        assert!(error.contains("larger than a message"), "{error}");
    }

    proptest! {
        #[test]
        fn messages_come_back_however_the_bytes_are_cut(cuts in prop::collection::vec(1_usize..200, 1..40)) {
            let sent = messages();
            let bytes: Vec<u8> = sent.iter().flat_map(encode).collect();
            let (mut decoder, mut found) = (MessageDecoder::default(), Vec::new());
            let mut rest = bytes.as_slice();
            for cut in cuts.iter().cycle() {
                let (now, later) = rest.split_at((*cut).min(rest.len()));
                decoder.push(now);
                while let Some(message) = decoder.take().unwrap() {
                    found.push(message);
                }
                rest = later;
                if rest.is_empty() {
                    break;
                }
            }
            prop_assert_eq!(found, sent);
        }

        #[test]
        fn noise_is_an_error_or_a_message_but_never_a_panic(
            which in 0_usize..16, at in any::<prop::sample::Index>(), value in any::<u8>(),
        ) {
            let mut bytes = encode(&messages()[which]);
            let at = at.index(bytes.len());
            bytes[at] = value;
            let mut decoder = MessageDecoder::default();
            decoder.push(&bytes);
            let _ = decoder.take();
        }
    }
}
