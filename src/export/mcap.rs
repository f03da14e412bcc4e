//! A stream for viewers: event images, frames, the outline of the target, and rates.
//!
//! | topic | schema | what |
//! | --- | --- | --- |
//! | `/events/<stream>` | foxglove.RawImage | 20 ms of events: white for a last event ON, black for OFF |
//! | `/rate/<stream>` | evrig.Rate | events per second by polarity, over the same 20 ms |
//! | `/frames/<stream>` | foxglove.RawImage | frames on the events' pixel grid |
//! | `/picture/<stream>` | foxglove.ImageAnnotations | outline of the target in the frame |
//!
//! Log time is the events' clock; an event image carries the time at which its 20 ms end.

use super::images::Images;
use super::window::{ExportWindow, windows};
use super::{Chosen, EventSelection, ExportError, ExportRequest, unfit};
use evrig_core::event::EventSlice;
use evrig_core::frame::{Channels, Samples};
use evrig_core::geometry::Size;
use evrig_core::time::{Stamp, Unix};
use evrig_session::{Session, image_message, image_schema};
use mcap::records::MessageHeader;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;
use std::path::Path;

const RATE: &str = r#"{"title":"evrig.Rate","type":"object","properties":{"on_hz":{"type":"number"},"off_hz":{"type":"number"}}}"#;

const ANNOTATIONS: &str = r#"{"title":"foxglove.ImageAnnotations","type":"object","properties":{"circles":{"type":"array","items":{"type":"object"}},"points":{"type":"array","items":{"type":"object","properties":{"timestamp":{"type":"object","properties":{"sec":{"type":"integer"},"nsec":{"type":"integer"}}},"type":{"type":"integer"},"points":{"type":"array","items":{"type":"object","properties":{"x":{"type":"number"},"y":{"type":"number"}}}},"outline_color":{"type":"object","properties":{"r":{"type":"number"},"g":{"type":"number"},"b":{"type":"number"},"a":{"type":"number"}}},"outline_colors":{"type":"array","items":{"type":"object"}},"fill_color":{"type":"object","properties":{"r":{"type":"number"},"g":{"type":"number"},"b":{"type":"number"},"a":{"type":"number"}}},"thickness":{"type":"number"}}}},"texts":{"type":"array","items":{"type":"object"}}}}"#;

pub(super) fn write(
    session: &Session,
    request: &ExportRequest,
    chosen: &Chosen,
    images: &[Images],
) -> Result<(), ExportError> {
    let events = chosen.events.as_slice();
    let first_image = images.iter().filter_map(|images| images.times_us().first()).min();
    if let Some(first) = events.t.first().into_iter().chain(first_image).find(|t| **t < 0) {
        let what = format!("it begins at {first} us; an MCAP file holds no time before 0");
        return Err(unfit(session, request, what));
    }
    let mut log = McapLog::create(&request.out)?;
    event_pictures(&mut log, &request.stream, events, chosen.size)?;
    if request.cut == EventSelection::Whole {
        for images in images {
            frames(&mut log, session, images)?;
        }
    }
    log.finish()
}

/// The file under construction.
struct McapLog<'a> {
    path: &'a Path,
    file: mcap::Writer<BufWriter<File>>,
    sequences: BTreeMap<u16, u32>,
}

impl<'a> McapLog<'a> {
    fn create(path: &'a Path) -> Result<Self, ExportError> {
        let io = |source| ExportError::Io { path: path.to_owned(), source };
        let file = BufWriter::with_capacity(1 << 20, File::create(path).map_err(io)?);
        let options = mcap::WriteOptions::new()
            .compression(None)
            .profile("")
            .library(concat!("evrig ", env!("CARGO_PKG_VERSION")));
        let file = options.create(file).map_err(|source| failed(path, source))?;
        Ok(Self { path, file, sequences: BTreeMap::new() })
    }

    fn channel(&mut self, topic: &str, schema: &str, text: &str) -> Result<u16, ExportError> {
        let (kind, encoding, data) = match text {
            "" => ("protobuf", "protobuf", image_schema()),
            text => ("jsonschema", "json", text.as_bytes().to_vec()),
        };
        let schema = self.file.add_schema(schema, kind, &data);
        let schema = schema.map_err(|source| failed(self.path, source))?;
        let channel = self.file.add_channel(schema, topic, encoding, &BTreeMap::new());
        channel.map_err(|source| failed(self.path, source))
    }

    fn put(&mut self, channel_id: u16, t_us: i64, message: &[u8]) -> Result<(), ExportError> {
        let time = u64::try_from(t_us).unwrap_or(0).saturating_mul(1000);
        let sequence = self.sequences.entry(channel_id).or_insert(0);
        let header =
            MessageHeader { channel_id, sequence: *sequence, log_time: time, publish_time: time };
        *sequence = sequence.wrapping_add(1);
        let written = self.file.write_to_known_channel(&header, message);
        written.map_err(|source| failed(self.path, source))
    }

    fn finish(mut self) -> Result<(), ExportError> {
        self.file.finish().map_err(|source| failed(self.path, source))?;
        Ok(())
    }
}

fn failed(path: &Path, source: mcap::McapError) -> ExportError {
    ExportError::Mcap { path: path.to_owned(), source: Box::new(source) }
}

fn event_pictures(
    log: &mut McapLog<'_>,
    stream: &str,
    events: EventSlice<'_>,
    size: Size,
) -> Result<(), ExportError> {
    let pictures = log.channel(&format!("/events/{stream}"), "foxglove.RawImage", "")?;
    let rates = log.channel(&format!("/rate/{stream}"), "evrig.Rate", RATE)?;
    for ExportWindow { end_us, picture, rates_hz: [on_hz, off_hz] } in windows(events, size) {
        let at = Stamp::<Unix>::from_micros(end_us);
        log.put(pictures, end_us, &image_message(stream, at, size, "mono8", picture))?;
        let rate = json!({ "on_hz": on_hz, "off_hz": off_hz });
        log.put(rates, end_us, rate.to_string().as_bytes())?;
    }
    Ok(())
}

/// Frames on the events' clock as they were taken; of the Pi's only the outline, since `rig.mcap`
/// holds its frames in these very schemas.
fn frames(log: &mut McapLog<'_>, session: &Session, images: &Images) -> Result<(), ExportError> {
    let stream = images.stream.as_str();
    let times = images.times_us();
    if !session.is_from_pi(stream)? {
        let channel = log.channel(&format!("/frames/{stream}"), "foxglove.RawImage", "")?;
        for (picture, t_us) in session.davis_frames(stream)?.zip(times) {
            let frame = picture?.frame;
            let at = Stamp::<Unix>::from_micros(*t_us);
            let (encoding, data) = match (frame.samples, frame.channels) {
                (Samples::U8(data), Channels::Gray) => ("mono8", data),
                (Samples::U8(data), Channels::Bgr) => ("bgr8", data),
                (Samples::U8(data), Channels::Bgra) => ("bgra8", data),
                (Samples::U16(data), Channels::Gray) => {
                    ("mono16", data.iter().flat_map(|v| v.to_le_bytes()).collect())
                }
                // Sixteen bits of colour have no encoding of their own in the schema.
                _ => continue,
            };
            log.put(channel, *t_us, &image_message(stream, at, frame.size, encoding, data))?;
        }
    }
    let Some(track) = &images.track else { return Ok(()) };
    let channel =
        log.channel(&format!("/picture/{stream}"), "foxglove.ImageAnnotations", ANNOTATIONS)?;
    for (corners, t_us) in track.picture_px.iter().zip(times) {
        if corners.iter().all(|v| v.is_finite()) {
            log.put(channel, *t_us, outline(corners, *t_us).to_string().as_bytes())?;
        }
    }
    Ok(())
}

fn outline(corners: &[f64; 8], t_us: i64) -> Value {
    const LINE_LOOP: u8 = 2;
    let points: Vec<Value> =
        corners.chunks(2).map(|corner| json!({ "x": corner[0], "y": corner[1] })).collect();
    let timestamp =
        json!({ "sec": t_us.div_euclid(1_000_000), "nsec": t_us.rem_euclid(1_000_000) * 1000 });
    json!({
        "circles": [], "texts": [],
        "points": [{
            "timestamp": timestamp, "type": LINE_LOOP, "points": points, "thickness": 1.5,
            "outline_color": { "r": 1.0, "g": 0.6, "b": 0.0, "a": 1.0 },
            "outline_colors": [], "fill_color": { "r": 0.0, "g": 0.0, "b": 0.0, "a": 0.0 },
        }],
    })
}
