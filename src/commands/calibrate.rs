//! `evrig calibrate`: the generator's constants from a session's frames and real events.

use super::{Ending, Output};
use crate::cli::{CalibrateArgs, CalibrateObjective};
use crate::pipeline::{self, CalibrateRequest, Freshness, ObjectiveKind};
use evrig_analysis::calibrate::{Calibration, Constant};
use evrig_report::number::significant;
use evrig_session::Session;
use serde_json::Value;

pub(super) fn run(args: &CalibrateArgs, output: &Output) -> anyhow::Result<Ending> {
    let session = Session::open(&args.session)?;
    let from = match (&args.from, pipeline::default_light(&session)) {
        (Some(from), _) => from.as_str(),
        (None, Some(light)) => light,
        (None, None) => anyhow::bail!(
            "{} has no frames to calibrate on; import a recording that has some",
            args.session.display()
        ),
    };
    let request = CalibrateRequest {
        from: from.to_owned(),
        real: args.real.clone(),
        objective: match args.objective {
            CalibrateObjective::Score => ObjectiveKind::Score,
            CalibrateObjective::Emd => ObjectiveKind::Emd,
        },
        n_evaluations: args.evaluations,
        seed: args.seed,
        force: args.force,
    };
    let bar = output.progress("calibrate", 1);
    let (calibration, freshness) = pipeline::calibrate(&session, &request)?;
    bar.finish_and_clear();
    let tuned = format!("{from}-tuned");
    let has_tuned = session.generated_names().iter().any(|name| name.as_str() == tuned);
    if freshness == Freshness::Ran && has_tuned {
        let root = args.session.display();
        output.say(format_args!(
            "`{tuned}` was generated with the former constants; `evrig process {root}` renews it"
        ));
    }
    let text = format!("{}\n{}", line(&calibration, freshness), table(&calibration));
    output.result(&value(&request, &calibration, freshness)?, text.trim_end())?;
    Ok(Ending::Done)
}

/// The result as consumers of `--json` get it.
pub(super) fn value(
    request: &CalibrateRequest,
    calibration: &Calibration,
    freshness: Freshness,
) -> anyhow::Result<Value> {
    let mut value = serde_json::to_value(calibration)?;
    if let Value::Object(fields) = &mut value {
        fields.insert("real".into(), request.real.clone().into());
        fields.insert("light".into(), request.from.clone().into());
        fields.insert("fresh".into(), (freshness == Freshness::Fresh).into());
    }
    Ok(value)
}

/// The result in a line.
pub(super) fn line(calibration: &Calibration, freshness: Freshness) -> String {
    let Calibration { k, from, objective, candidates, .. } = calibration;
    let held_out = |name: &str| {
        let candidate = candidates.iter().find(|candidate| candidate.name == name);
        let value = candidate.and_then(|candidate| candidate.held_out);
        value.map_or_else(|| "unknown".to_owned(), |value| significant(value, 4))
    };
    format!(
        "{}k = {} (from {from}); {objective} on held-out tiles, less is better: {} with published k, \
         {} with these",
        if freshness == Freshness::Fresh { "(fresh) " } else { "" },
        <[f64; 6]>::from(*k).map(|k| significant(k, 4)).join(", "),
        held_out("published"),
        held_out(from),
    )
}

/// The constants with their errors for people.
fn table(calibration: &Calibration) -> String {
    let cell = |constant: &Constant| {
        let [low, high] = constant.ci95;
        let [low, high] = [low, high].map(|end| significant(end, 3));
        format!("{} [{low}, {high}]", significant(constant.estimate.value, 4))
    };
    let mut text =
        format!("{:<4} {:<42} {}\n", "", "passages [95 %]", "paper's regressions [95 %]");
    for i in 0..6 {
        let paper = calibration.regressions.as_ref();
        let paper = paper.map_or_else(|| "-".to_owned(), |paper| cell(&paper.k[i]));
        text += &format!("k{:<3} {:<42} {paper}\n", i + 1, cell(&calibration.passages.k[i]));
    }
    if let Some(paper) = &calibration.regressions {
        text += &format!("k1' / k1 of the regressions: {}\n", cell(&paper.agreement));
    }
    if let Some(because) = &calibration.without_regressions {
        text += &format!("no regressions: {because}\n");
    }
    let fit = &calibration.passages;
    text += &format!(
        "{} passages; residuals are {:.2} times the model's variance, {:.1} % of them beyond half \
         a threshold\n",
        fit.n_used,
        fit.variance_ratio,
        100.0 * fit.share_far
    );
    for candidate in &calibration.candidates {
        let number = |value: Option<f64>| value.map_or("-".to_owned(), |v| significant(v, 4));
        text += &format!(
            "{:<12} {} {:>10} train {:>10} held out   k {}\n",
            candidate.name,
            calibration.objective,
            number(candidate.train),
            number(candidate.held_out),
            <[f64; 6]>::from(candidate.k).map(six_digits).join(",")
        );
    }
    text
}

/// A constant as `--k` takes it, without digits beyond any error.
fn six_digits(k: f64) -> String {
    let rounded: f64 = format!("{k:.5e}").parse().unwrap_or(k);
    format!("{rounded:?}")
}
