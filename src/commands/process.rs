//! `evrig process`: every stage for which there is input, and what was left out and why.

mod explain;
mod own_light;
mod steps;
mod target;

pub(super) use target::cut_alike;

use super::{Ending, Output};
use crate::cli::ProcessArgs;
use crate::session::Session;
use serde_json::json;
use steps::Steps;

pub(super) fn run(args: &ProcessArgs, output: &Output) -> anyhow::Result<Ending> {
    let session = Session::open(&args.session)?;
    let mut all = Steps::default();
    all.append(target::align(&session, args, output)?);
    all.append(target::generate_from_scene(&session, args, output)?);
    all.append(own_light::calibrate_and_generate(&session, args, output)?);
    all.append(target::generate_from_pi(&session, args, output)?);
    all.append(target::filter_all(&session, args)?);
    all.append(explain::compare_all(&session, args)?);
    all.append(explain::diagnose(&session, args, output));
    let mut text = all.text;
    text += &format!("next: evrig report {}", args.session.display());
    let value = json!({
        "schema": "evrig.process/1",
        "session": session.manifest().name,
        "stages": all.stages,
        "left_out": all.left_out,
        "losses": session.manifest().losses,
    });
    output.result(&value, text)?;
    let n_lost = all.n_lost + session.manifest().losses.len();
    Ok(if n_lost == 0 { Ending::Done } else { Ending::WithLosses })
}
