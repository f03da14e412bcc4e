//! `evrig compare`: simulated streams against the real one.

use super::{Ending, Output, WrongUse, stream_name};
use crate::batch::{FoundSession, aggregate};
use crate::cli::{CompareArgs, Engine};
use crate::pipeline::{self, CompareRequest, Freshness, PipelineError};
use evrig_analysis::compare::Comparison;
use evrig_report::{session::measures, terminal};
use evrig_session::Session;
use serde_json::{Value, json};

pub(super) fn run(args: &CompareArgs, output: &Output) -> anyhow::Result<Ending> {
    if crate::batch::is_dataset(&args.session) {
        return super::dataset::compare(args, output);
    }
    let is_on_slurm = args.engine.engine == Engine::Slurm;
    if args.variants.is_some() || args.rig.is_some() || is_on_slurm {
        let what = "--variants, --rig and --engine belong to a dataset; of a session `evrig \
            generate SESSION --variants LIST` makes them";
        return Err(WrongUse(what.into()).into());
    }
    let session = Session::open(&args.session)?;
    let streams = match &args.stream {
        Some(name) => vec![stream_name(name)?],
        None => pipeline::simulated_streams(&session, &args.real),
    };
    if streams.is_empty() {
        anyhow::bail!(
            "{} has no simulated stream to compare; make one with `evrig generate`",
            args.session.display()
        );
    }
    let (mut values, mut left_out) = (Vec::new(), Vec::new());
    let mut text = String::new();
    let mut reference = pipeline::ReferenceStream::new(&session, &args.real);
    for stream in streams {
        let request = CompareRequest {
            real: args.real.clone(),
            simulated: stream.clone(),
            seed: args.seed,
            force: args.force,
        };
        match pipeline::compare_with(&mut reference, &request) {
            Ok((comparison, freshness)) => {
                text += &table(&request, &comparison);
                values.push(value(&request, &comparison, freshness)?);
            }
            // Of all streams, one on another grid is no reason to leave the others out.
            Err(error @ PipelineError::Missing { .. }) if args.stream.is_none() => {
                left_out
                    .push(json!({ "simulated": stream.as_str(), "because": error.to_string() }));
                output.warn(error);
            }
            Err(error) => return Err(error.into()),
        }
    }
    if values.is_empty() {
        anyhow::bail!("none of the simulated streams could be compared; the reasons are above");
    }
    if args.table.is_some() {
        let key = session.manifest().name.clone();
        let found = FoundSession { key, path: args.session.clone(), session: Ok(session.clone()) };
        let aggregate = aggregate(&found.key, &[&found], None, args.seed);
        for path in super::dataset::paper_table(args, &aggregate)? {
            text += &format!("{}\n", path.display());
        }
    }
    let value =
        json!({ "schema": "evrig.comparisons/1", "comparisons": values, "left_out": left_out });
    output.result(&value, text.trim_end())?;
    Ok(Ending::Done)
}

/// The result of one comparison as consumers of `--json` get it.
pub(super) fn value(
    request: &CompareRequest,
    comparison: &Comparison,
    freshness: Freshness,
) -> anyhow::Result<Value> {
    let mut value = serde_json::to_value(comparison)?;
    if let Value::Object(fields) = &mut value {
        fields.insert("real".into(), request.real.clone().into());
        fields.insert("simulated".into(), request.simulated.as_str().into());
        fields.insert("fresh".into(), (freshness == Freshness::Fresh).into());
    }
    Ok(value)
}

/// The measures of one comparison for people.
pub(super) fn table(request: &CompareRequest, comparison: &Comparison) -> String {
    let CompareRequest { real, simulated, .. } = request;
    format!(
        "{simulated} against {real}: {} simulated, {} real events in {:.3} s\n{}\n",
        comparison.n_simulated,
        comparison.n_real,
        (comparison.window_us[1] - comparison.window_us[0]) as f64 * 1e-6,
        terminal::measures(&measures(simulated.as_str(), comparison)),
    )
}
