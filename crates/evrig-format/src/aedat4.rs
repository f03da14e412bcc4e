//! AEDAT4, the format of iniVation's cameras: events, frames, inertial samples and triggers.
//!
//! # The wire
//! `#!AER-DAT4.0\r\n`, a `u32` length and an IOHE flatbuffer (compression, position of the data
//! table, XML description of the streams), then packets of `{u32 stream, u32 length, payload}`.
//! A payload is, once decompressed, one size-prefixed flatbuffer: EVTS, FRME, IMUS or TRIG.
//! A file that was closed ends with an FTAB flatbuffer, the data table, at the position that the
//! header names; one that was not has position -1 and ends after any packet. On a socket the
//! same bytes travel without the first fourteen. All numbers are little-endian.
//!
//! # What the crate `aedat` does here
//! Its generated flatbuffer types are used, always after verification. Its decoder is
//! not: it panics on damaged headers (unverified root), allocates whatever length a packet
//! declares before reading it, takes every I/O error between packets for the end of the file,
//! refuses files that hold a stream kind it does not know, and cannot write.
//!
//! # What is not checked here
//! Events are returned as stored: coordinates outside the sensor and disorder are for the session
//! to find ([`evrig_core::event::EventSlice::first_outside`],
//! [`evrig_core::event::EventSlice::first_disorder`]). What cannot be represented at all is counted
//! in [`Losses`]. Most files carry no checksum, so a flipped bit inside a packet may go unseen; the
//! session's own checksums are for that.

mod compression;
mod cut;
mod decode;
mod encode;
mod error;
mod framing;
mod header;
mod lz4_frame;
mod memory;
mod outgoing;
mod overflow;
mod reader;
mod resync;
mod table;
mod writer;

pub use compression::Compression;
pub use encode::EVENT_BYTES;
pub use error::{FilePosition, ReadError, WriteError};
pub use reader::Reader;
pub use writer::{WriteSummary, Writer};

use evrig_core::event::Events;
use evrig_core::frame::Frame;
use evrig_core::geometry::Size;
use evrig_core::imu::{ImuSample, Trigger};
use evrig_core::time::Davis;
use outgoing::PacketInput;

/// Largest packet, compressed or not, that is read or written: 256 MiB, 16 million events.
pub const MAX_PACKET_BYTES: usize = 1 << 28;

/// Kind of a stream's packets.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub enum PayloadKind {
    /// Events.
    Events,
    /// Frames.
    Frames,
    /// Inertial samples.
    Imu,
    /// Triggers.
    Triggers,
    /// An unknown kind, by its four-letter identifier.
    Other(String),
}

impl PayloadKind {
    /// The four-letter identifier in the file.
    #[must_use]
    pub fn identifier(&self) -> &str {
        match self {
            Self::Events => "EVTS",
            Self::Frames => "FRME",
            Self::Imu => "IMUS",
            Self::Triggers => "TRIG",
            Self::Other(identifier) => identifier,
        }
    }

    fn from_identifier(identifier: &str) -> Self {
        match identifier {
            "EVTS" => Self::Events,
            "FRME" => Self::Frames,
            "IMUS" => Self::Imu,
            "TRIG" => Self::Triggers,
            other => Self::Other(other.to_owned()),
        }
    }
}

/// One stream of a file, as its header describes it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StreamHeader {
    /// The number that its packets carry.
    pub id: u32,
    /// The name of the output it was recorded from: `events`, `frames`, ...
    pub name: String,
    /// Kind of its packets.
    pub kind: PayloadKind,
    /// The pixel grid, where the header states one.
    pub size: Option<Size>,
    /// The camera's name, empty where the header states none.
    pub source: String,
}

/// A stream to be written; its number is its place in the list given to the writer.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StreamSpec {
    /// The name by which readers ask for it.
    pub name: String,
    /// Kind of its packets.
    pub kind: PayloadKind,
    /// The pixel grid; events and frames need one.
    pub size: Option<Size>,
    /// The camera's name; dv-processing groups streams by it.
    pub source: String,
}

impl StreamSpec {
    /// Events of a camera, under the name that dv-processing expects.
    #[must_use]
    pub fn events(size: Size, source: &str) -> Self {
        Self::named("events", PayloadKind::Events, Some(size), source)
    }

    /// Frames of a camera, under the name that dv-processing expects.
    #[must_use]
    pub fn frames(size: Size, source: &str) -> Self {
        Self::named("frames", PayloadKind::Frames, Some(size), source)
    }

    /// Inertial samples of a camera, under the name that dv-processing expects.
    #[must_use]
    pub fn imu(source: &str) -> Self {
        Self::named("imu", PayloadKind::Imu, None, source)
    }

    /// Triggers of a camera, under the name that dv-processing expects.
    #[must_use]
    pub fn triggers(source: &str) -> Self {
        Self::named("triggers", PayloadKind::Triggers, None, source)
    }

    fn named(name: &str, kind: PayloadKind, size: Option<Size>, source: &str) -> Self {
        Self { name: name.to_owned(), kind, size, source: source.to_owned() }
    }
}

/// Content of one packet.
#[derive(Debug, Clone, PartialEq)]
pub enum Content {
    /// A run of events.
    Events(Events),
    /// One frame.
    Frame(Frame<Davis>),
    /// A run of inertial samples.
    Imu(Vec<ImuSample>),
    /// A run of triggers.
    Triggers(Vec<Trigger>),
    /// A packet of a kind this reader does not know; its bytes were skipped.
    Unknown {
        /// The four letters by which the header names the kind.
        kind: String,
    },
}

impl Content {
    /// Writes it into a stream; nothing for an unknown kind.
    ///
    /// # Errors
    /// [`WriteError`] when the stream carries something else, or writing fails.
    pub fn write(
        &self,
        writer: &mut Writer<impl std::io::Write>,
        stream: u32,
    ) -> Result<(), WriteError> {
        writer.write_all(PacketInput::of(self).map(|input| (stream, input)))
    }
}

/// One packet and its position.
#[derive(Debug, Clone, PartialEq)]
pub struct Packet {
    /// Number of its stream, see [`StreamHeader::id`].
    pub stream: u32,
    /// FilePosition among all packets, from 0.
    pub index: u64,
    /// Byte at which the packet begins.
    pub offset: u64,
    /// Its content.
    pub content: Content,
}

/// Counts of what was read but cannot be represented.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Losses {
    /// Events with a negative column or row.
    pub events: u64,
    /// Frames whose size, format and pixels do not agree, or in a format unknown here.
    pub frames: u64,
    /// Packets of a stream kind unknown here.
    pub unknown_packets: u64,
    /// Damaged packets that were passed over.
    pub damaged_packets: u64,
    /// Where and how the first of these is damaged.
    pub first_damage: Option<String>,
    /// Where and why the first event or frame was lost.
    pub first: Option<String>,
}

impl Losses {
    /// Whether nothing was lost.
    #[must_use]
    pub fn is_none(&self) -> bool {
        *self == Self::default()
    }
}
