//! Frames of the Pi's camera, recorded or imported.

use super::recorded_frame::{FrameProperties, RecordedFrame, stated_size};
use crate::rig::middle_crop_origin_px;
use crate::rig_log::{ImageReader, StoredImage, Topic};
use crate::{Session, SessionError, StreamEntry};
use evrig_core::frame::{BayerOrder, Channels, Frame, FrameTiming, Samples};
use evrig_core::geometry::Size;
use evrig_core::time::{PiSensor, Span, Stamp, Unix};
use evrig_format::npy::ArrayReader;
use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

/// The IMX708's pedestal of ten bits, which imported recordings do not state.
const IMX708_BLACK_LEVEL_DN: f32 = 64.0;

enum PiSource {
    Log(Box<ImageReader>),
    Npy {
        reader: Box<ArrayReader<BufReader<File>>>,
        stamps: std::iter::Zip<std::vec::IntoIter<i64>, std::vec::IntoIter<i64>>,
        size: Size,
    },
}

/// Frames of a stream of the Pi's camera, on the clock of its SensorTimestamp, in the order in
/// which they came; a damaged file gives what precedes the damage.
///
/// The stamp is the end of the exposure of the first row that the sensor reads, and the crop's rows
/// come later: `timing.exposure` is that of the crop's first row, `frame.origin` its position.
/// An import states neither exposure nor row time: its timing is the bare stamp, and its RGB frames
/// are exposed at least one frame later than their stamp.
pub struct PiCameraFrames {
    source: PiSource,
    path: PathBuf,
    is_raw: bool,
    row_time: Span,
    origin: [i16; 2],
    raw_bits: u8,
    next: u64,
}

impl PiCameraFrames {
    pub(super) fn open(session: &Session, entry: &StreamEntry) -> Result<Self, SessionError> {
        let path = session.layout().inside(&entry.file)?;
        let size = stated_size(session, entry)?;
        let is_array = path.extension().is_some_and(|extension| extension == "npy");
        let is_raw = if is_array { entry.name == "raw" } else { entry.source == Topic::Raw.name() };
        let source = if is_array {
            open_npy(&path, size)?
        } else {
            let topic = if is_raw { Topic::Raw } else { Topic::Rgb };
            PiSource::Log(Box::new(ImageReader::open(&path, topic)?))
        };
        let pi = session.rig()?.map(|rig| rig.pi);
        let pi = pi.as_ref();
        Ok(Self {
            source,
            path,
            is_raw,
            row_time: pi.map_or(Span::ZERO, |pi| pi.camera.row_time),
            origin: pi.map_or_else(|| middle_crop_origin_px(size), |pi| pi.crop_origin_px),
            raw_bits: pi.map_or(10, |pi| pi.raw_bits),
            next: 0,
        })
    }

    /// Images left out so far because they have no metadata.
    #[must_use]
    pub fn n_without_metadata(&self) -> u64 {
        match &self.source {
            PiSource::Log(reader) => reader.n_without_metadata(),
            PiSource::Npy { .. } => 0,
        }
    }

    fn recorded(&self, stored: StoredImage) -> Result<RecordedFrame<PiSensor>, SessionError> {
        let StoredImage { metadata, samples } = stored;
        let size = metadata.size;
        let rows = |n: i64| Span::from_nanos(self.row_time.as_nanos().saturating_mul(n));
        let first_end = metadata.sensor_timestamp + rows(self.origin[1].into());
        let timing = FrameTiming {
            stamp: metadata.sensor_timestamp,
            exposure: Some([first_end - metadata.exposure, first_end]),
            readout: Some([first_end, first_end + rows(size.height.into())]),
            row_time: self.row_time,
        };
        let bayer = if self.is_raw {
            Some(metadata.bayer.parse().map_err(|error: evrig_core::keyword::UnknownKeyword| {
                let frame = metadata.sequence;
                SessionError::import(&self.path, format!("frame {frame}: {error}"))
            })?)
        } else {
            None
        };
        let properties = FrameProperties {
            bits: if self.is_raw { self.raw_bits } else { 8 },
            bayer,
            // The processing that makes RGB has taken the pedestal off.
            black_dn: if self.is_raw { metadata.black_levels.map(f32::from) } else { [0.0; 4] },
            gain: Some(metadata.analogue_gain * metadata.digital_gain),
            real_time: Some(metadata.real_time),
        };
        Ok(self.image(timing, size, samples, 3, properties))
    }

    fn imported(
        &self,
        stamp: Stamp<PiSensor>,
        real_time: Option<Stamp<Unix>>,
        size: Size,
        samples: Samples,
    ) -> RecordedFrame<PiSensor> {
        let properties = FrameProperties {
            bits: if self.is_raw { 10 } else { 8 },
            bayer: self.is_raw.then_some(BayerOrder::Rggb),
            black_dn: [if self.is_raw { IMX708_BLACK_LEVEL_DN } else { 0.0 }; 4],
            gain: None,
            real_time,
        };
        self.image(FrameTiming::from_stamp(stamp), size, samples, 4, properties)
    }

    /// The frame; colours come as R, G, B (and one unused), `n_stored` samples per pixel.
    fn image(
        &self,
        timing: FrameTiming<PiSensor>,
        size: Size,
        samples: Samples,
        n_stored: usize,
        properties: FrameProperties,
    ) -> RecordedFrame<PiSensor> {
        let (channels, samples) = match samples {
            Samples::U8(rgb) if !self.is_raw => {
                let pixels = rgb.chunks_exact(n_stored);
                let bgr = pixels.flat_map(|pixel| [pixel[2], pixel[1], pixel[0]]).collect();
                (Channels::Bgr, Samples::U8(bgr))
            }
            samples => (Channels::Gray, samples),
        };
        let frame = Frame { timing, size, origin: self.origin, channels, samples };
        RecordedFrame { number: self.next, frame, properties }
    }

    fn read(&mut self) -> Option<Result<RecordedFrame<PiSensor>, SessionError>> {
        match &mut self.source {
            PiSource::Log(reader) => match reader.next()? {
                Ok(stored) => Some(self.recorded(stored)),
                Err(error) => Some(Err(error.into())),
            },
            PiSource::Npy { reader, stamps, size } => {
                let (stamp_ns, real_us) = stamps.next()?;
                let size = *size;
                let n = size.n_pixels();
                let samples = if self.is_raw {
                    reader.next_u16(n).map(Samples::U16)
                } else {
                    reader.next_u8(n * 4).map(Samples::U8)
                };
                let real = real_time(real_us);
                let stamp = Stamp::from_nanos(stamp_ns);
                Some(match samples {
                    Ok(samples) => Ok(self.imported(stamp, real, size, samples)),
                    Err(error) => Err(error.into()),
                })
            }
        }
    }
}

impl Iterator for PiCameraFrames {
    type Item = Result<RecordedFrame<PiSensor>, SessionError>;

    fn next(&mut self) -> Option<Self::Item> {
        let image = self.read()?;
        self.next += 1;
        Some(image)
    }
}

fn open_npy(path: &Path, size: Size) -> Result<PiSource, SessionError> {
    let sensor = read_column(&path.with_file_name("sensor_timestamp_ns.npy"))?;
    let real = read_column(&path.with_file_name("real_time_us.npy"))?;
    let reader = ArrayReader::open(path)?;
    let n_frames = reader.shape().first().copied().unwrap_or(0) as usize;
    // There may be more stamps than frames, whose last ones then were not stored whole.
    let n = n_frames.min(sensor.len()).min(real.len());
    let [mut sensor, mut real] = [sensor, real];
    sensor.truncate(n);
    real.truncate(n);
    Ok(PiSource::Npy { reader: Box::new(reader), stamps: sensor.into_iter().zip(real), size })
}

/// The import wrote zero for a time that could not be read.
pub(super) fn real_time(us: i64) -> Option<Stamp<Unix>> {
    (us != 0).then(|| Stamp::from_micros(us))
}

/// An array of whole numbers.
pub(crate) fn read_column(path: &Path) -> Result<Vec<i64>, SessionError> {
    let column = ArrayReader::open(path)?.read_all()?.fields.pop();
    let column = column.and_then(|(_, column)| column.into_integers().ok());
    column.ok_or_else(|| SessionError::import(path, "is not a column of whole numbers"))
}
