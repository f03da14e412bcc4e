//! `evrig generate --variants`: a list of generations, compared in one table.

use super::generate::{
    asks_for_tuned, conditions, generate, prepare_as_tuned, tuned_parameters, value,
};
use super::{Ending, Output, WrongUse};
use crate::cli::{ConditionArgs, ModelArgs};
use crate::pipeline::{
    self, CalibrateRequest, CompareRequest, FilterRequest, GenerateRequest, ObjectiveKind,
    PipelineError, Reference,
};
use anyhow::Context;
use evrig_analysis::compare::Comparison;
use evrig_generate::effect::EffectSet;
use evrig_report::number::quantity;
use evrig_session::{Session, StreamKind, StreamName};
use serde::Deserialize;
use serde_json::{Value, json};
use std::time::Instant;

const TWELVE: &str = include_str!("variants/twelve.toml");
const DAVIS: &str = include_str!("variants/davis.toml");

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct List {
    variant: Vec<Variant>,
}

/// One stream to make; what is not given is as on the command line.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Variant {
    name: String,
    from: String,
    model: Option<String>,
    preset: Option<String>,
    k: Option<String>,
    #[serde(default)]
    knobs: Vec<String>,
    full_scale_dn: Option<f64>,
    law: Option<String>,
    seed: Option<u64>,
    interpolate_us: Option<u32>,
    #[serde(default)]
    in_plane: bool,
    colour: Option<String>,
    #[serde(default)]
    subtract_black: bool,
    #[serde(default)]
    divide_exposure: bool,
    #[serde(default)]
    effects: EffectSet,
}

/// What became of a variant.
struct Row {
    name: String,
    made: Option<Value>,
    comparison: Option<Comparison>,
    because: Option<String>,
}

pub(super) fn run(
    session: &Session,
    list: &str,
    choice: &ModelArgs,
    force: bool,
    output: &Output,
) -> anyhow::Result<Ending> {
    let mut rows: Vec<Row> = Vec::new();
    let mut reference = Reference::new(session, "real");
    let variants = read(list)?;
    let n = variants.len();
    for (i, variant) in variants.iter().enumerate() {
        let asked = Asked { session, choice, force, output };
        let began = Instant::now();
        let row = one(&mut reference, variant, &asked)?;
        output.say(format!("{:>2} of {n}  {}", i + 1, said(&row, began.elapsed().as_secs_f64())));
        rows.push(row);
    }
    let n_left_out = rows.iter().filter(|row| row.made.is_none()).count();
    let value = json!({
        "schema": "evrig.variants/1",
        "session": session.manifest().name,
        "variants": rows.iter().map(|row| json!({
            "name": row.name,
            "generation": row.made,
            "comparison": row.comparison,
            "because": row.because,
        })).collect::<Vec<_>>(),
    });
    output.result(&value, table(&rows))?;
    if n_left_out == rows.len() {
        anyhow::bail!("none of the {n_left_out} variants could be made; the reasons stand above");
    }
    Ok(Ending::Done)
}

fn read(list: &str) -> anyhow::Result<Vec<Variant>> {
    let text = match list {
        "twelve" => TWELVE.to_owned(),
        "davis" => DAVIS.to_owned(),
        path => std::fs::read_to_string(path).with_context(|| {
            format!("cannot read the list of variants {path}; bundled are `twelve` and `davis`")
        })?,
    };
    let list: List = toml::from_str(&text).map_err(|e| WrongUse(format!("{list}: {e}")))?;
    Ok(list.variant)
}

/// What holds for the whole list.
struct Asked<'a> {
    session: &'a Session,
    choice: &'a ModelArgs,
    force: bool,
    output: &'a Output,
}

/// The words of a command line for a list that may be read from another directory.
pub(super) fn elsewhere(list: &str) -> anyhow::Result<String> {
    if ["twelve", "davis"].contains(&list) {
        return Ok(list.to_owned());
    }
    read(list)?;
    let path = std::fs::canonicalize(list).with_context(|| list.to_owned())?;
    Ok(path.display().to_string())
}

/// What became of a variant, in a line.
fn said(row: &Row, seconds: f64) -> String {
    let Some(made) = &row.made else {
        return format!("{}: left out: {}", row.name, row.because.as_deref().unwrap_or_default());
    };
    let fresh = if made["fresh"] == true { "fresh, " } else { "" };
    let beside = row.because.as_ref().map_or(String::new(), |why| format!("; not compared: {why}"));
    format!("{}: {} events ({fresh}{seconds:.1} s){beside}", row.name, made["events"])
}

fn one(reference: &mut Reference<'_>, variant: &Variant, asked: &Asked<'_>) -> anyhow::Result<Row> {
    let Asked { session, choice, force, output } = *asked;
    let name = StreamName::new(&variant.name).map_err(|error| WrongUse(error.to_string()))?;
    let left_out = |because: String| {
        let (name, because) = (variant.name.clone(), Some(because));
        Row { name, made: None, comparison: None, because }
    };
    if variant.from != "scene" && session.stream(StreamKind::Frames, &variant.from).is_err() {
        return Ok(left_out(format!("the session has no light `{}`", variant.from)));
    }
    let choice = variant.choice(choice);
    if let Err(error) = calibrated(asked, variant, &choice) {
        return Ok(left_out(format!("{error:#}")));
    }
    let parameters = match tuned_parameters(session, &variant.from, &choice) {
        Ok(parameters) => parameters,
        Err(error) if error.is::<WrongUse>() => return Err(error),
        Err(error) => return Ok(left_out(error.to_string())),
    };
    let mut conditions = conditions(&variant.conditions())?;
    conditions.effects = variant.effects.clone();
    if let Err(error) = prepare_as_tuned(session, &variant.from, &choice, &mut conditions) {
        return Ok(left_out(error.to_string()));
    }
    let from = variant.from.clone();
    let request = GenerateRequest { from, name, parameters, conditions, force };
    let made = match generate(session, &request, output) {
        Ok(made) => made,
        Err(error) => return Ok(left_out(format!("{error:#}"))),
    };
    if let Err(error) = cut(session, &request.name, force) {
        let (name, because) = (variant.name.clone(), Some(error.to_string()));
        let made = Some(value(&request, &made));
        return Ok(Row { name, made, comparison: None, because });
    }
    let compared = CompareRequest {
        real: "real".into(),
        simulated: request.name.clone(),
        seed: asked.choice.seed,
        force,
    };
    let (comparison, because) = match pipeline::compare_with(reference, &compared) {
        Ok((comparison, _)) => (Some(comparison), None),
        Err(error) => (None, Some(error.to_string())),
    };
    let made = Some(value(&request, &made));
    Ok(Row { name: variant.name.clone(), made, comparison, because })
}

/// Cuts the real stream and a made one to the picture, where a track says where that is: streams of
/// two cameras meet only there.
fn cut(session: &Session, made: &StreamName, force: bool) -> Result<(), PipelineError> {
    let Some(settings) = super::process::cut_alike(session) else { return Ok(()) };
    for (stream, force) in [(StreamName::new("real")?, false), (made.clone(), force)] {
        pipeline::filter(session, &FilterRequest { stream, settings, force })?;
    }
    Ok(())
}

/// Tells the session's own constants where the variant wants them and nobody has told them yet.
fn calibrated(asked: &Asked<'_>, variant: &Variant, choice: &ModelArgs) -> anyhow::Result<()> {
    let session = asked.session;
    let light = StreamName::new(&variant.from)?;
    let is_there =
        || Ok::<_, PipelineError>(pipeline::read_calibration(session, &light)?.is_some());
    if !asks_for_tuned(choice) || is_there()? {
        return Ok(());
    }
    let request = CalibrateRequest {
        from: variant.from.clone(),
        real: "real".into(),
        objective: ObjectiveKind::Score,
        n_evaluations: 0,
        seed: asked.choice.seed,
        force: false,
    };
    super::calibrate::calibrate(session, &request, asked.output)?;
    Ok(())
}

impl Variant {
    fn choice(&self, given: &ModelArgs) -> ModelArgs {
        ModelArgs {
            model: self.model.clone(),
            preset: self.preset.clone(),
            k: self.k.clone(),
            knobs: self.knobs.clone(),
            full_scale_dn: self.full_scale_dn,
            law: self.law.clone(),
            seed: self.seed.unwrap_or(given.seed),
        }
    }

    fn conditions(&self) -> ConditionArgs {
        ConditionArgs {
            interpolate: self.interpolate_us,
            in_plane: self.in_plane,
            colour: self.colour.clone(),
            subtract_black: self.subtract_black,
            divide_exposure: self.divide_exposure,
            ..ConditionArgs::default()
        }
    }
}

/// A line a variant: events, then each measure with its error.
fn table(rows: &[Row]) -> String {
    let measures = rows.iter().find_map(|row| row.comparison.as_ref());
    let mut lines = vec![["variant", "events", "frame rhythm"].map(str::to_owned).to_vec()];
    let names = measures.map(|comparison| comparison.measures.iter().map(|m| m.name.to_string()));
    lines[0].extend(names.into_iter().flatten());
    for row in rows {
        let events = row.made.as_ref().map_or("-".to_owned(), |made| made["events"].to_string());
        let rhythm = row.made.as_ref().and_then(|made| made["frame_rhythm"].as_f64());
        let rhythm = rhythm.map_or("-".to_owned(), |rhythm| format!("{rhythm:.3}"));
        let mut line = vec![row.name.clone(), events, rhythm];
        if let Some(comparison) = &row.comparison {
            line.extend(comparison.measures.iter().map(|m| quantity(&m.estimate).to_string()));
        } else if let Some(because) = &row.because {
            line.push(format!("left out: {because}"));
        }
        lines.push(line);
    }
    let n_columns = lines[0].len();
    let width = |column: usize| {
        let cells = lines.iter().filter(|line| line.len() == n_columns || column < 3);
        cells.filter_map(|line| line.get(column)).map(|cell| cell.chars().count()).max()
    };
    let widths: Vec<usize> = (0..n_columns).map(|column| width(column).unwrap_or(0)).collect();
    let set = |line: &Vec<String>| {
        let cells = line.iter().enumerate().map(|(i, cell)| {
            format!("{cell:<width$}", width = widths.get(i).copied().unwrap_or(0))
        });
        cells.collect::<Vec<_>>().join("  ").trim_end().to_owned()
    };
    lines.iter().map(set).collect::<Vec<_>>().join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn the_bundled_lists_are_read_and_name_each_stream_once() {
        for (list, n) in [("twelve", 12), ("davis", 6)] {
            let variants = read(list).unwrap();
            let names: BTreeSet<_> = variants.iter().map(|v| v.name.clone()).collect();
            assert_eq!((variants.len(), names.len()), (n, n));
            for name in names {
                StreamName::new(&name).unwrap();
            }
        }
    }
}
