//! A dataset's sessions and its comparison as tables for people.

use crate::batch::{Aggregate, Index, OutcomeKind};
use crate::commands::table::aligned;
use evrig_report::number::quantity;
use std::fmt::Write;

/// A line per session, and the sums.
pub(super) fn sessions(index: &Index) -> String {
    let mut text = String::new();
    let width = index.sessions.iter().map(|s| s.path.chars().count()).max().unwrap_or(0).max(7);
    let _ = writeln!(text, "{:<width$}  {:<11}  {:>6}  why", "session", "outcome", "split");
    for session in &index.sessions {
        let verdict = session.verdict.map_or("not run".into(), |verdict| verdict.to_string());
        let split = session.split.as_deref().unwrap_or("-");
        let why = session.because.join("; ");
        let line = format!("{:<width$}  {verdict:<11}  {split:>6}  {why}", session.path);
        let _ = writeln!(text, "{}", line.trim_end());
    }
    let n = |verdict| index.n_with(verdict);
    let _ = writeln!(
        text,
        "{} sessions: {} ok, {} with losses, {} failed{}",
        index.sessions.len(),
        n(Some(OutcomeKind::Ok)),
        n(Some(OutcomeKind::WithLosses)),
        n(Some(OutcomeKind::Failed)),
        match n(None) {
            0 => String::new(),
            n => format!(", {n} not processed"),
        }
    );
    text
}

/// A line per variant: its sessions, then each measure with its error.
pub(super) fn comparison(aggregate: &Aggregate) -> String {
    let mut lines = vec![vec!["variant".to_owned(), "sessions".to_owned()]];
    let cells = aggregate.variants.first().map(|variant| variant.cells.as_slice());
    lines[0].extend(cells.unwrap_or_default().iter().map(|cell| cell.measure.clone()));
    for variant in &aggregate.variants {
        let mut line = vec![variant.name.clone(), variant.n_sessions.to_string()];
        line.extend(variant.cells.iter().map(|cell| quantity(&cell.mean).to_string()));
        lines.push(line);
    }
    aligned(&lines)
}
