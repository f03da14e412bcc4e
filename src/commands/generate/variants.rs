//! `evrig generate --variants`: a list of generations, compared in one table.

use super::result;
use crate::commands::progress::ProgressDisplay;
use crate::commands::table::aligned;
use crate::commands::{Ending, Output};
use crate::pipeline::{self, VariantList, VariantResult, VariantResults};
use evrig_report::number::quantity;
use evrig_session::Session;
use serde_json::{Value, json};

pub(super) fn run(
    session: &Session,
    list: &str,
    seed: u64,
    force: bool,
    output: &Output,
) -> anyhow::Result<Ending> {
    let list = VariantList::read(list)?;
    let display = ProgressDisplay::new(output);
    let results =
        pipeline::variants(session, &list, seed, force, &|progress| display.show(progress))?;
    drop(display);
    output.result(&value(&results), table(&results.variants))?;
    results.require_any(session)?;
    Ok(Ending::Done)
}

/// The result as consumers of `--json` get it.
pub(in crate::commands) fn value(results: &VariantResults) -> Value {
    let variant = |variant: &VariantResult| {
        let made = variant.generated.as_ref();
        json!({
            "name": variant.name,
            "generation": made.map(|(request, made)| result::variant_value(request, made)),
            "comparison": variant.comparison,
            "because": variant.because,
        })
    };
    let variants: Vec<Value> = results.variants.iter().map(variant).collect();
    json!({ "schema": "evrig.variants/1", "session": results.session, "variants": variants })
}

/// A line per variant: events, then each measure with its error.
fn table(variants: &[VariantResult]) -> String {
    let mut lines = vec![["variant", "events", "frame rhythm"].map(str::to_owned).to_vec()];
    let compared = variants.iter().find_map(|variant| variant.comparison.as_ref());
    let measures = compared.map(|comparison| comparison.measures.as_slice()).unwrap_or_default();
    lines[0].extend(measures.iter().map(|measure| measure.name.to_string()));
    for variant in variants {
        let tally = variant.generated.as_ref().map(|(_, made)| &made.tally);
        let or_dash = |cell: Option<String>| cell.unwrap_or_else(|| "-".to_owned());
        let events = or_dash(tally.map(|tally| tally.n_events.to_string()));
        let rhythm = tally.and_then(|tally| tally.frame_rhythm);
        let rhythm = or_dash(rhythm.map(|rhythm| format!("{rhythm:.3}")));
        let mut line = vec![variant.name.clone(), events, rhythm];
        if let Some(comparison) = &variant.comparison {
            line.extend(comparison.measures.iter().map(|m| quantity(&m.estimate).to_string()));
        } else if let Some(because) = &variant.because {
            // The lines of a log that follow were printed already.
            line.push(format!("left out: {}", because.lines().next().unwrap_or_default()));
        }
        lines.push(line);
    }
    aligned(&lines)
}
