//! The camera report in sentences, as text for a terminal and as a page with plots.

mod plots;
mod sentences;
mod timing_sentences;

use super::number::count;
use super::page::{Fact, Page, ReportSummary, Section, SectionBlock};
use super::plot::pixel_image::PixelImageError;
use evrig_analysis::camera_report::CameraReport;

/// What the sentences of a section are about.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ReportTopic {
    /// Heading.
    pub title: &'static str,
    /// Sentences in order.
    pub sentences: Vec<String>,
}

/// All sections of the report in words.
#[must_use]
pub fn topics(report: &CameraReport) -> Vec<ReportTopic> {
    vec![
        ReportTopic { title: "Events", sentences: sentences::rates(report) },
        ReportTopic { title: "Time stamps", sentences: sentences::stamps(report) },
        ReportTopic { title: "Pixels", sentences: sentences::pixels(report) },
        ReportTopic { title: "Background activity", sentences: sentences::background(report) },
        ReportTopic { title: "Coupling to frames", sentences: timing_sentences::coupling(report) },
        ReportTopic { title: "Refractory period", sentences: timing_sentences::refractory(report) },
        ReportTopic { title: "Flicker", sentences: timing_sentences::flicker(report) },
        ReportTopic { title: "Readout limits", sentences: sentences::readout(report) },
        ReportTopic { title: "ON and OFF", sentences: sentences::balance(report) },
    ]
}

/// The report for a terminal.
#[must_use]
pub fn text(name: &str, report: &CameraReport) -> String {
    let mut lines = vec![format!("Camera report of {name}")];
    for topic in topics(report) {
        lines.push(String::new());
        lines.push(topic.title.to_owned());
        lines.extend(topic.sentences.iter().map(|sentence| format!("  {sentence}")));
    }
    // A file's name may hold characters that move the cursor.
    lines.join("\n").replace(|c: char| c.is_control() && c != '\n', "\u{fffd}")
}

/// The report as a page with plots.
///
/// # Errors
/// When the sensor has no pixels.
pub fn page(name: &str, report: &CameraReport, notes: &[String]) -> Result<Page, PixelImageError> {
    let mut sections = Vec::new();
    for topic in topics(report) {
        let mut blocks: Vec<SectionBlock> =
            topic.sentences.into_iter().map(SectionBlock::Text).collect();
        blocks.extend(plots::of(topic.title, report)?.into_iter().map(SectionBlock::Figure));
        sections.push(Section { title: topic.title.into(), lead: String::new(), blocks });
    }
    let rates = &report.rates;
    let summary = ReportSummary {
        headline: timing_sentences::headline(report),
        remarks: notes.to_vec(),
        facts: vec![
            Fact::new("events", count(report.n_events)),
            Fact::new("duration", format!("{:.3} s", rates.duration_s)),
            Fact::new("sensor", report.size.to_string()),
        ],
        figures: Vec::new(),
    };
    Ok(Page {
        title: name.to_owned(),
        kind: "Camera report".into(),
        summary,
        sections,
        is_folded: false,
        provenance: vec![Fact::new("schema", report.schema)],
    })
}
