//! The codec: bytes to messages and back, without I/O.

use crate::format::raw10;
use crate::geometry::Size;
use crate::session::{ClockSandwich, FrameMetadata, PiFrame};
use crate::time::Span;
use crate::units::Hertz;
use serde::{Deserialize, Serialize};

/// The version of the protocol spoken here.
pub const VERSION: u32 = 1;
/// What both sides send first, before the version.
const MAGIC: &[u8; 8] = b"EVRIGPI\0";
/// Bytes of magic and version.
pub const PREAMBLE_BYTES: usize = 12;
/// The longest message: a full 12-megapixel frame, raw and RGB, and room.
pub const MAX_MESSAGE_BYTES: usize = 64 << 20;
/// The longest head; real ones have some hundred bytes.
const MAX_HEAD_BYTES: usize = 1 << 16;

/// How frames are to be taken; the agent answers with what it read back.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Settings {
    /// Columns and rows.
    pub size: Size,
    /// Frames a second.
    #[serde(rename = "frame_rate_hz")]
    pub frame_rate: Hertz,
    /// How long a row sees light, ns.
    #[serde(rename = "exposure_ns")]
    pub exposure: Span,
    /// Analogue gain.
    pub gain: f64,
    /// Whether raw frames are wanted.
    pub raw: bool,
    /// Whether RGB frames are wanted.
    pub rgb: bool,
}

/// What the two sides say to each other.
#[derive(Debug, Clone, PartialEq)]
pub enum Message {
    /// Agent: what camera there is.
    Hello {
        /// Model, and version of evrig.
        camera: String,
    },
    /// Host: these settings, please.
    Configure(Settings),
    /// Agent: these settings hold.
    Configured(Settings),
    /// Host: let frames come.
    Start,
    /// Agent: one frame.
    Frame(Box<PiFrame>),
    /// Host: read your clocks.
    AskClock,
    /// Agent: the clocks.
    Clock(ClockSandwich),
    /// Host: no more frames.
    Stop,
    /// Agent: the last frame was sent.
    Stopped {
        /// Frames that were sent.
        n_sent: u64,
        /// Frames for which there was no room.
        n_dropped: u64,
    },
    /// Agent: I cannot, or not for you.
    Refused {
        /// Why, and what to do.
        because: String,
    },
}

#[derive(Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
enum Head {
    Hello { camera: String },
    Configure { settings: Settings },
    Configured { settings: Settings },
    Start,
    Frame { metadata: FrameMetadata, n_raw: Option<usize>, n_rgb: Option<usize> },
    AskClock,
    Clock { reading: ClockSandwich },
    Stop,
    Stopped { n_sent: u64, n_dropped: u64 },
    Refused { because: String },
}

/// Bytes that are not what the protocol has there.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum WireError {
    /// Something else listens there.
    #[error("expected the first bytes of an evrig agent, found \"{}\"; is that the agent's port?", .found.escape_ascii())]
    NotEvrig {
        /// The first bytes.
        found: Vec<u8>,
    },
    /// Another version.
    #[error(
        "the other side speaks version {found} of the protocol, this evrig {VERSION}; install the same evrig on host and Pi"
    )]
    Version {
        /// Its version.
        found: u32,
    },
    /// A length beyond all measure.
    #[error(
        "message {index}: {what} of {found} bytes, above the limit of {limit}; the connection is damaged"
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

/// A message as bytes.
#[must_use]
pub fn encode(message: &Message) -> Vec<u8> {
    let (head, pictures): (Head, [Option<&[u8]>; 2]) = match message.clone_head() {
        Ok(head) => (head, [None, None]),
        Err(frame) => {
            let [raw, rgb] = [&frame.raw10, &frame.rgb].map(|p| p.as_deref());
            let head = Head::Frame {
                metadata: frame.metadata.clone(),
                n_raw: raw.map(<[u8]>::len),
                n_rgb: rgb.map(<[u8]>::len),
            };
            (head, [raw, rgb])
        }
    };
    // These heads are plain values: JSON can always hold them.
    let head = serde_json::to_vec(&head).unwrap_or_default();
    let n_pictures: usize = pictures.iter().flatten().map(|picture| picture.len()).sum();
    let mut bytes = Vec::with_capacity(8 + head.len() + n_pictures);
    bytes.extend(((4 + head.len() + n_pictures) as u32).to_le_bytes());
    bytes.extend((head.len() as u32).to_le_bytes());
    bytes.extend(head);
    pictures.into_iter().flatten().for_each(|picture| bytes.extend_from_slice(picture));
    bytes
}

impl Message {
    /// The head of a message without pictures; a frame itself, which has some.
    fn clone_head(&self) -> Result<Head, &PiFrame> {
        Ok(match self {
            Self::Frame(frame) => return Err(frame),
            Self::Hello { camera } => Head::Hello { camera: camera.clone() },
            Self::Configure(settings) => Head::Configure { settings: settings.clone() },
            Self::Configured(settings) => Head::Configured { settings: settings.clone() },
            Self::Start => Head::Start,
            Self::AskClock => Head::AskClock,
            Self::Clock(reading) => Head::Clock { reading: *reading },
            Self::Stop => Head::Stop,
            Self::Stopped { n_sent, n_dropped } => {
                Head::Stopped { n_sent: *n_sent, n_dropped: *n_dropped }
            }
            Self::Refused { because } => Head::Refused { because: because.clone() },
        })
    }
}

/// Puts messages together from bytes as they come.
#[derive(Debug, Default)]
pub struct Decoder {
    bytes: Vec<u8>,
    n_messages: u64,
}

impl Decoder {
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
        let (head, pictures) = body.split_at(n_head);
        let message =
            parse(head, pictures).map_err(|because| WireError::Malformed { index, because })?;
        self.bytes.drain(..4 + length);
        self.n_messages += 1;
        Ok(Some(message))
    }
}

fn parse(head: &[u8], pictures: &[u8]) -> Result<Message, String> {
    let head: Head = serde_json::from_slice(head).map_err(|error| error.to_string())?;
    if !matches!(head, Head::Frame { .. }) && !pictures.is_empty() {
        return Err(format!("{} bytes behind a message without pictures", pictures.len()));
    }
    Ok(match head {
        Head::Hello { camera } => Message::Hello { camera },
        Head::Configure { settings } => Message::Configure(settings),
        Head::Configured { settings } => Message::Configured(settings),
        Head::Start => Message::Start,
        Head::AskClock => Message::AskClock,
        Head::Clock { reading } => Message::Clock(reading),
        Head::Stop => Message::Stop,
        Head::Stopped { n_sent, n_dropped } => Message::Stopped { n_sent, n_dropped },
        Head::Refused { because } => Message::Refused { because },
        Head::Frame { metadata, n_raw, n_rgb } => {
            let size = metadata.size;
            let row = raw10::row_bytes(size.width).map_err(|error| error.to_string())?;
            let expected =
                [n_raw.map(|_| row * usize::from(size.height)), n_rgb.map(|_| 3 * size.n_pixels())];
            let total: usize = expected.iter().flatten().sum();
            if expected != [n_raw, n_rgb] || pictures.len() != total {
                return Err(format!(
                    "a frame of {size} has pictures of {expected:?} bytes, found {:?} in {}",
                    [n_raw, n_rgb],
                    pictures.len()
                ));
            }
            let (raw, rgb) = pictures.split_at(n_raw.unwrap_or(0));
            let frame = PiFrame {
                metadata,
                raw10: n_raw.map(|_| raw.to_vec()),
                rgb: n_rgb.map(|_| rgb.to_vec()),
            };
            Message::Frame(Box::new(frame))
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::pi::source::{FrameSource, Synthetic};
    use proptest::prelude::*;

    fn settings() -> Settings {
        Settings {
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

    fn messages() -> Vec<Message> {
        let reading = crate::device::pi::read_clocks();
        vec![
            Message::Hello { camera: "imx708".into() },
            Message::Configure(settings()),
            Message::Configured(settings()),
            Message::Start,
            frame(),
            Message::AskClock,
            Message::Clock(reading),
            Message::Stop,
            Message::Stopped { n_sent: 9, n_dropped: 1 },
            Message::Refused { because: "busy".into() },
        ]
    }

    #[test]
    fn a_message_is_two_lengths_a_head_and_its_pictures() {
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
        assert_eq!(&preamble(), b"EVRIGPI\0\x01\0\0\0");
    }

    #[test]
    fn another_version_and_another_program_are_told_apart() {
        assert_eq!(check_preamble(&preamble()), Ok(()));
        let newer = check_preamble(b"EVRIGPI\0\x02\0\0\0").unwrap_err();
        assert_eq!(newer, WireError::Version { found: 2 });
        assert!(newer.to_string().contains("install the same evrig"));
        assert!(matches!(check_preamble(b"HTTP/1.1 400"), Err(WireError::NotEvrig { .. })));
    }

    #[test]
    fn lengths_beyond_measure_are_refused_before_anything_is_kept() {
        for bytes in [[0xff; 8], [9, 0, 0, 0, 6, 0, 0, 0], [0xff, 0xff, 0, 1, 1, 0, 2, 0]] {
            let mut decoder = Decoder::default();
            decoder.push(&bytes);
            assert!(matches!(decoder.take(), Err(WireError::Oversize { .. })), "{bytes:?}");
        }
    }

    #[test]
    fn a_frame_that_is_not_what_its_size_says_is_refused() {
        let text =
            String::from_utf8_lossy(&encode(&frame())).replace("\"n_raw\":40", "\"n_raw\":41");
        let start = text.find('{').unwrap();
        assert!(text.contains("\"n_raw\":41"), "{text}");
        let head = &text.as_bytes()[start..text.rfind('}').unwrap() + 1];
        assert!(parse(head, &[0; 136]).unwrap_err().contains("pictures"));
    }

    proptest! {
        #[test]
        fn messages_come_back_however_the_bytes_are_cut(cuts in prop::collection::vec(1_usize..200, 1..40)) {
            let sent = messages();
            let bytes: Vec<u8> = sent.iter().flat_map(encode).collect();
            let (mut decoder, mut found) = (Decoder::default(), Vec::new());
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
            which in 0_usize..10, at in any::<prop::sample::Index>(), value in any::<u8>(),
        ) {
            let mut bytes = encode(&messages()[which]);
            let at = at.index(bytes.len());
            bytes[at] = value;
            let mut decoder = Decoder::default();
            decoder.push(&bytes);
            let _ = decoder.take();
        }
    }
}
