//! What a recorder delivers.

use evrig_core::pi_camera::PiFrame;
use evrig_format::aedat4::Content;
use evrig_session::{ClockExchange, HostTime};

/// A sample that a recorder delivers.
#[derive(Debug)]
pub enum RecorderSample {
    /// A packet of an event camera, as it came.
    Packet {
        /// Its stream, by the place in
        /// [`PreparedRecorder::streams`](super::PreparedRecorder::streams).
        stream: u32,
        /// When it was whole.
        arrived: HostTime,
        /// What it holds.
        content: Content,
    },
    /// A frame of the frame camera.
    Frame {
        /// When it was whole.
        arrived: HostTime,
        /// Its images and metadata.
        frame: Box<PiFrame>,
    },
    /// The RGB image of a frame that was delivered without it before.
    LateRgb {
        /// When it was whole.
        arrived: HostTime,
        /// The image and the frame's metadata.
        frame: Box<PiFrame>,
    },
    /// A remark of the device for the rig's log.
    Note {
        /// When it was made.
        at: HostTime,
        /// Its text.
        text: String,
    },
    /// Clocks read side by side.
    Clock(ClockExchange),
}

impl RecorderSample {
    /// Events in it.
    #[must_use]
    pub fn n_events(&self) -> u64 {
        match self {
            Self::Packet { content: Content::Events(events), .. } => events.len() as u64,
            _ => 0,
        }
    }

    /// Bytes it takes in memory, nearly.
    #[must_use]
    pub fn n_bytes(&self) -> usize {
        let payload = match self {
            Self::Packet { content, .. } => match content {
                Content::Events(events) => events.len() * 13,
                Content::Frame(frame) => {
                    frame.samples.len() * usize::from(frame.samples.bits()) / 8
                }
                Content::Imu(samples) => samples.len() * 48,
                Content::Triggers(triggers) => triggers.len() * 16,
                Content::Unknown { .. } => 0,
            },
            Self::Frame { frame, .. } | Self::LateRgb { frame, .. } => frame.n_bytes(),
            Self::Note { text, .. } => text.len(),
            Self::Clock(_) => 0,
        };
        payload + 256
    }
}
