//! `evrig export`: a stream in a format other programs read.

use super::{Ending, Output};
use crate::cli::{ExportArgs, ExportFormat};
use crate::session::{Session, export_npz};
use serde_json::json;

pub(super) fn run(args: &ExportArgs, output: &Output) -> anyhow::Result<Ending> {
    let session = Session::open(&args.session)?;
    let arrays = match args.format {
        ExportFormat::Npz => export_npz(&session, &args.stream, &args.out)?,
    };
    let words: Vec<String> =
        arrays.iter().map(|array| format!("{} {:?}", array.name, array.shape)).collect();
    let text = format!("{}: {}", args.out.display(), words.join(", "));
    output.result(&json!({ "path": args.out, "stream": args.stream, "arrays": arrays }), text)?;
    Ok(Ending::Done)
}
