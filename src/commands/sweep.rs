//! `evrig sweep`: one parameter over a range, as heat maps and point clouds.

use super::generate::conditions;
use super::{Ending, Output, WrongUse};
use crate::cli::SweepArgs;
use crate::pipeline::{self, GenerateRequest, ModelChoice, SweepRequest};
use anyhow::Context;
use evrig_core::effect_id::EffectId;
use evrig_generate::effect::{Effect, EffectSet};
use evrig_generate::{Knob, ModelParameters};
use evrig_session::{Session, StreamName};
use serde_json::json;

/// The swept parameter.
enum SweepAxis {
    Knob(Knob),
    Effect(EffectId, String),
}

pub(super) fn run(args: &SweepArgs, output: &Output) -> anyhow::Result<Ending> {
    let session = Session::open(&args.session)?;
    let (ranges, fixed): (Vec<String>, Vec<String>) =
        args.choice.knobs.iter().cloned().partition(|knob| knob.contains(".."));
    let [range] = ranges.as_slice() else {
        let found = ranges.len();
        return Err(WrongUse(format!(
            "{found} knobs have a range; give one, as --knob contrast-sensitivity=1..10"
        ))
        .into());
    };
    let (axis, [low, high]) = axis(range)?;
    let choice = ModelChoice { knobs: fixed, ..args.choice.choice() };
    let from = match (&args.from, pipeline::default_light(&session)) {
        (Some(from), _) => from.as_str(),
        (None, Some(light)) => light,
        (None, None) => anyhow::bail!("{} has no frames to sweep over", args.session.display()),
    };
    let mut base = GenerateRequest {
        from: from.to_owned(),
        name: StreamName::new("sweep")?,
        parameters: choice.parameters_on(&session, from)?,
        conditions: conditions(&args.conditions)?,
        force: true,
    };
    choice.prepare_on(&session, from, &mut base.conditions)?;
    let steps: anyhow::Result<Vec<(f64, GenerateRequest)>> = values(low, high, args.steps)
        .into_iter()
        .map(|value| Ok((value, request_at(&base, &axis, value)?)))
        .collect();
    let name = range.split('=').next().unwrap_or_default().trim().to_owned();
    let request = SweepRequest { name: name.clone(), steps: steps?, seconds: args.seconds };
    let bar = output.progress("sweep", u64::from(args.steps));
    let swept = pipeline::sweep(&session, &request, &mut || bar.inc(1))?;
    bar.finish_and_clear();
    let folder = session.root().join("derived").join("sweep");
    let path = args.out.clone().unwrap_or_else(|| {
        folder.join(format!("{}.html", name.replace(|c: char| !c.is_alphanumeric(), "-")))
    });
    if let Some(parent) = path.parent() {
        std::fs::create_dir_all(parent)
            .with_context(|| format!("cannot make {}", parent.display()))?;
    }
    std::fs::write(&path, &swept.html)
        .with_context(|| format!("cannot write the page to {}", path.display()))?;
    let steps: Vec<_> =
        swept.n_events.iter().map(|(v, n)| json!({ "value": v, "events": n })).collect();
    let value = json!({
        "schema": "evrig.sweep/1", "session": session.manifest().name, "knob": name,
        "from": from, "window_us": swept.window_us, "steps": steps, "path": path,
    });
    let mut text: String =
        swept.n_events.iter().map(|(v, n)| format!("{name} = {v:.4e}: {n} events\n")).collect();
    text += &path.display().to_string();
    output.result(&value, text)?;
    Ok(Ending::Done)
}

/// `name=a..b`, with the name a knob's or `effect.parameter`.
fn axis(text: &str) -> anyhow::Result<(SweepAxis, [f64; 2])> {
    let wrong =
        || WrongUse(format!("`{text}` is not a range; write it as contrast-sensitivity=1..10"));
    let (name, range) = text.split_once('=').ok_or_else(wrong)?;
    let (low, high) = range.split_once("..").ok_or_else(wrong)?;
    let number = |text: &str| text.trim().parse::<f64>().ok().filter(|v| v.is_finite());
    let (low, high) = number(low).zip(number(high)).ok_or_else(wrong)?;
    if low >= high {
        return Err(WrongUse(format!(
            "{name} runs from {low} to {high}; the second must be larger"
        ))
        .into());
    }
    let axis = match name.trim().split_once('.') {
        Some((effect, key)) => {
            let id: EffectId = effect.parse().map_err(|e| WrongUse(format!("{e}")))?;
            if !id.parameters().contains(&key) {
                let known = id.parameters().join(", ");
                return Err(
                    WrongUse(format!("{id} has no parameter {key}; there are {known}")).into()
                );
            }
            SweepAxis::Effect(id, key.to_owned())
        }
        None => SweepAxis::Knob(name.trim().parse().map_err(|e| WrongUse(format!("{e}")))?),
    };
    Ok((axis, [low, high]))
}

/// Values from low to high: in equal ratios over more than two decades, else in equal steps.
fn values(low: f64, high: f64, n: u32) -> Vec<f64> {
    let share = |i: u32| f64::from(i) / f64::from(n.max(2) - 1);
    let by_ratio = low > 0.0 && high / low > 100.0;
    let at = |s: f64| if by_ratio { low * (high / low).powf(s) } else { low + s * (high - low) };
    (0..n.max(2)).map(|i| at(share(i))).collect()
}

fn request_at(
    base: &GenerateRequest,
    axis: &SweepAxis,
    value: f64,
) -> anyhow::Result<GenerateRequest> {
    let mut request = base.clone();
    let wrong = |error: &dyn std::fmt::Display| WrongUse(error.to_string());
    match axis {
        SweepAxis::Knob(knob) => match &mut request.parameters.model {
            ModelParameters::Voltmeter { k, .. } => {
                *k = knob.turn(*k, value).map_err(|e| wrong(&e))?;
            }
            other => {
                let model = other.model().name();
                return Err(WrongUse(format!(
                    "the knob {knob} does not go with the model {model}"
                ))
                .into());
            }
        },
        SweepAxis::Effect(id, key) => {
            // The effect's other parameters are those of the same effect on the command line.
            let given = request.conditions.effects.iter().find(|a| a.effect.id() == *id);
            let given = given.map(|a| a.effect.model().parameters()).unwrap_or_default();
            let mut all: Vec<(&str, f64)> = given.iter().map(|p| (p.key, p.value)).collect();
            all.retain(|(name, _)| name != key);
            all.push((key, value));
            let effect = Effect::from_parameters(*id, &all).map_err(|e| wrong(&e))?;
            let others = request.conditions.effects.iter().filter(|a| a.effect.id() != *id);
            let all = others.copied().chain([effect.into()]);
            request.conditions.effects = EffectSet::new(all).map_err(|e| wrong(&e))?;
        }
    }
    Ok(request)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_range_is_gone_through_from_end_to_end() {
        assert_eq!(values(1.0, 10.0, 4), [1.0, 4.0, 7.0, 10.0]);
        let wide = values(1e-9, 1e-5, 5);
        assert!(wide.windows(2).all(|pair| (pair[1] / pair[0] - 10.0).abs() < 1e-9));
    }

    #[test]
    fn what_is_no_range_is_named() {
        let error = |text: &str| axis(text).map(|_| ()).unwrap_err().to_string();
        assert!(error("contrast-sensitivity").contains("is not a range"));
        assert!(error("contrast-sensitivity=3..1").contains("larger"));
        assert!(error("contrast-sensitivty=1..2").contains("contrast-sensitivity"));
        assert!(error("refractory_period.hz=1..2").contains("refractory_us"));
        assert!(axis("refractory_period.refractory_us=0..2000").is_ok());
    }
}
