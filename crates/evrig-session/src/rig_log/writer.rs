//! Writing the rig's log.

use super::image::{encode, schema as image_schema, seconds_nanos};
use super::records::{ClockExchange, HostTime, PacketArrival, Severity};
use super::{RigLogError, schema};
use crate::rig::Pose;
use evrig_core::pi_camera::PiFrame;
use evrig_core::raw10;
use evrig_core::time::{HostMonotonic, Span, Stamp, Unix};
use evrig_format::Destination;
use mcap::records::MessageHeader;
use serde::Serialize;
use serde_json::json;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

/// A topic of the log; its number in the file is its place here, from 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Topic {
    /// Raw Bayer frames.
    Raw,
    /// RGB frames.
    Rgb,
    /// Metadata of each frame.
    FrameMetadata,
    /// The Pi's clocks between the host's.
    PiClock,
    /// When packets of the event camera came.
    Arrivals,
    /// The arm's poses.
    ArmPose,
    /// The trajectory's poses.
    Commanded,
    /// Log of the recorder.
    Log,
}

impl Topic {
    pub(super) const ALL: [Self; 8] = [
        Self::Raw,
        Self::Rgb,
        Self::FrameMetadata,
        Self::PiClock,
        Self::Arrivals,
        Self::ArmPose,
        Self::Commanded,
        Self::Log,
    ];

    /// Its name in the file.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Raw => "/pi/raw",
            Self::Rgb => "/pi/rgb",
            Self::FrameMetadata => "/pi/metadata",
            Self::PiClock => "/pi/clock",
            Self::Arrivals => "/davis/arrivals",
            Self::ArmPose => "/arm/pose",
            Self::Commanded => "/arm/commanded",
            Self::Log => "/log",
        }
    }

    const fn schema(self) -> (&'static str, &'static str) {
        match self {
            Self::Raw | Self::Rgb => ("foxglove.RawImage", ""),
            Self::FrameMetadata => ("evrig.FrameMetadata", schema::FRAME_METADATA),
            Self::PiClock => ("evrig.ClockExchange", schema::CLOCK_EXCHANGE),
            Self::Arrivals => ("evrig.PacketArrival", schema::PACKET_ARRIVAL),
            Self::ArmPose | Self::Commanded => ("foxglove.PoseInFrame", schema::POSE_IN_FRAME),
            Self::Log => ("foxglove.Log", schema::LOG),
        }
    }
}

/// A chunk is closed once it holds 8 MiB, about eight frames, ...
const CHUNK_BYTES: u64 = 8 << 20;
/// ... or a quarter of a second after it was begun, so that a truncated file lacks little.
const CHUNK_TIME: Span = Span::from_micros(250_000);

/// Appends to `rig.mcap`.
pub struct RigLogWriter {
    path: PathBuf,
    file: mcap::Writer<BufWriter<Destination>>,
    /// A second handle of the file, for syncing.
    beside: Option<File>,
    channels: Vec<u16>,
    sequences: Vec<u32>,
    n_messages: u64,
    chunk_began: Option<Stamp<HostMonotonic>>,
    /// The first write error; later writes fail without a reason of their own.
    refused: Option<(std::io::ErrorKind, String)>,
}

impl std::fmt::Debug for RigLogWriter {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("RigLogWriter").field("path", &self.path).finish_non_exhaustive()
    }
}

impl RigLogWriter {
    /// Makes the file and declares its topics.
    ///
    /// # Errors
    /// When the file is there already or writing fails.
    pub fn create(path: &Path) -> Result<Self, RigLogError> {
        let file = File::create_new(path)
            .map_err(|source| RigLogError::Open { path: path.to_owned(), source })?;
        let beside = file.try_clone();
        let beside =
            beside.map_err(|source| RigLogError::Open { path: path.to_owned(), source })?;
        Self::begin(Destination::File(file), Some(beside), path)
    }

    /// Writes to a pipe instead of a file; `name` names it in errors. A chunk is in
    /// memory until it is complete, since its header cannot be rewritten.
    ///
    /// # Errors
    /// When the pipe is closed.
    pub fn to_pipe(pipe: Box<dyn Write + Send>, name: &Path) -> Result<Self, RigLogError> {
        Self::begin(Destination::pipe(pipe), None, name)
    }

    fn begin(
        destination: Destination,
        beside: Option<File>,
        path: &Path,
    ) -> Result<Self, RigLogError> {
        let options = mcap::WriteOptions::new()
            .compression(None)
            .chunk_size(Some(CHUNK_BYTES))
            .disable_seeking(!destination.can_seek())
            .profile("")
            .library(concat!("evrig ", env!("CARGO_PKG_VERSION")));
        let failed = |error| failed(path, 0, error);
        let buffered = BufWriter::with_capacity(1 << 20, destination);
        let mut file = options.create(buffered).map_err(failed)?;
        let mut channels = Vec::new();
        for topic in Topic::ALL {
            let (name, text) = topic.schema();
            let (kind, encoding, data) = match text {
                "" => ("protobuf", "protobuf", image_schema()),
                text => ("jsonschema", "json", text.as_bytes().to_vec()),
            };
            let schema = file.add_schema(name, kind, &data).map_err(failed)?;
            let none = std::collections::BTreeMap::new();
            channels.push(file.add_channel(schema, topic.name(), encoding, &none).map_err(failed)?);
        }
        let sequences = vec![0; channels.len()];
        let path = path.to_owned();
        Ok(Self {
            path,
            file,
            beside,
            channels,
            sequences,
            n_messages: 0,
            chunk_began: None,
            refused: None,
        })
    }

    /// Writes a frame's images and metadata.
    ///
    /// # Errors
    /// When an image does not match its size, or writing fails.
    pub fn frame(&mut self, frame: &PiFrame, arrived: HostTime) -> Result<(), RigLogError> {
        let size = frame.metadata.size;
        let at = frame.metadata.real_time;
        if let Some(packed) = &frame.raw10 {
            let samples = raw10::row_bytes(size.width)
                .and_then(|row| raw10::unpack(packed, size, row))
                .map_err(|error| self.unencodable(Topic::Raw, error.to_string()))?;
            let mut bytes = vec![0; samples.len() * 2];
            for (pair, sample) in bytes.chunks_exact_mut(2).zip(&samples) {
                pair.copy_from_slice(&sample.to_le_bytes());
            }
            self.put(Topic::Raw, arrived, at, &encode(at, size, "mono16", bytes))?;
        }
        if let Some(rgb) = &frame.rgb {
            if rgb.len() != size.n_pixels() * 3 {
                let because = format!("{} bytes for {size} pixels of 3", rgb.len());
                return Err(self.unencodable(Topic::Rgb, because));
            }
            self.put(Topic::Rgb, arrived, at, &encode(at, size, "rgb8", rgb.clone()))?;
        }
        self.json(Topic::FrameMetadata, arrived, at, &frame.metadata)
    }

    /// Writes the RGB image of a frame whose metadata were written before. Its own time is that
    /// of the metadata, `real_time_ns`, which joins the two.
    ///
    /// # Errors
    /// When there is no image of the frame's size, or writing fails.
    pub fn late_rgb(&mut self, frame: &PiFrame, arrived: HostTime) -> Result<(), RigLogError> {
        let (size, at) = (frame.metadata.size, frame.metadata.real_time);
        let rgb = frame.rgb.as_deref().unwrap_or_default();
        if rgb.len() != size.n_pixels() * 3 {
            let because = format!("{} bytes for {size} pixels of 3", rgb.len());
            return Err(self.unencodable(Topic::Rgb, because));
        }
        self.put(Topic::Rgb, arrived, at, &encode(at, size, "rgb8", rgb.to_vec()))
    }

    /// Writes readings of the Pi's clocks.
    ///
    /// # Errors
    /// When writing fails.
    pub fn clock(&mut self, exchange: &ClockExchange) -> Result<(), RigLogError> {
        self.json(Topic::PiClock, exchange.answered, exchange.pi.realtime, exchange)
    }

    /// Writes when a packet of the event camera came.
    ///
    /// # Errors
    /// When writing fails.
    pub fn arrival(&mut self, arrival: &PacketArrival) -> Result<(), RigLogError> {
        self.json(Topic::Arrivals, arrival.arrived, arrival.arrived.unix, arrival)
    }

    /// Writes a pose of the tool in the arm's base frame, in metres as Foxglove has it.
    ///
    /// # Errors
    /// When writing fails.
    pub fn pose(&mut self, topic: Topic, at: HostTime, pose: Pose) -> Result<(), RigLogError> {
        let [x, y, z] = pose.position_mm().map(|mm| mm * 1e-3);
        let (sin, cos) = (pose.r.0.to_radians() / 2.0).sin_cos();
        let value = json!({
            "timestamp": time(at.unix), "frame_id": "base",
            "pose": {
                "position": {"x": x, "y": y, "z": z},
                "orientation": {"x": 0.0, "y": 0.0, "z": sin, "w": cos},
            },
        });
        self.json(topic, at, at.unix, &value)
    }

    /// Writes log of the recorder.
    ///
    /// # Errors
    /// When writing fails.
    pub fn log(&mut self, at: HostTime, level: Severity, text: &str) -> Result<(), RigLogError> {
        let value = json!({
            "timestamp": time(at.unix), "level": level as u8, "message": text,
            "name": "record", "file": "", "line": 0,
        });
        self.json(Topic::Log, at, at.unix, &value)
    }

    /// Closes the chunk and flushes to the system, so that only a power failure can lose it.
    ///
    /// # Errors
    /// When writing fails.
    pub fn flush(&mut self) -> Result<(), RigLogError> {
        self.chunk_began = None;
        let flushed = self.file.flush();
        flushed.map_err(|error| self.refused(error))
    }

    /// A second handle of the file, by which another thread can sync it; none for a pipe.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn handle(&self) -> Result<Option<File>, RigLogError> {
        let again = self.beside.as_ref().map(File::try_clone).transpose();
        again.map_err(|source| RigLogError::Open { path: self.path.clone(), source })
    }

    /// Writes the index, and syncs.
    ///
    /// # Errors
    /// When the disk refuses; what was written can be read all the same.
    pub fn finish(mut self) -> Result<(), RigLogError> {
        let finished = self.file.finish();
        finished.map_err(|error| self.refused(error))?;
        let flushed = self.file.into_inner().flush();
        flushed
            .and_then(|()| self.beside.as_ref().map_or(Ok(()), File::sync_all))
            .map_err(|error| failed(&self.path, self.n_messages, error.into()))
    }

    fn json(
        &mut self,
        topic: Topic,
        logged: HostTime,
        published: Stamp<Unix>,
        value: &impl Serialize,
    ) -> Result<(), RigLogError> {
        let bytes = serde_json::to_vec(value)
            .map_err(|error| self.unencodable(topic, error.to_string()))?;
        self.put(topic, logged, published, &bytes)
    }

    fn put(
        &mut self,
        topic: Topic,
        logged: HostTime,
        published: Stamp<Unix>,
        data: &[u8],
    ) -> Result<(), RigLogError> {
        let index = topic as usize;
        let unsigned = |stamp: Stamp<Unix>| u64::try_from(stamp.as_nanos()).unwrap_or(0);
        let header = MessageHeader {
            channel_id: self.channels[index],
            sequence: self.sequences[index],
            log_time: unsigned(logged.unix),
            publish_time: unsigned(published),
        };
        let began = *self.chunk_began.get_or_insert(logged.monotonic);
        let written = self.file.write_to_known_channel(&header, data);
        written.map_err(|error| self.refused(error))?;
        self.sequences[index] = self.sequences[index].wrapping_add(1);
        self.n_messages += 1;
        if logged.monotonic - began >= CHUNK_TIME {
            self.flush()?;
        }
        Ok(())
    }

    /// The first write error, whichever write reports it.
    fn refused(&mut self, error: mcap::McapError) -> RigLogError {
        let error = match (&self.refused, error) {
            (Some((kind, first)), mcap::McapError::AttemptedWriteAfterFailure) => {
                std::io::Error::new(*kind, first.clone()).into()
            }
            (_, mcap::McapError::Io(error)) => {
                self.refused.get_or_insert_with(|| (error.kind(), error.to_string()));
                error.into()
            }
            (_, other) => other,
        };
        failed(&self.path, self.n_messages, error)
    }

    fn unencodable(&self, topic: Topic, because: String) -> RigLogError {
        RigLogError::Encode { path: self.path.clone(), topic: topic.name(), because }
    }
}

fn time(at: Stamp<Unix>) -> serde_json::Value {
    let (sec, nsec) = seconds_nanos(at);
    json!({"sec": sec, "nsec": nsec})
}

fn failed(path: &Path, message: u64, source: mcap::McapError) -> RigLogError {
    RigLogError::Write { path: path.to_owned(), message, source: Box::new(source) }
}
