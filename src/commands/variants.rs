//! `evrig generate --variants`: a list of generations, compared in one table.

use super::generate::{
    asks_for_tuned, conditions, generate, prepare_as_tuned, tuned_parameters, value,
};
use super::{Ending, Output, WrongUse};
use crate::cli::{ConditionArgs, GenerateArgs, ModelArgs};
use crate::compare::Comparison;
use crate::generate::effect::Effects;
use crate::pipeline::{
    self, CalibrateRequest, CompareRequest, FilterRequest, GenerateRequest, ObjectiveKind,
    PipelineError, Reference,
};
use crate::report::number::quantity;
use crate::session::{Session, StreamKind, StreamName};
use anyhow::Context;
use serde::Deserialize;
use serde_json::{Value, json};

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
    effects: Effects,
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
    args: &GenerateArgs,
    output: &Output,
) -> anyhow::Result<Ending> {
    let mut rows = Vec::new();
    let mut reference = Reference::new(session, "real");
    for variant in read(list)? {
        rows.push(one(&mut reference, session, &variant, args, output)?);
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

fn one(
    reference: &mut Reference<'_>,
    session: &Session,
    variant: &Variant,
    args: &GenerateArgs,
    output: &Output,
) -> anyhow::Result<Row> {
    let name = StreamName::new(&variant.name).map_err(|error| WrongUse(error.to_string()))?;
    let left_out = |because: String| {
        let (name, because) = (variant.name.clone(), Some(because));
        Row { name, made: None, comparison: None, because }
    };
    if variant.from != "scene" && session.stream(StreamKind::Frames, &variant.from).is_err() {
        return Ok(left_out(format!("the session has no light `{}`", variant.from)));
    }
    if let Err(error) = calibrated(session, variant, args, output) {
        return Ok(left_out(format!("{error:#}")));
    }
    let parameters = match tuned_parameters(session, &variant.from, &variant.choice(args)) {
        Ok(parameters) => parameters,
        Err(error) if error.is::<WrongUse>() => return Err(error),
        Err(error) => return Ok(left_out(error.to_string())),
    };
    let mut conditions = conditions(&variant.conditions())?;
    conditions.effects = variant.effects.clone();
    if let Err(error) =
        prepare_as_tuned(session, &variant.from, &variant.choice(args), &mut conditions)
    {
        return Ok(left_out(error.to_string()));
    }
    let from = variant.from.clone();
    let request = GenerateRequest { from, name, parameters, conditions, force: args.force };
    let made = match generate(session, &request, output) {
        Ok(made) => made,
        Err(error) => return Ok(left_out(format!("{error:#}"))),
    };
    if let Err(error) = cut(session, &request.name, args.force) {
        let (name, because) = (variant.name.clone(), Some(error.to_string()));
        let made = Some(value(&request, &made));
        return Ok(Row { name, made, comparison: None, because });
    }
    let compared = CompareRequest {
        real: "real".into(),
        simulated: request.name.clone(),
        seed: args.choice.seed,
        force: args.force,
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
fn calibrated(
    session: &Session,
    variant: &Variant,
    args: &GenerateArgs,
    output: &Output,
) -> anyhow::Result<()> {
    let light = StreamName::new(&variant.from)?;
    let is_there =
        || Ok::<_, PipelineError>(pipeline::read_calibration(session, &light)?.is_some());
    if !asks_for_tuned(&variant.choice(args)) || is_there()? {
        return Ok(());
    }
    let request = CalibrateRequest {
        from: variant.from.clone(),
        real: "real".into(),
        objective: ObjectiveKind::Score,
        n_evaluations: 0,
        seed: args.choice.seed,
        force: false,
    };
    super::calibrate::calibrate(session, &request, output)?;
    Ok(())
}

impl Variant {
    fn choice(&self, args: &GenerateArgs) -> ModelArgs {
        ModelArgs {
            model: self.model.clone(),
            preset: self.preset.clone(),
            k: self.k.clone(),
            knobs: self.knobs.clone(),
            full_scale_dn: self.full_scale_dn,
            law: self.law.clone(),
            seed: self.seed.unwrap_or(args.choice.seed),
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
