//! The diagnosis section of the page: verdict, effects, strata with misfit.

mod free_run;
mod heat;

use super::answer::DiagnosisResults;
use super::figure::{Figure, FileLink, LegendEntry, LegendMark, Panel};
use super::number::significant;
use super::page::{Fact, Section, SectionBlock};
use super::plot::Ink;
use super::plot::chart::{Chart, ChartAxis, Layer};
use super::table::{ReportTable, TableCell, TableColumn};
use super::verdict::{basis, headline, removed};
use super::words::{estimate_words, parameter_words, quantity_words, readable_times};
use evrig_analysis::diagnose::{
    Diagnosis, DiagnosisVerdict, FittedEffect, MisfitStratum, ProposedTerm, RejectedEffect,
    UntestableEffect,
};

/// The section of a diagnosis, with forward simulation and heat maps where available.
#[must_use]
pub fn section(results: &DiagnosisResults) -> Section {
    let DiagnosisResults { diagnosis, run, maps } = results;
    let link = || FileLink::beside("derived/diagnose/diagnosis.json");
    let is_corrected = !diagnosis.effects.is_empty();
    let mut blocks = vec![SectionBlock::Facts(facts(diagnosis))];
    if is_corrected {
        blocks.push(SectionBlock::ReportTable(effects(&diagnosis.effects)));
        blocks.extend(diagnosis.effects.iter().map(|effect| {
            let equation = if effect.equation.is_empty() { "" } else { " Equation: " };
            SectionBlock::Text(format!(
                "{}: {}.{equation}{}",
                effect.name,
                readable_times(&effect.description),
                effect.equation
            ))
        }));
    }
    if !diagnosis.rejected_effects.is_empty() {
        blocks.push(SectionBlock::ReportTable(suspects(&diagnosis.rejected_effects)));
    }
    blocks.extend(run.iter().flat_map(|run| free_run::blocks(run, is_corrected)));
    let title = match diagnosis.verdict {
        DiagnosisVerdict::NoMismatch => {
            "Groups of events with the largest misfit (too small to report)"
        }
        _ => "Misfit without the named effects",
    };
    let mut places = vec![(title, &diagnosis.mismatch.strata)];
    if is_corrected {
        places.push(("Misfit with the named effects", &diagnosis.residual_mismatch.strata));
    }
    for (title, places) in places.into_iter().filter(|(_, places)| !places.is_empty()) {
        blocks.push(SectionBlock::ReportTable(wheres(title, places)));
    }
    blocks.extend(heat::blocks(maps, is_corrected));
    if let Some(term) = &diagnosis.proposed_term {
        blocks.push(SectionBlock::Figure(proposed(term).with_data(link())));
    }
    if let Some(next) = &diagnosis.next_recording {
        blocks
            .push(SectionBlock::Text(format!("To distinguish equivalent effects, record {next}.")));
    }
    blocks.push(SectionBlock::ReportTable(nuisances(diagnosis)));
    blocks.extend(diagnosis.coarse_stamps().map(SectionBlock::Text));
    if !diagnosis.cannot_judge.is_empty() {
        blocks.push(SectionBlock::Text(format!(
            "This session cannot judge {}.",
            not_judged(diagnosis)
        )));
    }
    let lead = format!("{} {} {}", headline(diagnosis), removed(diagnosis), basis(diagnosis));
    Section { title: "How the answer was found".into(), lead, blocks }
}

/// Effects that the session cannot judge, grouped by reason.
fn not_judged(diagnosis: &Diagnosis) -> String {
    let mut by_reason: Vec<(&str, Vec<&str>)> = Vec::new();
    for UntestableEffect { id, because } in &diagnosis.cannot_judge {
        match by_reason.iter_mut().find(|(reason, _)| reason == because) {
            Some((_, ids)) => ids.push(id.name()),
            None => by_reason.push((because, vec![id.name()])),
        }
    }
    let words = by_reason
        .iter()
        .map(|(reason, ids)| format!("{} ({reason})", ids.join(", ").to_lowercase()));
    words.collect::<Vec<String>>().join("; ")
}

fn facts(diagnosis: &Diagnosis) -> Vec<Fact> {
    let scores = &diagnosis.fit.heldout_nats_per_event;
    let mut facts = vec![
        Fact::new(
            "log-likelihood of events kept out of the fit, without the named effects",
            nats(scores.baseline, 4),
        ),
        Fact::new("with them", nats(scores.r#final, 4)),
        Fact::new("upper bound", nats(scores.upper_bound, 4)),
    ];
    if let Some(share) = diagnosis.share_removed() {
        let value = format!("{} %", significant(100.0 * share, 3));
        facts.push(Fact::new("share of the mismatch removed", value));
    }
    if let Some(left) = &diagnosis.structure {
        let percent = |share: f64| format!("{} %", significant(100.0 * share, 3));
        let mut words = percent(left.baseline.accuracy);
        if !diagnosis.effects.is_empty() {
            words += &format!(
                " without the named effects, {} with them",
                percent(left.r#final.accuracy)
            );
        }
        facts.push(Fact::new(
            "classifier that tells recorded from generated events: right in (50 %: cannot)",
            words,
        ));
    }
    facts
}

fn effects(effects: &[FittedEffect]) -> ReportTable {
    let row = |effect: &FittedEffect| {
        let rivals: Vec<String> = effect
            .competing_hypotheses
            .iter()
            .take(3)
            .map(|r| format!("{} {}", r.id.name(), significant(r.heldout_gain_nats_per_event, 2)))
            .collect();
        let equivalent: Vec<&str> = effect.indistinguishable.iter().map(|id| id.name()).collect();
        let (gain, error) = if effect.is_beside_the_score() {
            (TableCell::text("not scored"), String::new())
        } else {
            let error = significant(effect.heldout_gain_error, 2);
            (TableCell::number(effect.heldout_gain_nats_per_event), error)
        };
        vec![
            TableCell::text(&effect.name),
            TableCell::text(&parameter_words(effect)),
            gain,
            TableCell::text(&error),
            TableCell::text(&rivals.join(", ")),
            TableCell::text(&equivalent.join(", ")),
        ]
    };
    ReportTable {
        title: "Effects".into(),
        caption: "Each gain is on top of the effects above it. Parameters with 90 % intervals \
            from the scatter over parts of the recording. Competing hypotheses: their gain \
            in the same position. Not scored: measured in the frames, hence part of the signal, \
            or over the whole sensor."
            .into(),
        columns: vec![
            TableColumn::text("effect"),
            TableColumn::text("parameters"),
            TableColumn::number("gain", "nats/event"),
            TableColumn::text("standard error"),
            TableColumn::text("competing hypotheses"),
            TableColumn::text("indistinguishable"),
        ],
        rows: effects.iter().map(row).collect(),
    }
}

fn suspects(suspects: &[RejectedEffect]) -> ReportTable {
    let row = |suspect: &RejectedEffect| {
        vec![
            TableCell::text(suspect.id.name()),
            TableCell::number(suspect.heldout_gain_nats_per_event),
            TableCell::text(&suspect.because),
        ]
    };
    ReportTable {
        title: "Rejected effects".into(),
        caption: "The nearest effects of the library, and the criterion each fails: a significant \
            gain, constant strength, and no residual difference between simulated and recorded \
            events."
            .into(),
        columns: vec![
            TableColumn::text("effect"),
            TableColumn::number("gain", "nats/event"),
            TableColumn::text("rejected because"),
        ],
        rows: suspects.iter().map(row).collect(),
    }
}

fn wheres(title: &str, places: &[MisfitStratum]) -> ReportTable {
    let row = |place: &MisfitStratum| {
        vec![
            TableCell::text(&readable_times(&place.description)),
            TableCell::number(place.excess_nats_per_event),
            place.innovation_thresholds.map_or_else(|| TableCell::text(""), TableCell::number),
            TableCell::count(place.n_events),
        ]
    };
    ReportTable {
        title: title.into(),
        caption:
            "Misfit: log-likelihood lost within the group, over all events. Late: mean change \
            of the signal beyond the threshold at the events, in thresholds."
                .into(),
        columns: vec![
            TableColumn::text("group of events"),
            TableColumn::number("misfit", "nats/event"),
            TableColumn::number("late", "thresholds"),
            TableColumn::number("events", ""),
        ],
        rows: places.iter().map(row).collect(),
    }
}

fn nuisances(diagnosis: &Diagnosis) -> ReportTable {
    let rows = diagnosis.nuisances.iter();
    ReportTable {
        title: "Constants of the camera".into(),
        caption: "Always fitted, and not reported as effects within the range of an ordinary \
            camera, with 90 % intervals. Range: whether the value lies at an end of it."
            .into(),
        columns: vec![
            TableColumn::text("constant"),
            TableColumn::text("value"),
            TableColumn::text("range"),
        ],
        rows: rows
            .map(|(key, value)| {
                let is_end = diagnosis.at_range_end.contains(key);
                vec![
                    TableCell::text(&quantity_words(key).0),
                    TableCell::text(&estimate_words(key, value)),
                    TableCell::text(if is_end { "at its end" } else { "" }),
                ]
            })
            .collect(),
    }
}

fn proposed(term: &ProposedTerm) -> Figure {
    let (x, unit) = quantity_words(&term.depends_on);
    let points = || term.curve.iter();
    let layers = vec![
        Layer::Band {
            ink: Ink::Simulated,
            points: points().map(|&[x, _, low, high]| [x, low, high]).collect(),
        },
        Layer::Errors { ink: Ink::Real, points: term.curve.clone() },
    ];
    let note = format!(
        "held-out gain {} nats per event",
        significant(term.heldout_gain_nats_per_event, 2)
    );
    Figure {
        title: "Proposed term".into(),
        caption: format!(
            "No effect of the library explains the residual. It depends on {x} and enters the {}: \
             mean change of the signal beyond the threshold, with its 90 % band.",
            term.enters.replace('_', " ")
        ),
        legend: vec![LegendEntry::new(Ink::Real, LegendMark::Dot, "mean innovation")],
        panels: vec![Panel {
            title: "Residual against its covariate".into(),
            note,
            alt: format!("Mean innovation in thresholds against {x}."),
            drawing: Chart {
                x: ChartAxis::linear(&if unit.is_empty() { x } else { format!("{x} ({unit})") }),
                y: ChartAxis::linear("innovation (thresholds)"),
                layers,
            }
            .draw_wide(),
        }],
        data: None,
    }
}

fn nats(value: f64, digits: usize) -> String {
    format!("{} nats per event", significant(value, digits))
}
