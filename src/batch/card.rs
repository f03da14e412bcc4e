//! `CARD.md`: what a dataset is, for people who consider using it. Counts only, no claims.

use super::{Index, OutcomeKind, SplitBy};
use std::fmt::Write;

/// The card of a dataset as Markdown.
#[must_use]
pub fn card(index: &Index) -> String {
    let mut text = format!("# {}\n\n", index.name);
    let n = index.sessions.len();
    let _ = writeln!(
        text,
        "{n} sessions, {:.1} s recorded. Written by evrig {}; `dataset.json` holds the same for \
         programs.\n",
        index.duration_s(),
        index.evrig_version
    );
    for warning in &index.warnings {
        let _ = writeln!(text, "> {warning}\n");
    }
    text += "| sessions | |\n| --- | ---: |\n";
    for (words, verdict) in [
        ("processed", Some(OutcomeKind::Ok)),
        ("processed, with losses", Some(OutcomeKind::WithLosses)),
        ("failed", Some(OutcomeKind::Failed)),
        ("not processed", None),
    ] {
        let _ = writeln!(text, "| {words} | {} |", index.n_with(verdict));
    }
    text += "\n| split | share | sessions |\n| --- | ---: | ---: |\n";
    for share in &index.shares {
        let n = index.splits.get(&share.name).map_or(0, Vec::len);
        let _ = writeln!(text, "| {} | {} | {n} |", share.name, share.share);
    }
    let _ = writeln!(
        text,
        "\nA session's split follows from a hash of {} and the seed {}: adding sessions moves \
         none.",
        match index.split_by {
            SplitBy::Recording => "what was recorded",
            SplitBy::Stimulus => "the displayed image, whose recordings are all in one part,",
        },
        index.split_seed
    );
    text += "\n| rig | sessions |\n| --- | ---: |\n";
    for rig in &index.rigs {
        let _ = writeln!(text, "| {} | {} |", cell(&rig.id), rig.n_sessions);
    }
    text += "\n| stream | kind | sessions | count |\n| --- | --- | ---: | ---: |\n";
    for ((name, kind), count) in index.totals() {
        let has =
            |stream: &super::IndexedStream| stream.name == name && stream.kind.to_string() == kind;
        let n = index.sessions.iter().filter(|session| session.streams.iter().any(has)).count();
        let _ = writeln!(text, "| {} | {kind} | {n} | {count} |", cell(&name));
    }
    let unwell: Vec<_> = index.sessions.iter().filter(|s| !s.because.is_empty()).collect();
    if !unwell.is_empty() {
        text += "\n| session | what was lost, or why it failed |\n| --- | --- |\n";
        for session in unwell {
            let _ = writeln!(
                text,
                "| {} | {} |",
                cell(&session.path),
                cell(&session.because.join("; "))
            );
        }
    }
    text
}

/// Text as a cell of a Markdown table.
fn cell(text: &str) -> String {
    text.replace('|', "\\|").replace(['\n', '\r'], " ")
}
