//! What stands at the end of every run over a dataset: index, card, comparison, report, table.

use crate::batch::{self, Aggregate, Index, Splits, Verdict};
use crate::cli::ProcessArgs;
use crate::commands::{Ending, Output};
use serde_json::json;
use std::fmt::Write;
use std::path::Path;

/// Writes the files of the dataset and prints what became of its sessions.
pub(super) fn finish(
    root: &Path,
    args: &ProcessArgs,
    splits: &Splits,
    output: &Output,
) -> anyhow::Result<Ending> {
    let (index, aggregate) = write(root, splits, args.choice.seed)?;
    let value = json!({
        "schema": "evrig.process-dataset/1",
        "dataset": index.name,
        "n_ok": index.n_with(Some(Verdict::Ok)),
        "n_with_losses": index.n_with(Some(Verdict::WithLosses)),
        "n_failed": index.n_with(Some(Verdict::Failed)),
        "n_not_processed": index.n_with(None),
        "warnings": index.warnings,
        "sessions": index.sessions,
        "variants": aggregate.variants,
    });
    for warning in &index.warnings {
        output.warn(warning);
    }
    let mut text = table(&index);
    let _ = write!(text, "report: {}", root.join("report.html").display());
    output.result(&value, text)?;
    let is_whole = index.n_with(Some(Verdict::Ok)) == index.sessions.len();
    Ok(if is_whole { Ending::Done } else { Ending::WithLosses })
}

fn write(root: &Path, splits: &Splits, seed: u64) -> anyhow::Result<(Index, Aggregate)> {
    // Found anew: what was processed has more streams now than when the run began.
    let found = batch::walk(root)?;
    let index = batch::index(root, &found, splits);
    let all: Vec<_> = found.iter().collect();
    let aggregate = batch::aggregate(&index.name, &all, None, seed);
    index.write(root)?;
    let page = |name: &str, html: String| {
        let path = root.join(name);
        std::fs::write(&path, html).map_err(batch::BatchError::io(&path))
    };
    page("CARD.md", batch::card(&index))?;
    super::comparison::write(root, &aggregate)?;
    page("report.html", batch::dataset_page(root, &index, &aggregate).to_html()?)?;
    Ok((index, aggregate))
}

/// The splits that a dataset was last processed with.
pub(super) fn splits_of(root: &Path) -> anyhow::Result<Splits> {
    let Some(index) = batch::read_index(root)? else { return Ok(Splits::default()) };
    let share = |share: &batch::Share| format!("{}={}", share.name, share.share);
    let text: Vec<String> = index.shares.iter().map(share).collect();
    Ok(Splits::parse(&text.join(","))?.drawn(index.split_by, index.split_seed))
}

/// A line a session, and the sums.
fn table(index: &Index) -> String {
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
        n(Some(Verdict::Ok)),
        n(Some(Verdict::WithLosses)),
        n(Some(Verdict::Failed)),
        match n(None) {
            0 => String::new(),
            n => format!(", {n} not processed"),
        }
    );
    text
}
