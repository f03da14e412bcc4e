//! Findings of the check before a recording, and the samples of each device.

use crate::pipeline::PipelineError;
use evrig_report::page::{Block, Section};
use evrig_report::table::{Cell, Column, Table};
use evrig_session::{Recording, Session};
use serde_json::Value;

/// The section of a session that evrig recorded; none of one that was imported.
///
/// # Errors
/// When the journal is there and cannot be read.
pub(super) fn section(session: &Session) -> Result<Option<Section>, PipelineError> {
    let Some(recording) = &session.manifest().recording else { return Ok(None) };
    let path = session.layout().journal();
    let journal = match std::fs::read_to_string(&path) {
        Ok(text) => text,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => String::new(),
        Err(source) => return Err(PipelineError::Io { path, source }),
    };
    let findings = findings(&journal);
    let mut blocks = Vec::new();
    if !findings.is_empty() {
        blocks.push(Block::Table(Table {
            title: "Preflight".into(),
            caption: "As written to journal.jsonl before the arm moved.".into(),
            columns: vec![Column::text("what"), Column::text("verdict"), Column::text("found")],
            rows: findings
                .iter()
                .map(|row| row.each_ref().map(|text| Cell::text(text)).into())
                .collect(),
        }));
    }
    blocks.push(Block::Table(devices(recording)));
    Ok(Some(Section {
        title: "Preflight and devices".into(),
        lead: format!(
            "What was looked at before anything moved, and what each device gave. It ended: {}.",
            recording.ended
        ),
        blocks,
    }))
}

/// What was looked at, the verdict, and what was found, of the last preflight.
fn findings(journal: &str) -> Vec<[String; 3]> {
    let mut notes = journal.lines().filter_map(|line| serde_json::from_str::<Value>(line).ok());
    let last = notes.rfind(|note| note["what"] == "preflight");
    let findings = last.as_ref().and_then(|note| note["findings"].as_array());
    let text = |value: &Value| value.as_str().unwrap_or_default().to_owned();
    let row = |f: &Value| [text(&f["what"]), text(&f["verdict"]), text(&f["says"])];
    findings.map_or_else(Vec::new, |findings| findings.iter().map(row).collect())
}

fn devices(recording: &Recording) -> Table {
    let row = |device: &evrig_session::DeviceEntry| {
        let lost = device.lost.clone().unwrap_or_else(|| "nothing".into());
        vec![
            Cell::text(&device.name),
            Cell::count(device.n_samples),
            Cell::count(device.n_dropped),
            Cell::text(&lost),
        ]
    };
    Table {
        title: "Devices".into(),
        caption: "Samples that reached the files, and those that found no room on the way.".into(),
        columns: vec![
            Column::text("device"),
            Column::number("samples", ""),
            Column::number("dropped", ""),
            Column::text("lost"),
        ],
        rows: recording.devices.iter().map(row).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_preflight_of_a_journal_is_shown_and_a_torn_line_is_passed_over() {
        let journal = concat!(
            r#"{"what":"preflight","findings":[{"what":"arm","verdict":"bad","says":"alarm"}]}"#,
            "\n",
            r#"{"what":"preflight","findings":[{"what":"arm","verdict":"good","says":"none"}]}"#,
            "\n",
            r#"{"what":"recording"}"#,
            "\n{\"what\":\"prefl",
        );
        assert_eq!(findings(journal), [["arm", "good", "none"].map(str::to_owned)]);
        assert!(findings("").is_empty());
    }
}
