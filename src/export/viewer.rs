//! A layout for Foxglove: events next to frames, rates below.

use super::ExportError;
use super::images::Images;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// Writes `<file>.layout.json`, which Foxglove imports (Layouts, Import from file).
pub(super) fn write(out: &Path, stream: &str, images: &[Images]) -> Result<PathBuf, ExportError> {
    let mut name = out.as_os_str().to_owned();
    name.push(".layout.json");
    let path = PathBuf::from(name);
    let text = format!("{:#}\n", layout(stream, images));
    std::fs::write(&path, text).map_err(|source| ExportError::Io { path: path.clone(), source })?;
    Ok(path)
}

fn layout(stream: &str, images: &[Images]) -> Value {
    let own = images.iter().find(|images| images.clock == "davis");
    let mut panels = json!({
        "Image!events": image(&format!("/events/{stream}"), None),
        "Plot!rate": {
            "title": "events a second",
            "paths": [
                path(&format!("/rate/{stream}.on_hz"), "On"),
                path(&format!("/rate/{stream}.off_hz"), "Off"),
            ],
            "xAxisVal": "timestamp", "showLegend": true, "isSynced": true,
        },
    });
    let mut above = json!("Image!events");
    if let Some(images) = own {
        let outline = images.track.as_ref().map(|_| format!("/picture/{}", images.stream));
        panels["Image!frames"] = image(&format!("/frames/{}", images.stream), outline);
        above = json!({
            "direction": "row", "first": "Image!frames", "second": "Image!events",
            "splitPercentage": 50,
        });
    }
    json!({
        "configById": panels,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": { "speed": 0.2 },
        "layout": {
            "direction": "column", "first": above, "second": "Plot!rate", "splitPercentage": 70,
        },
    })
}

fn image(topic: &str, annotations: Option<String>) -> Value {
    let annotations = annotations.into_iter();
    let visible: serde_json::Map<String, Value> =
        annotations.map(|topic| (topic, json!({ "visible": true }))).collect();
    json!({ "imageMode": { "imageTopic": topic, "annotations": visible } })
}

fn path(value: &str, label: &str) -> Value {
    json!({ "value": value, "label": label, "enabled": true, "timestampMethod": "receiveTime" })
}
