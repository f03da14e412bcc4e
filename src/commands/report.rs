//! `evrig report`: one self-contained HTML file.

use super::{Ending, Output};
use crate::cli::ReportArgs;
use crate::pipeline;
use anyhow::Context;
use evrig_session::Session;
use serde_json::json;

pub(super) fn run(args: &ReportArgs, output: &Output) -> anyhow::Result<Ending> {
    if crate::batch::is_dataset(&args.session) {
        return super::dataset::report(args, output);
    }
    let session = Session::open(&args.session)?;
    let html = pipeline::report(&session)?;
    let path = args.out.clone().unwrap_or_else(|| session.layout().report());
    std::fs::write(&path, &html)
        .with_context(|| format!("cannot write the report to {}", path.display()))?;
    let value = json!({
        "schema": "evrig.report/1",
        "session": session.manifest().name,
        "path": path,
        "bytes": html.len(),
    });
    output.result(&value, path.display())?;
    Ok(Ending::Done)
}
