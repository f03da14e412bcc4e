//! A stream for Rerun: event images, frames, the outline of the target, and rates.
//!
//! | entity | archetype | what |
//! | --- | --- | --- |
//! | `/events/<stream>` | Image | 20 ms of events: white for a last event ON, black for OFF |
//! | `/rate/<stream>/on`, `off` | Scalars | events per second by polarity, over the same 20 ms |
//! | `/frames/<stream>` | Image | frames of the event camera |
//! | `/frames/<stream>/picture` | LineStrips2D | outline of the target in the frame |
//! | `/about` | TextDocument | `<file>.json` without its tables |
//!
//! The timeline `events` is the events' clock; an event image carries the time at which its 20 ms
//! end. Of the Pi's frames there are only the outlines: the frames are in `rig.mcap`.

use super::images::Images;
use super::window::windows;
use super::{Chosen, EventSelection, ExportError, ExportRequest};
use evrig_core::frame::{Channels, Samples};
use evrig_core::geometry::Size;
use evrig_session::Session;
use re_sdk::{AsComponents, RecordingStream, RecordingStreamBuilder};
use re_types::archetypes::{Image, LineStrips2D, Scalars, TextDocument};
use re_types::datatypes::{ChannelDatatype, ColorModel};
use std::path::{Path, PathBuf};

pub(super) fn write(
    session: &Session,
    request: &ExportRequest,
    chosen: &Chosen,
    images: &[Images],
    about: &str,
) -> Result<(), ExportError> {
    let log = RerunLog::create(&request.out, &session.manifest().name)?;
    let about = TextDocument::new(about).with_media_type("application/json");
    log.file.log_static("about", &about).map_err(|error| log.failed(&error))?;
    let stream = request.stream.as_str();
    for window in windows(chosen.events.as_slice(), chosen.size) {
        let picture = Image::from_l8(window.picture, resolution(chosen.size));
        log.put(&format!("events/{stream}"), window.end_us, &picture)?;
        for (side, hz) in ["on", "off"].into_iter().zip(window.rates_hz) {
            log.put(&format!("rate/{stream}/{side}"), window.end_us, &Scalars::single(hz))?;
        }
    }
    if request.cut == EventSelection::Whole {
        for images in images {
            frames(&log, session, images)?;
        }
    }
    log.finish()
}

/// The file under construction.
struct RerunLog {
    path: PathBuf,
    file: RecordingStream,
}

impl RerunLog {
    fn create(path: &Path, name: &str) -> Result<Self, ExportError> {
        // The crate opens its file on a thread of its own and tells of a failure by a line of its own.
        std::fs::File::create(path)
            .map_err(|source| ExportError::Io { path: path.to_owned(), source })?;
        let file = RecordingStreamBuilder::new("evrig").recording_name(name).save(path);
        let path = path.to_owned();
        match file {
            Ok(file) => Ok(Self { path, file }),
            Err(error) => Err(ExportError::Rerun { path, what: error.to_string() }),
        }
    }

    fn put(&self, entity: &str, t_us: i64, what: &dyn AsComponents) -> Result<(), ExportError> {
        self.file.set_timestamp_nanos_since_epoch("events", t_us.saturating_mul(1_000));
        self.file.log(entity, what).map_err(|error| self.failed(&error))
    }

    fn failed(&self, error: &dyn std::error::Error) -> ExportError {
        ExportError::Rerun { path: self.path.clone(), what: error.to_string() }
    }

    fn finish(self) -> Result<(), ExportError> {
        self.file.flush_blocking().map_err(|error| self.failed(&error))
    }
}

fn frames(log: &RerunLog, session: &Session, images: &Images) -> Result<(), ExportError> {
    let (stream, times) = (images.stream.as_str(), images.times_us());
    let entity = format!("frames/{stream}");
    if !session.is_from_pi(stream)? {
        for (picture, t_us) in session.davis_frames(stream)?.zip(times) {
            let frame = picture?.frame;
            let size = resolution(frame.size);
            let image = match (frame.samples, frame.channels) {
                (Samples::U8(data), Channels::Gray) => Image::from_l8(data, size),
                (Samples::U8(data), Channels::Bgr) => colour(data, size, ColorModel::BGR),
                (Samples::U8(data), Channels::Bgra) => colour(data, size, ColorModel::BGRA),
                (Samples::U16(data), Channels::Gray) => {
                    let bytes: Vec<u8> = data.iter().flat_map(|v| v.to_le_bytes()).collect();
                    let (model, kind) = (ColorModel::L, ChannelDatatype::U16);
                    Image::from_color_model_and_bytes(bytes, size, model, kind)
                }
                // Sixteen bits of colour are no frames of an event camera.
                _ => continue,
            };
            log.put(&entity, *t_us, &image)?;
        }
    }
    let Some(track) = &images.track else { return Ok(()) };
    let entity = format!("{entity}/picture");
    for (corners, t_us) in track.picture_px.iter().zip(times) {
        if corners.iter().all(|v| v.is_finite()) {
            let corner = |i: usize| [corners[2 * i] as f32, corners[2 * i + 1] as f32];
            let outline = LineStrips2D::new([[0, 1, 2, 3, 0].map(corner)])
                .with_colors([0xff99_00ff_u32])
                .with_radii([0.75]);
            log.put(&entity, *t_us, &outline)?;
        }
    }
    Ok(())
}

fn colour(data: Vec<u8>, size: [u32; 2], model: ColorModel) -> Image {
    Image::from_color_model_and_bytes(data, size, model, ChannelDatatype::U8)
}

fn resolution(size: Size) -> [u32; 2] {
    [u32::from(size.width), u32::from(size.height)]
}
