//! The diagnosis section of the page: verdict, effects, strata with misfit.

mod free_run;
mod heat;

use super::figure::{Figure, FileLink, LegendEntry, LegendMark, Panel};
use super::number::{count, significant};
use super::page::{Fact, Section, SectionBlock};
use super::plot::Ink;
use super::plot::chart::{Chart, ChartAxis, Layer};
use super::table::{ReportTable, TableCell, TableColumn};
use evrig_analysis::diagnose::{
    ConfidenceInterval, Diagnosis, DiagnosisVerdict, FittedEffect, ForwardSimulation, HeatMap,
    MisfitStratum, ProposedTerm, RejectedEffect, SplitHalfFit, UntestableEffect,
};

/// The section of a diagnosis, with forward simulation and heat maps where available.
#[must_use]
pub fn section(
    diagnosis: &Diagnosis,
    run: Option<&ForwardSimulation>,
    maps: &[HeatMap],
) -> Section {
    let link = || FileLink::beside("derived/diagnose/diagnosis.json");
    let mut blocks = vec![SectionBlock::Facts(facts(diagnosis))];
    if !diagnosis.effects.is_empty() {
        blocks.push(SectionBlock::ReportTable(effects(&diagnosis.effects)));
        blocks.extend(diagnosis.effects.iter().map(|effect| {
            let equation = if effect.equation.is_empty() { "" } else { " Equation: " };
            SectionBlock::Text(format!(
                "{}: {}.{equation}{}",
                effect.name, effect.description, effect.equation
            ))
        }));
    }
    if !diagnosis.rejected_effects.is_empty() {
        blocks.push(SectionBlock::ReportTable(suspects(&diagnosis.rejected_effects)));
    }
    blocks.extend(
        run.into_iter().flat_map(|run| free_run::blocks(run, !diagnosis.effects.is_empty())),
    );
    if !diagnosis.split_half.is_empty() {
        blocks.push(SectionBlock::ReportTable(halves(&diagnosis.split_half, &diagnosis.effects)));
    }
    let title = match diagnosis.verdict {
        DiagnosisVerdict::NoMismatch => {
            "Strata with the largest excess (below the reporting threshold)"
        }
        _ => "Misfit of the baseline by stratum",
    };
    let mut places = vec![(title, &diagnosis.mismatch.strata)];
    if !diagnosis.effects.is_empty() {
        places.push(("Misfit of the final model by stratum", &diagnosis.residual_mismatch.strata));
    }
    for (title, places) in places.into_iter().filter(|(_, places)| !places.is_empty()) {
        blocks.push(SectionBlock::ReportTable(wheres(title, places)));
    }
    blocks.extend(heat::blocks(maps, !diagnosis.effects.is_empty()));
    if let Some(term) = &diagnosis.proposed_term {
        blocks.push(SectionBlock::Figure(proposed(term).with_data(link())));
    }
    if let Some(next) = &diagnosis.next_recording {
        blocks
            .push(SectionBlock::Text(format!("To distinguish equivalent effects, record {next}.")));
    }
    blocks.push(SectionBlock::ReportTable(nuisances(diagnosis)));
    let notes = [diagnosis.range_ends(), diagnosis.coarse_stamps()];
    blocks.extend(notes.into_iter().flatten().map(SectionBlock::Text));
    if !diagnosis.cannot_judge.is_empty() {
        blocks.push(SectionBlock::Text(format!(
            "This session cannot judge {}.",
            not_judged(diagnosis)
        )));
    }
    Section { title: "Diagnosis".into(), lead: lead(diagnosis), blocks }
}

/// Effects that the session cannot judge, grouped by reason.
fn not_judged(diagnosis: &Diagnosis) -> String {
    let mut by_reason: Vec<(&str, Vec<&str>)> = Vec::new();
    for UntestableEffect { id, because } in &diagnosis.cannot_judge {
        match by_reason.iter_mut().find(|(reason, _)| reason == because) {
            Some((_, ids)) => ids.push(id.as_str()),
            None => by_reason.push((because, vec![id.as_str()])),
        }
    }
    let words = by_reason.iter().map(|(reason, ids)| format!("{} ({reason})", ids.join(", ")));
    words.collect::<Vec<String>>().join("; ")
}

/// The verdict in a sentence.
fn lead(diagnosis: &Diagnosis) -> String {
    let names: Vec<&str> = diagnosis.effects.iter().map(|effect| effect.name.as_str()).collect();
    let verdict = match diagnosis.verdict {
        DiagnosisVerdict::NoMismatch => {
            "No mismatch: no effect of the library is significant".to_owned()
        }
        DiagnosisVerdict::MinorMismatch => {
            "There is a significant mismatch that is too small to name an effect".to_owned()
        }
        DiagnosisVerdict::Explained => format!("Explained by {}", names.join(" and ")),
        DiagnosisVerdict::PartlyExplained => {
            format!("Partly explained by {}", names.join(" and "))
        }
        DiagnosisVerdict::Unexplained => {
            "There is a mismatch that no effect of the library explains".to_owned()
        }
    };
    format!(
        "{verdict}. From {} events of {} pixels; scores are held-out log-likelihoods in nats per \
         event, time in seconds.",
        count(diagnosis.n_events as u64),
        count(diagnosis.n_pixels as u64)
    )
}

fn facts(diagnosis: &Diagnosis) -> Vec<Fact> {
    let scores = &diagnosis.fit.heldout_nats_per_event;
    let upper_bound_source = scores.upper_bound_source.replace('_', " ");
    let mut facts = vec![
        Fact::new("held-out log-likelihood, baseline", significant(scores.baseline, 4)),
        Fact::new("held-out log-likelihood, final model", significant(scores.r#final, 4)),
        Fact::new(
            &format!("upper bound ({upper_bound_source})"),
            significant(scores.upper_bound, 4),
        ),
    ];
    if let Some(share) = diagnosis.share_removed() {
        let value = format!("{} %", significant(100.0 * share, 3));
        facts.push(Fact::new("share of the excess removed", value));
    }
    let bar = format!(
        "{} nats per event; simulated recordings of the null model: {}",
        significant(diagnosis.null.threshold_nats_per_event, 2),
        diagnosis.null.n
    );
    facts.push(Fact::new("smallest gain that is reported", bar));
    if let Some(left) = &diagnosis.structure {
        let percent = |share: f64| format!("{} %", significant(100.0 * share, 3));
        let mut words = percent(left.baseline.accuracy);
        if !diagnosis.effects.is_empty() {
            words += &format!(
                " for the baseline, {} for the final model",
                percent(left.r#final.accuracy)
            );
        }
        facts.push(Fact::new("classifier two-sample test, accuracy (50 %: no difference)", words));
    }
    facts
}

/// A value with its 90 % interval, where known.
fn with_interval(interval: &ConfidenceInterval) -> String {
    let value = significant(interval.value, 4);
    match interval.ci90 {
        [Some(low), Some(high)] => {
            format!("{value} ({} to {})", significant(low, 4), significant(high, 4))
        }
        _ => value,
    }
}

fn effects(effects: &[FittedEffect]) -> ReportTable {
    let row = |effect: &FittedEffect| {
        let parameters: Vec<String> = effect
            .parameters
            .iter()
            .map(|(key, value)| format!("{key} = {}", with_interval(value)))
            .collect();
        let rivals: Vec<String> = effect
            .competing_hypotheses
            .iter()
            .take(3)
            .map(|r| format!("{} {}", r.id, significant(r.heldout_gain_nats_per_event, 2)))
            .collect();
        let equivalent: Vec<&str> = effect.indistinguishable.iter().map(|id| id.as_str()).collect();
        let (gain, error) = if effect.is_beside_the_score() {
            (TableCell::text("not scored"), String::new())
        } else {
            let error = significant(effect.heldout_gain_error, 2);
            (TableCell::number(effect.heldout_gain_nats_per_event), error)
        };
        vec![
            TableCell::text(effect.id.as_str()),
            TableCell::text(&parameters.join(", ")),
            gain,
            TableCell::text(&error),
            TableCell::text(&rivals.join(", ")),
            TableCell::text(&equivalent.join(", ")),
        ]
    };
    ReportTable {
        title: "Effects".into(),
        caption: "Each gain is on top of the effects above it. Parameters with 90 % intervals \
            from the scatter over cells, without model misfit. Competing hypotheses: their gain \
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

fn halves(halves: &[SplitHalfFit], effects: &[FittedEffect]) -> ReportTable {
    let keys: Vec<String> = effects
        .iter()
        .flat_map(|e| e.parameters.keys().map(move |key| format!("{}.{key}", e.id)))
        .collect();
    let row = |half: &SplitHalfFit| {
        let mut row = vec![
            TableCell::text(&half.subset),
            TableCell::count(half.n_events as u64),
            TableCell::number(half.heldout_gain_nats_per_event),
        ];
        let value = |key: &String| half.parameters.get(key).copied();
        row.extend(
            keys.iter().map(|k| value(k).map_or_else(|| TableCell::text(""), TableCell::number)),
        );
        row
    };
    let mut columns = vec![
        TableColumn::text("refitted on"),
        TableColumn::number("events", ""),
        TableColumn::number("gain", "nats/event"),
    ];
    columns.extend(keys.iter().map(|key| TableColumn::number(key, "")));
    ReportTable {
        title: "Split-half check".into(),
        caption: "The effects refitted on half of the pixels and on half of the time.".into(),
        columns,
        rows: halves.iter().map(row).collect(),
    }
}

fn wheres(title: &str, places: &[MisfitStratum]) -> ReportTable {
    let row = |place: &MisfitStratum| {
        let [low, high] = place.range.map(|end| significant(end, 3));
        vec![
            TableCell::text(&place.description),
            TableCell::text(&place.covariate),
            TableCell::text(&format!("{low} to {high}")),
            TableCell::number(place.excess_nats_per_event),
            place.innovation_thresholds.map_or_else(|| TableCell::text(""), TableCell::number),
            TableCell::count(place.n_events),
        ]
    };
    ReportTable {
        title: title.into(),
        caption: "Gain of a recalibration of the model within the stratum, over all events; \
            innovation: change of the signal beyond the threshold, in thresholds."
            .into(),
        columns: vec![
            TableColumn::text("description"),
            TableColumn::text("covariate"),
            TableColumn::text("range"),
            TableColumn::number("excess", "nats/event"),
            TableColumn::number("innovation", "thresholds"),
            TableColumn::number("events", ""),
        ],
        rows: places.iter().map(row).collect(),
    }
}

fn nuisances(diagnosis: &Diagnosis) -> ReportTable {
    let rows = diagnosis.nuisances.iter();
    ReportTable {
        title: "Nuisances".into(),
        caption: "Nuisance parameters are always fitted and are not reported within their prior \
            range; 90 % intervals."
            .into(),
        columns: vec![TableColumn::text("nuisance"), TableColumn::text("value")],
        rows: rows
            .map(|(key, value)| vec![TableCell::text(key), TableCell::text(&with_interval(value))])
            .collect(),
    }
}

fn proposed(term: &ProposedTerm) -> Figure {
    let x = term.depends_on.replace('_', " ");
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
                x: ChartAxis::linear(&x),
                y: ChartAxis::linear("innovation (thresholds)"),
                layers,
            }
            .draw_wide(),
        }],
        data: None,
    }
}
