//! `evrig process`: every stage for which there is input, and what was left out and why.

mod result;

pub(super) use result::value;

use super::progress::ProgressDisplay;
use super::{Ending, Output, WrongUse};
use crate::batch;
use crate::cli::{Engine, ProcessArgs};
use crate::pipeline::{ProcessRequest, VariantList};

pub(super) fn run(args: &ProcessArgs, output: &Output) -> anyhow::Result<Ending> {
    let request = ProcessRequest {
        choice: args.choice.choice(),
        variants: args.variants.as_deref().map(VariantList::read).transpose()?,
        n_pixels: None,
        force: args.force,
    };
    let (root, asked) = (args.session.as_path(), &args.batch);
    if batch::is_dataset(root) {
        return super::dataset::process(root, &request, asked, output);
    }
    if asked.engine.engine == Engine::Slurm || asked.status || asked.gather || asked.task.is_some()
    {
        let what = format!(
            "{} is a session; --engine slurm and --status take a dataset, a folder of sessions",
            root.display()
        );
        return Err(WrongUse(what).into());
    }
    let display = ProgressDisplay::new(output);
    let processed = batch::process_session(root, &request, &|progress| display.show(progress))?;
    drop(display);
    let text = format!("{}next: evrig report {}", result::text(&processed), root.display());
    output.result(&value(&processed)?, text)?;
    Ok(if processed.n_lost == 0 { Ending::Done } else { Ending::WithLosses })
}
