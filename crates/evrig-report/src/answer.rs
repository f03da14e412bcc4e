//! The top of a session's page: the answer in a sentence and three pictures.

use super::figure::{Figure, FileLink, Panel};
use super::measure::{MeasureRow, headline as measures_headline};
use super::number::significant;
use super::page::ReportSummary;
use super::plot::bars::{LabelledBar, draw};
use super::plot::heat::counts_panels;
use super::plot::{Ink, strip};
use super::verdict::{basis, headline, removed};
use super::words::readable_times;
use evrig_analysis::diagnose::{
    Diagnosis, DiagnosisVerdict, FittedEffect, ForwardSimulation, HeatMap, MisfitStratum,
};
use evrig_core::geometry::Size;

/// A diagnosis with its forward simulation and heat maps.
#[derive(Debug, Clone)]
pub struct DiagnosisResults {
    /// The diagnosis.
    pub diagnosis: Diagnosis,
    /// Generated events without and with the named effects; `None` where the generator was not run.
    pub run: Option<ForwardSimulation>,
    /// Maps of the misfit.
    pub maps: Vec<HeatMap>,
}

/// Strata and effects in a picture, at most.
const MAX_BARS: usize = 4;

/// The summary of a session: of its diagnosis, else of the first compared stream.
#[must_use]
pub fn summary(
    diagnosed: Option<&DiagnosisResults>,
    compared: &[(String, Vec<MeasureRow>)],
) -> ReportSummary {
    let measured = |(stream, measures): &(String, Vec<MeasureRow>)| {
        format!(
            "Generated stream “{stream}” against the recorded events: {}",
            measures_headline(measures)
        )
    };
    let mut remarks: Vec<String> = compared.iter().map(measured).collect();
    let Some(results) = diagnosed else {
        if remarks.is_empty() {
            return ReportSummary {
                headline: "The session has no generated events to compare.".into(),
                remarks: vec!["Run `evrig process` on a session with frames and events.".into()],
                ..ReportSummary::default()
            };
        }
        let first = |(_, measures): &(String, Vec<MeasureRow>)| strip::departures_figure(measures);
        let headline = remarks.remove(0);
        let figures = compared.first().map(first).into_iter().collect();
        return ReportSummary { headline, remarks, figures, ..ReportSummary::default() };
    };
    // Measures of generated streams open their own sections: they are of other camera models.
    let diagnosis = &results.diagnosis;
    let removed = removed(diagnosis);
    ReportSummary {
        headline: headline(diagnosis),
        remarks: vec![format!("{removed} {}", basis(diagnosis)).trim().to_owned()],
        figures: pictures(results),
        ..ReportSummary::default()
    }
}

/// Where, what, and before and after.
fn pictures(results: &DiagnosisResults) -> Vec<Figure> {
    let DiagnosisResults { diagnosis, run, .. } = results;
    let run = run.as_ref().and_then(|run| generated(run, !diagnosis.effects.is_empty()));
    place(diagnosis).into_iter().chain(cause(diagnosis)).chain(run).collect()
}

fn numbers() -> FileLink {
    FileLink::beside("derived/diagnose/diagnosis.json")
}

/// Where the model without effects is worst.
fn place(diagnosis: &Diagnosis) -> Option<Figure> {
    if diagnosis.verdict == DiagnosisVerdict::NoMismatch {
        return None;
    }
    let bar = |stratum: &MisfitStratum| LabelledBar {
        label: readable_times(&stratum.description),
        value: stratum.excess_nats_per_event,
        ink: Ink::Simulated,
    };
    let bars: Vec<LabelledBar> = diagnosis.mismatch.strata.iter().take(MAX_BARS).map(bar).collect();
    (!bars.is_empty()).then(|| {
        let caption = "Groups of events that the model without the named effects predicts worst. \
            Length: log-likelihood lost there, in nats per event.";
        figure("Where the model departs", caption, &bars)
    })
}

/// Which effect explains it best, and the others that were tried in its place.
fn cause(diagnosis: &Diagnosis) -> Option<Figure> {
    let effect = diagnosis.effects.iter().find(|effect| !effect.is_beside_the_score())?;
    let named = LabelledBar {
        label: format!("{} (named)", effect.name),
        value: effect.heldout_gain_nats_per_event,
        ink: Ink::Corrected,
    };
    let others = effect.competing_hypotheses.iter().filter(|other| other.id != effect.id);
    let others = others.take(MAX_BARS - 1).map(|other| LabelledBar {
        label: other.id.name().to_owned(),
        value: other.heldout_gain_nats_per_event,
        ink: Ink::Guide,
    });
    let bars: Vec<LabelledBar> = std::iter::once(named).chain(others).collect();
    let caption = format!(
        "How much better events kept out of the fit are predicted with each effect in the first \
         place, in nats per event.{}",
        same_law(effect)
    );
    Some(figure("What explains it", &caption, &bars))
}

fn same_law(effect: &FittedEffect) -> String {
    let names: Vec<&str> = effect.indistinguishable.iter().map(|id| id.name()).collect();
    if names.is_empty() {
        return String::new();
    }
    format!(" This session cannot distinguish it from: {}.", names.join(", ").to_lowercase())
}

fn figure(title: &str, caption: &str, bars: &[LabelledBar]) -> Figure {
    let words: Vec<String> =
        bars.iter().map(|bar| format!("{}: {}", bar.label, significant(bar.value, 2))).collect();
    Figure {
        title: title.to_owned(),
        caption: caption.to_owned(),
        legend: Vec::new(),
        panels: vec![Panel {
            title: String::new(),
            note: String::new(),
            alt: format!("{title}. {}.", words.join("; ")),
            drawing: draw(bars),
        }],
        data: Some(numbers()),
    }
}

/// Events per pixel: recorded, generated without and with the named effects.
fn generated(run: &ForwardSimulation, is_named: bool) -> Option<Figure> {
    // What the generator cannot represent is no picture of the named effects.
    let is_corrected = is_named && run.left_out.is_empty();
    let titles = ["Recorded", "Generated without it", "Generated with it"];
    let titles = if is_corrected { &titles[..] } else { &["Recorded", "Generated"] };
    let maps: Vec<(String, &[u32])> = titles
        .iter()
        .zip(&run.counts)
        .map(|(title, counts)| ((*title).to_owned(), counts.as_slice()))
        .collect();
    let [x, y, w, h] = run.patch_px;
    Some(Figure {
        title: if is_corrected { "Before and after" } else { "Recorded and generated" }.into(),
        caption: format!(
            "Events per pixel on {w} by {h} pixels from column {x} and row {y}, generated from \
             the reconstructed brightness alone. Equal colours are equal counts."
        ),
        legend: Vec::new(),
        panels: counts_panels(Size::new(w, h), &maps).ok()?,
        data: Some(FileLink::beside("derived/diagnose/forward_simulation.json")),
    })
}
