//! The diagnosis' section of the page: the verdict, what was named, where the model is wrong.

mod free_run;
mod heat;

use super::figure::{Figure, Key, Link, Panel, Sample};
use super::number::{count, significant};
use super::page::{Block, Fact, Section};
use super::plot::Ink;
use super::plot::chart::{Axis, Chart, Layer};
use super::table::{Cell, Column, Table};
use evrig_analysis::diagnose::{
    ConfidenceInterval, Diagnosis, DiagnosisVerdict, FittedEffect, ForwardSimulation, HeatMap,
    MisfitStratum, ProposedTerm, RejectedEffect, SplitHalfFit, UntestableEffect,
};

/// The section of a diagnosis, with the generator's free run and the heat maps where there are any.
#[must_use]
pub fn section(
    diagnosis: &Diagnosis,
    run: Option<&ForwardSimulation>,
    maps: &[HeatMap],
) -> Section {
    let link = || Link::beside("derived/diagnose/diagnosis.json");
    let mut blocks = vec![Block::Facts(facts(diagnosis))];
    if !diagnosis.effects.is_empty() {
        blocks.push(Block::Table(effects(&diagnosis.effects)));
        blocks.extend(diagnosis.effects.iter().map(|effect| {
            let equation = if effect.equation.is_empty() { "" } else { " Equation: " };
            Block::Text(format!(
                "{}: {}.{equation}{}",
                effect.name, effect.description, effect.equation
            ))
        }));
    }
    if !diagnosis.rejected_effects.is_empty() {
        blocks.push(Block::Table(suspects(&diagnosis.rejected_effects)));
    }
    blocks.extend(
        run.into_iter().flat_map(|run| free_run::blocks(run, !diagnosis.effects.is_empty())),
    );
    if !diagnosis.split_half.is_empty() {
        blocks.push(Block::Table(halves(&diagnosis.split_half, &diagnosis.effects)));
    }
    let title = match diagnosis.verdict {
        DiagnosisVerdict::NoMismatch => "Where the most is left, below what matters",
        _ => "Where the baseline is wrong",
    };
    let mut places = vec![(title, &diagnosis.mismatch.strata)];
    if !diagnosis.effects.is_empty() {
        places.push((
            "Where the model with those effects is still wrong",
            &diagnosis.residual_mismatch.strata,
        ));
    }
    for (title, places) in places.into_iter().filter(|(_, places)| !places.is_empty()) {
        blocks.push(Block::Table(wheres(title, places)));
    }
    blocks.extend(heat::blocks(maps, !diagnosis.effects.is_empty()));
    if let Some(term) = &diagnosis.proposed_term {
        blocks.push(Block::Figure(proposed(term).with_data(link())));
    }
    if let Some(next) = &diagnosis.next_recording {
        blocks.push(Block::Text(format!("To tell equivalent effects apart, record {next}.")));
    }
    blocks.push(Block::Table(nuisances(diagnosis)));
    blocks.extend(diagnosis.coarse_stamps().map(Block::Text));
    if !diagnosis.cannot_judge.is_empty() {
        blocks.push(Block::Text(format!("This session cannot judge {}.", not_judged(diagnosis))));
    }
    Section { title: "Diagnosis".into(), lead: lead(diagnosis), blocks }
}

/// Effects that the session cannot judge, those with the same reason together.
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
            "The model holds: no effect of the library matters here".to_owned()
        }
        DiagnosisVerdict::Explained => format!("Explained by {}", names.join(" and ")),
        DiagnosisVerdict::PartlyExplained => {
            format!("Explained in part by {}", names.join(" and "))
        }
        DiagnosisVerdict::Unexplained => {
            "There is a mismatch that no effect of the library accounts for".to_owned()
        }
    };
    format!(
        "{verdict}. From {} events of {} pixels; scores are log-likelihoods in nats an event on \
         cells that no fit has seen, time in seconds.",
        count(diagnosis.n_events as u64),
        count(diagnosis.n_pixels as u64)
    )
}

fn facts(diagnosis: &Diagnosis) -> Vec<Fact> {
    let scores = &diagnosis.fit.heldout_nats_per_event;
    let upper_bound_source = scores.upper_bound_source.replace('_', " ");
    let mut facts = vec![
        Fact::new("held-out score of the baseline", significant(scores.baseline, 4)),
        Fact::new("of the final model", significant(scores.r#final, 4)),
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
        "{} nats an event; recordings drawn from the fitted model: {}",
        significant(diagnosis.null.threshold_nats_per_event, 2),
        diagnosis.null.n
    );
    facts.push(Fact::new("least gain that is named", bar));
    if let Some(left) = &diagnosis.structure {
        let percent = |share: f64| format!("{} %", significant(100.0 * share, 3));
        let mut words = percent(left.baseline.accuracy);
        if !diagnosis.effects.is_empty() {
            words += &format!(
                " from the baseline's, {} from the final model's",
                percent(left.r#final.accuracy)
            );
        }
        facts.push(Fact::new("events told from the model's (50 %: none)", words));
    }
    facts
}

/// A value with its 90 % interval, where it is known.
fn with_interval(interval: &ConfidenceInterval) -> String {
    let value = significant(interval.value, 4);
    match interval.ci90 {
        [Some(low), Some(high)] => {
            format!("{value} ({} to {})", significant(low, 4), significant(high, 4))
        }
        _ => value,
    }
}

fn effects(effects: &[FittedEffect]) -> Table {
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
            (Cell::text("not scored"), String::new())
        } else {
            let error = significant(effect.heldout_gain_error, 2);
            (Cell::number(effect.heldout_gain_nats_per_event), error)
        };
        vec![
            Cell::text(effect.id.as_str()),
            Cell::text(&parameters.join(", ")),
            gain,
            Cell::text(&error),
            Cell::text(&rivals.join(", ")),
            Cell::text(&equivalent.join(", ")),
        ]
    };
    Table {
        title: "Effects named".into(),
        caption:
            "Each gain is on top of the effects above it. Parameters with 90 % intervals, which \
                  come from the scatter over cells and do not know the model's own misfit. Rivals: \
                  what they would have gained in the same place. Not scored: seen in the frames, so that \
                  the light has it, or over the whole sensor."
                .into(),
        columns: vec![
            Column::text("effect"),
            Column::text("parameters"),
            Column::number("gain", "nats/event"),
            Column::text("standard error"),
            Column::text("rivals"),
            Column::text("not told apart"),
        ],
        rows: effects.iter().map(row).collect(),
    }
}

fn suspects(suspects: &[RejectedEffect]) -> Table {
    let row = |suspect: &RejectedEffect| {
        vec![
            Cell::text(suspect.id.name()),
            Cell::number(suspect.heldout_gain_nats_per_event),
            Cell::text(&suspect.because),
        ]
    };
    Table {
        title: "Fits, and is not named".into(),
        caption: "What comes nearest in the library, and what each lacks for a name: a gain that is sure, one \
                  strength everywhere, and nothing left to tell its events from the camera's."
            .into(),
        columns: vec![
            Column::text("effect"),
            Column::number("gain", "nats/event"),
            Column::text("what it lacks"),
        ],
        rows: suspects.iter().map(row).collect(),
    }
}

fn halves(halves: &[SplitHalfFit], effects: &[FittedEffect]) -> Table {
    let keys: Vec<String> = effects
        .iter()
        .flat_map(|e| e.parameters.keys().map(move |key| format!("{}.{key}", e.id)))
        .collect();
    let row = |half: &SplitHalfFit| {
        let mut row = vec![
            Cell::text(&half.subset),
            Cell::count(half.n_events as u64),
            Cell::number(half.heldout_gain_nats_per_event),
        ];
        let value = |key: &String| half.parameters.get(key).copied();
        row.extend(keys.iter().map(|k| value(k).map_or_else(|| Cell::text(""), Cell::number)));
        row
    };
    let mut columns = vec![
        Column::text("refitted on"),
        Column::number("events", ""),
        Column::number("gain", "nats/event"),
    ];
    columns.extend(keys.iter().map(|key| Column::number(key, "")));
    Table {
        title: "Do the halves agree?".into(),
        caption: "The named effects refitted on half of the pixels and on half of the time.".into(),
        columns,
        rows: halves.iter().map(row).collect(),
    }
}

fn wheres(title: &str, places: &[MisfitStratum]) -> Table {
    let row = |place: &MisfitStratum| {
        let [low, high] = place.range.map(|end| significant(end, 3));
        vec![
            Cell::text(&place.description),
            Cell::text(&place.covariate),
            Cell::text(&format!("{low} to {high}")),
            Cell::number(place.excess_nats_per_event),
            place.innovation_thresholds.map_or_else(|| Cell::text(""), Cell::number),
            Cell::count(place.n_events),
        ]
    };
    Table {
        title: title.into(),
        caption: "What a recalibration of the model within the stratum would gain, over all events; \
                  innovation: how much further the light had changed than the threshold, in thresholds."
            .into(),
        columns: vec![
            Column::text("in words"),
            Column::text("covariate"),
            Column::text("range"),
            Column::number("excess", "nats/event"),
            Column::number("innovation", "thresholds"),
            Column::number("events", ""),
        ],
        rows: places.iter().map(row).collect(),
    }
}

fn nuisances(diagnosis: &Diagnosis) -> Table {
    let rows = diagnosis.nuisances.iter();
    Table {
        title: "Nuisances".into(),
        caption: "Always fitted, never a finding within their ordinary range; 90 % intervals."
            .into(),
        columns: vec![Column::text("nuisance"), Column::text("value")],
        rows: rows
            .map(|(key, value)| vec![Cell::text(key), Cell::text(&with_interval(value))])
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
        "{} nats an event on held-out cells",
        significant(term.heldout_gain_nats_per_event, 2)
    );
    Figure {
        title: "A term that would help".into(),
        caption: format!(
            "No effect of the library explains the rest. It goes with {x} and enters the {}: the mean \
             of what the light had changed beyond the threshold, with its 90 % band.",
            term.enters.replace('_', " ")
        ),
        legend: vec![Key::new(Ink::Real, Sample::Dot, "mean innovation")],
        panels: vec![Panel {
            title: "Residual against its covariate".into(),
            note,
            alt: format!("Mean innovation in thresholds against {x}."),
            drawing: Chart {
                x: Axis::linear(&x),
                y: Axis::linear("innovation (thresholds)"),
                layers,
            }
            .draw_wide(),
        }],
        data: None,
    }
}
