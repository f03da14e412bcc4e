//! `<file>.json`: metadata of an exported stream.
//!
//! `images` holds a table for each image stream, column by column: `t_us` (middle of the exposure on
//! the events' clock), `first_event` (index of the first event not before it, so that
//! `events[first_event[i]:first_event[i + 1]]` lie between images i and i + 1), `number`, `stamp_ns`
//! (the camera's own stamp, with the name of its clock), exposure where the camera states it, and
//! where the tag was tracked `ideal_px_from_target_mm` (3 x 3, row by row: millimetres on the target to
//! pixels of a lens without distortion), `picture_px` (corners: bottom left, bottom right, top right,
//! top left) and their standard errors, and `corner_residual_px`, the distance of the tag's corners in this
//! image from the fitted path. `clocks` is the map from the Pi's clock with its errors.

use super::images::Images;
use super::{Chosen, ExportError, ExportRequest};
use crate::pipeline;
use evrig_core::time::{Clock, Davis};
use evrig_format::hdf5::SideColumn;
use evrig_format::npy::Column;
use evrig_session::{Session, StreamName, read_stage};
use serde_json::{Map, Value, json};
use std::path::{Path, PathBuf};

pub(super) struct Sidecar {
    heading: Value,
    images: Value,
    pub(super) left_out: Vec<String>,
}

impl Sidecar {
    pub(super) fn new(
        session: &Session,
        request: &ExportRequest,
        chosen: &Chosen,
        images: &[Images],
        left_out: Vec<String>,
    ) -> Result<Self, ExportError> {
        let name = StreamName::new(&request.stream)?;
        let times = chosen.events.as_slice().t;
        let stage = |stage: &str| read_stage(&session.layout().derived(stage, Some(&name)));
        let made_by = stage("generate").map(|record| {
            json!({ "stage": "generate", "parameters": record.parameters, "inputs": record.inputs })
        });
        let filtered =
            (request.cut != super::EventSelection::Whole).then(|| stage("filter")).flatten();
        let clocks = pipeline::read_clocks(session)?.map(|clocks| {
            json!({ "davis_from_sensor": clocks.davis_from_sensor,
                    "unix_from_davis": clocks.events.unix_from_davis,
                    "unix_from_davis_because": clocks.events.reason })
        });
        let heading = json!({
            "schema": "evrig.export/1",
            "evrig_version": env!("CARGO_PKG_VERSION"),
            "session": session.manifest().name,
            "session_files": session.manifest().files.iter()
                .map(|(file, entry)| (file.clone(), json!(entry.sha256))).collect::<Map<_, _>>(),
            "status": session.manifest().status,
            "stream": request.stream,
            "format": request.format,
            "cut": request.cut,
            "width": chosen.size.width,
            "height": chosen.size.height,
            "clock": Davis::NAME,
            "unit": "us",
            "polarity": "1 On, 0 Off",
            "n_events": times.len(),
            "first_us": times.first(),
            "last_us": times.last(),
            "made_by": made_by,
            "filtered": filtered.map(|record| json!({ "parameters": record.parameters, "tally": record.tally })),
            "clocks": clocks,
            "losses": session.manifest().losses,
            "left_out": left_out,
        });
        Ok(Self { heading, images: images.iter().map(table).collect(), left_out })
    }

    /// What the stream is about without the tables, for formats that keep those in their own way.
    pub(super) fn heading(&self) -> String {
        self.heading.to_string()
    }

    /// Writes all of it beside the file.
    pub(super) fn write(&self, out: &Path) -> Result<PathBuf, ExportError> {
        let mut name = out.as_os_str().to_owned();
        name.push(".json");
        let path = PathBuf::from(name);
        let mut value = self.heading.clone();
        value["images"] = self.images.clone();
        std::fs::write(&path, format!("{value:#}\n"))
            .map_err(|source| ExportError::Io { path: path.clone(), source })?;
        Ok(path)
    }
}

fn table(images: &Images) -> Value {
    let columns: Map<String, Value> =
        images.columns().iter().map(|column| (column.name.to_owned(), values(column))).collect();
    json!({
        "stream": images.stream,
        "stamp_clock": images.clock,
        "tag": images.track.as_ref().map(|track| &track.tag),
        "corner_rms_px": images.track.as_ref().map(|track| track.corner_rms_px),
        "columns": columns,
    })
}

fn values(column: &SideColumn) -> Value {
    match &column.values {
        Column::Short(values) => json!(values),
        Column::Int(values) => json!(values),
        Column::Float(values) if column.width == 1 => json!(values),
        Column::Float(values) => values.chunks(column.width).map(|row| json!(row)).collect(),
    }
}
