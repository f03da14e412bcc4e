//! Report and comparison of a dataset as pages.

use super::{Aggregate, Index, IndexedSession, NamedEffect, OutcomeKind};
use evrig_core::stats::{Estimate, Moments};
use evrig_report::figure::FileLink;
use evrig_report::number::{count, quantity};
use evrig_report::page::{Fact, Page, ReportSummary, Section, SectionBlock};
use evrig_report::table::{ReportTable, TableCell, TableColumn};
use evrig_session::StreamKind;
use std::collections::BTreeMap;
use std::path::Path;

/// The comparison alone.
#[must_use]
pub fn comparison_page(aggregate: &Aggregate) -> Page {
    Page {
        title: aggregate.dataset.clone(),
        kind: "Dataset comparison".into(),
        summary: ReportSummary { headline: headline(aggregate), ..ReportSummary::default() },
        sections: vec![comparison(aggregate)],
        is_folded: false,
        provenance: provenance(Some(aggregate)),
    }
}

/// Sessions, streams, splits and the comparison. Links lead to the sessions' own reports where they
/// have one.
#[must_use]
pub fn dataset_page(root: &Path, index: &Index, aggregate: &Aggregate) -> Page {
    let n = |verdict| index.n_with(verdict);
    let message = format!(
        "{} sessions: {} processed, {} with losses, {} failed.",
        index.sessions.len(),
        n(Some(OutcomeKind::Ok)),
        n(Some(OutcomeKind::WithLosses)),
        n(Some(OutcomeKind::Failed)),
    );
    let totals = index.totals();
    let n_real = totals.get(&("real".to_owned(), StreamKind::Events.to_string()));
    let facts = vec![
        Fact::new("sessions", index.sessions.len().to_string()),
        Fact::new("recorded", format!("{:.1} s", index.duration_s())),
        Fact::new("real events", count(n_real.copied().unwrap_or(0))),
        Fact::new("rigs", index.rigs.len().to_string()),
    ];
    let mut sections = vec![sessions(root, index)];
    if !aggregate.variants.is_empty() {
        sections.push(comparison(aggregate));
    }
    sections.extend(effects(index));
    sections.push(contents(index));
    Page {
        title: index.name.clone(),
        kind: "Dataset report".into(),
        summary: ReportSummary {
            headline: message,
            remarks: index.warnings.clone(),
            facts,
            figures: Vec::new(),
        },
        sections,
        is_folded: false,
        provenance: provenance(Some(aggregate)),
    }
}

fn headline(aggregate: &Aggregate) -> String {
    let mut sessions: Vec<&str> =
        aggregate.sessions.iter().map(|value| value.session.as_str()).collect();
    sessions.dedup();
    format!("{} generator variants over {} sessions.", aggregate.variants.len(), sessions.len())
}

fn provenance(aggregate: Option<&Aggregate>) -> Vec<Fact> {
    let mut facts = vec![Fact::new("evrig", env!("CARGO_PKG_VERSION"))];
    if let Some(aggregate) = aggregate {
        facts.push(Fact::new("seed of the errors", aggregate.seed.to_string()));
        facts.push(Fact::new("draws of sessions", count(aggregate.n_bootstrap)));
        facts.push(Fact::new("rig", aggregate.rig.clone().unwrap_or_else(|| "all".into())));
    }
    facts
}

fn sessions(root: &Path, index: &Index) -> Section {
    let columns = vec![
        TableColumn::text("session"),
        TableColumn::text("outcome"),
        TableColumn::text("split"),
        TableColumn::number("recorded", "s"),
        TableColumn::number("real events", ""),
        TableColumn::number("losses", ""),
        TableColumn::text("diagnosis"),
        TableColumn::text("rig"),
        TableColumn::text("what was lost, or why it failed"),
    ];
    let rows = index.sessions.iter().map(|session| {
        let report = format!("{}/report.html", session.path);
        let name = TableCell::text(&session.path);
        let has_report = root.join(&report).is_file();
        let real =
            session.streams.iter().find(|s| s.name == "real" && s.kind == StreamKind::Events);
        vec![
            if has_report { name.with_link(FileLink::beside(&report)) } else { name },
            TableCell::text(&session.verdict.map_or("not processed".into(), |v| v.to_string())),
            TableCell::text(session.split.as_deref().unwrap_or("")),
            session.duration_s.map_or(TableCell::text(""), TableCell::number),
            real.map_or(TableCell::text(""), |stream| TableCell::count(stream.count)),
            TableCell::count(session.losses.len() as u64),
            TableCell::text(&diagnosis(session)),
            TableCell::text(session.rig.as_deref().unwrap_or("")),
            TableCell::text(&session.because.join("; ")),
        ]
    });
    let table = ReportTable {
        title: "Sessions".into(),
        caption: "A session with a report leads to it.".into(),
        columns,
        rows: rows.collect(),
    };
    Section {
        title: "What became of each session".into(),
        lead: "Press a column's head to sort by it.".into(),
        blocks: vec![SectionBlock::ReportTable(table)],
    }
}

/// The diagnosis's word and the effects it named.
fn diagnosis(session: &IndexedSession) -> String {
    let Some(verdict) = session.diagnosis else { return String::new() };
    let word = serde_json::to_value(verdict).unwrap_or_default();
    let word = word.as_str().unwrap_or_default().replace('_', " ");
    let names: Vec<&str> = session.effects.iter().map(|effect| effect.id.as_str()).collect();
    if names.is_empty() { word } else { format!("{word}: {}", names.join(", ")) }
}

/// The effects that diagnoses named, with their parameters over the sessions.
fn effects(index: &Index) -> Option<Section> {
    let mut named: BTreeMap<&str, Vec<&NamedEffect>> = BTreeMap::new();
    for effect in index.sessions.iter().flat_map(|session| &session.effects) {
        named.entry(effect.id.as_str()).or_default().push(effect);
    }
    let n_diagnosed = index.sessions.iter().filter(|s| s.diagnosis.is_some()).count();
    let rows: Vec<Vec<TableCell>> = named
        .iter()
        .map(|(id, found)| {
            let gains: Vec<f64> =
                found.iter().map(|effect| effect.heldout_gain_nats_per_event).collect();
            let keys = found[0].parameters.keys();
            let parameters = keys.map(|key| {
                let known = found.iter().filter_map(|effect| effect.parameters.get(key).copied());
                format!("{key} {}", quantity(&over_sessions(&known.collect::<Vec<_>>())))
            });
            vec![
                TableCell::text(found[0].id.name()),
                TableCell::text(id),
                TableCell::count(found.len() as u64),
                TableCell::estimate(&over_sessions(&gains)),
                TableCell::text(&parameters.collect::<Vec<_>>().join("; ")),
            ]
        })
        .collect();
    (!rows.is_empty()).then(|| Section {
        title: "What the model leaves out".into(),
        lead: format!(
            "{n_diagnosed} sessions were diagnosed. Means over the sessions that name an effect, \
             each with its standard error."
        ),
        blocks: vec![SectionBlock::ReportTable(ReportTable {
            title: "Effects named".into(),
            caption: "Gains are in nats per event, on held-out events.".into(),
            columns: vec![
                TableColumn::text("effect"),
                TableColumn::text("id"),
                TableColumn::number("sessions", ""),
                TableColumn::number("held-out gain", "nats per event"),
                TableColumn::text("parameters"),
            ],
            rows,
        })],
    })
}

/// The mean over sessions with its standard error; a single one has none.
fn over_sessions(values: &[f64]) -> Estimate {
    let moments: Moments = values.iter().copied().collect();
    let error = if values.len() > 1 { moments.standard_error() } else { f64::NAN };
    Estimate::normal(moments.mean(), error, values.len() as u64)
}

fn comparison(aggregate: &Aggregate) -> Section {
    let mut columns = vec![TableColumn::text("variant"), TableColumn::number("sessions", "")];
    let cells = aggregate.variants.first().map(|variant| variant.cells.as_slice());
    columns
        .extend(cells.unwrap_or_default().iter().map(|cell| TableColumn::number(&cell.name, "")));
    let rows = aggregate.variants.iter().map(|variant| {
        let mut row = vec![TableCell::text(&variant.name), TableCell::count(variant.n_sessions)];
        row.extend(variant.cells.iter().map(|cell| TableCell::estimate(&cell.mean)));
        row
    });
    let means = ReportTable {
        title: "Means over sessions".into(),
        caption:
            "Each with the standard error of a bootstrap over sessions; a single session has none."
                .into(),
        columns: columns.clone(),
        rows: rows.collect(),
    };
    let rows = aggregate.variants.iter().map(|variant| {
        let mut row = vec![TableCell::text(&variant.name), TableCell::count(variant.n_sessions)];
        row.extend(variant.cells.iter().map(|cell| match cell.healthy {
            Some(_) => TableCell::count(cell.n_healthy),
            None => TableCell::text("no range"),
        }));
        row
    });
    let healthy = ReportTable {
        title: "Sessions in the healthy range".into(),
        caption: "Number of sessions in which each measure is in the range that its authors call \
             healthy."
            .into(),
        columns,
        rows: rows.collect(),
    };
    let mut blocks = vec![SectionBlock::ReportTable(means), SectionBlock::ReportTable(healthy)];
    blocks.extend(
        aggregate.left_out.iter().map(|because| SectionBlock::Text(format!("Left out: {because}"))),
    );
    Section {
        title: "Generated events against real ones".into(),
        lead: "comparison.csv and comparison.json beside this page hold the same numbers; \
               comparison-sessions.csv holds them session by session."
            .into(),
        blocks,
    }
}

fn contents(index: &Index) -> Section {
    let streams = ReportTable {
        title: "Streams".into(),
        caption: String::new(),
        columns: vec![
            TableColumn::text("stream"),
            TableColumn::text("kind"),
            TableColumn::number("count", ""),
        ],
        rows: index
            .totals()
            .into_iter()
            .map(|((name, kind), n)| {
                vec![TableCell::text(&name), TableCell::text(&kind), TableCell::count(n)]
            })
            .collect(),
    };
    let splits = ReportTable {
        title: "Splits".into(),
        caption: "By a hash of what was recorded: adding sessions moves none.".into(),
        columns: vec![
            TableColumn::text("split"),
            TableColumn::number("share", ""),
            TableColumn::number("sessions", ""),
        ],
        rows: index
            .shares
            .iter()
            .map(|share| {
                let n = index.splits.get(&share.name).map_or(0, Vec::len);
                vec![
                    TableCell::text(&share.name),
                    TableCell::number(share.share),
                    TableCell::count(n as u64),
                ]
            })
            .collect(),
    };
    let rigs = ReportTable {
        title: "Rigs".into(),
        caption: String::new(),
        columns: vec![TableColumn::text("rig"), TableColumn::number("sessions", "")],
        rows: index
            .rigs
            .iter()
            .map(|rig| vec![TableCell::text(&rig.id), TableCell::count(rig.n_sessions)])
            .collect(),
    };
    Section {
        title: "What is in it".into(),
        lead: String::new(),
        blocks: vec![
            SectionBlock::ReportTable(streams),
            SectionBlock::ReportTable(splits),
            SectionBlock::ReportTable(rigs),
        ],
    }
}
