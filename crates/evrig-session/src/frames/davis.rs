//! Frames on the events' clock: the DAVIS's own, and imported arrays.

use super::recorded_frame::{FrameProperties, RecordedFrame, stated_size};
use crate::{Session, SessionError, StreamEntry};
use evrig_core::frame::{Frame, FrameTiming, Samples};
use evrig_core::geometry::Size;
use evrig_core::time::{Davis, Stamp};
use evrig_format::aedat4::{Content, Reader};
use evrig_format::npy::ArrayReader;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

enum DavisSource {
    Aedat4 {
        reader: Box<Reader<BufReader<File>>>,
        id: Option<u32>,
    },
    Npy {
        reader: ArrayReader<BufReader<File>>,
        times: std::vec::IntoIter<i64>,
        size: Size,
        n_bytes: usize,
    },
}

/// Frames of a stream on the events' clock; a damaged file gives what precedes the damage.
pub struct DavisFrames {
    source: DavisSource,
    black_dn: f32,
    gain: Option<f64>,
    next: u64,
}

impl DavisFrames {
    pub(super) fn open(session: &Session, entry: &StreamEntry) -> Result<Self, SessionError> {
        let path = session.layout().inside(&entry.file)?;
        let source = if path.extension().is_some_and(|extension| extension == "npy") {
            open_npy(&path, stated_size(session, entry)?)?
        } else {
            DavisSource::Aedat4 { reader: Box::new(Reader::open(&path)?), id: entry.stream_id }
        };
        let camera = session.rig()?.map(|rig| rig.davis.camera);
        Ok(Self {
            source,
            black_dn: camera.as_ref().map_or(0.0, |camera| camera.black_level_dn as f32),
            gain: camera.map(|camera| camera.gain),
            next: 0,
        })
    }

    fn frame(&mut self) -> Option<Result<Frame<Davis>, SessionError>> {
        match &mut self.source {
            DavisSource::Aedat4 { reader, id } => loop {
                let packet = reader.next()?.ok()?;
                match packet.content {
                    Content::Frame(frame) if id.is_none_or(|id| id == packet.stream) => {
                        return Some(Ok(frame));
                    }
                    _ => {}
                }
            },
            DavisSource::Npy { reader, times, size, n_bytes } => {
                let stamp = Stamp::from_micros(times.next()?);
                let n = size.n_pixels();
                let samples = match n_bytes {
                    1 => reader.next_u8(n).map(Samples::U8),
                    _ => reader.next_u16(n).map(Samples::U16),
                };
                let timing = FrameTiming::from_stamp(stamp);
                let frame = samples.map(|samples| Frame::gray(timing, *size, samples));
                Some(frame.map_err(Into::into))
            }
        }
    }
}

fn open_npy(path: &Path, size: Size) -> Result<DavisSource, SessionError> {
    let times = super::pi::read_column(&path.with_file_name("timestamps_us.npy"))?;
    let reader = ArrayReader::open(path)?;
    let n_bytes = reader.unsigned_bytes().filter(|n| *n <= 2);
    let n_bytes = n_bytes.ok_or_else(|| SessionError::import(path, "is not of u8 or u16"))?;
    Ok(DavisSource::Npy { reader, times: times.into_iter(), size, n_bytes })
}

impl Iterator for DavisFrames {
    type Item = Result<RecordedFrame<Davis>, SessionError>;

    fn next(&mut self) -> Option<Self::Item> {
        let frame = match self.frame()? {
            Ok(frame) => frame,
            Err(error) => return Some(Err(error)),
        };
        let number = self.next;
        self.next += 1;
        let properties = FrameProperties {
            bits: frame.samples.bits(),
            bayer: None,
            black_dn: [self.black_dn; 4],
            gain: self.gain,
            real_time: None,
        };
        Some(Ok(RecordedFrame { number, frame, properties }))
    }
}
