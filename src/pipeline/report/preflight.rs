//! Findings of the check before a recording, and the samples of each device.

use crate::pipeline::PipelineError;
use evrig_report::page::{Section, SectionBlock};
use evrig_report::table::{ReportTable, TableCell, TableColumn};
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
        blocks.push(SectionBlock::ReportTable(ReportTable {
            title: "Preflight".into(),
            caption: "As written to journal.jsonl before the arm moved.".into(),
            columns: vec![
                TableColumn::text("what"),
                TableColumn::text("verdict"),
                TableColumn::text("found"),
            ],
            rows: findings
                .iter()
                .map(|row| row.each_ref().map(|text| TableCell::text(text)).into())
                .collect(),
        }));
    }
    blocks.push(SectionBlock::ReportTable(devices(recording)));
    Ok(Some(Section {
        title: "Preflight and devices".into(),
        lead: format!(
            "Checks before the first motion, and the samples of each device. The recording ended: \
             {}.",
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
    // Journals of evrig.session/1 have the keys `what` and `says`.
    let either = |f: &Value, keys: [&str; 2]| keys.iter().find_map(|key| f.get(key)).map(text);
    let row = |f: &Value| {
        [["subject", "what"], ["verdict", "verdict"], ["description", "says"]]
            .map(|keys| either(f, keys).unwrap_or_default())
    };
    findings.map_or_else(Vec::new, |findings| findings.iter().map(row).collect())
}

fn devices(recording: &Recording) -> ReportTable {
    let row = |device: &evrig_session::DeviceEntry| {
        let lost = device.lost.clone().unwrap_or_else(|| "nothing".into());
        vec![
            TableCell::text(&device.name),
            TableCell::count(device.n_samples),
            TableCell::count(device.n_dropped),
            TableCell::text(&lost),
        ]
    };
    ReportTable {
        title: "Devices".into(),
        caption: "Samples in the files, and samples dropped because a queue was full.".into(),
        columns: vec![
            TableColumn::text("device"),
            TableColumn::number("samples", ""),
            TableColumn::number("dropped", ""),
            TableColumn::text("lost"),
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
            r#"{"what":"preflight","findings":[{"subject":"arm","verdict":"good","description":"none"}]}"#,
            "\n",
            r#"{"what":"recording"}"#,
            "\n{\"what\":\"prefl",
        );
        assert_eq!(findings(journal), [["arm", "good", "none"].map(str::to_owned)]);
        let former =
            r#"{"what":"preflight","findings":[{"what":"arm","verdict":"bad","says":"x"}]}"#;
        assert_eq!(findings(former), [["arm", "bad", "x"].map(str::to_owned)]);
        assert!(findings("").is_empty());
    }
}
