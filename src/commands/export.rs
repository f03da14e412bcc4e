//! `evrig export`: a stream in a format other programs read.

use super::{Ending, Output, WrongUse};
use crate::cli::{ExportArgs, ExportFormatArg as Chosen, ExportKind};
use crate::export::{EventSelection, ExportFormat, ExportRequest, export};
use evrig_session::{Session, StreamKind};
use serde_json::json;

pub(super) fn run(args: &ExportArgs, output: &Output) -> anyhow::Result<Ending> {
    let session = Session::open(&args.session)?;
    let cut = match (args.canvas, args.filtered) {
        (Some(side), _) => EventSelection::Canvas(side),
        (None, true) => EventSelection::Picture,
        (None, false) => EventSelection::Whole,
    };
    let (stream, out) = (args.stream.clone(), args.out.clone());
    let kind = args.kind.map(|kind| match kind {
        ExportKind::Events => StreamKind::Events,
        ExportKind::Frames => StreamKind::Frames,
    });
    let request = ExportRequest { stream, kind, out, format: format(args)?, cut };
    let made = export(&session, &request)?;
    if made.has_namesake && kind.is_none() {
        output.say(format!(
            "`{}` names frames as well as the events made from them; these are the events, \
             --kind frames takes the frames",
            args.stream
        ));
    }
    let mut words: Vec<String> = made.n_events.map(|n| format!("{n} events")).into_iter().collect();
    words.extend(made.arrays.iter().map(|array| format!("{} {:?}", array.name, array.shape)));
    words.extend(made.beside.iter().map(|path| format!("also {}", path.display())));
    for because in &made.left_out {
        output.say(format!("left out: {because}"));
    }
    let text = format!("{}: {}", args.out.display(), words.join(", "));
    let value = json!({
        "path": args.out, "stream": args.stream, "format": request.format, "cut": request.cut,
        "events": made.n_events, "arrays": made.arrays, "beside": made.beside,
        "left_out": made.left_out,
    });
    output.result(&value, text)?;
    Ok(Ending::Done)
}

fn format(args: &ExportArgs) -> Result<ExportFormat, WrongUse> {
    Ok(match args.format {
        Some(Chosen::Npz) => ExportFormat::Npz,
        Some(Chosen::Hdf5) => ExportFormat::Hdf5,
        Some(Chosen::Parquet) => ExportFormat::Parquet,
        Some(Chosen::Csv) => ExportFormat::Csv,
        Some(Chosen::Txt) => ExportFormat::Txt,
        Some(Chosen::Aedat4) => ExportFormat::Aedat4,
        Some(Chosen::Mcap) => ExportFormat::Mcap,
        Some(Chosen::Rrd) => ExportFormat::Rrd,
        None => match args.out.extension().and_then(|extension| extension.to_str()) {
            Some("npz") => ExportFormat::Npz,
            Some("h5" | "hdf5") => ExportFormat::Hdf5,
            Some("parquet") => ExportFormat::Parquet,
            Some("csv") => ExportFormat::Csv,
            Some("txt") => ExportFormat::Txt,
            Some("aedat4") => ExportFormat::Aedat4,
            Some("mcap") => ExportFormat::Mcap,
            Some("rrd") => ExportFormat::Rrd,
            _ => {
                return Err(WrongUse(format!(
                    "the ending of {} names no format; expected .npz, .h5, .hdf5, .parquet, .csv, \
                     .txt, .aedat4, .mcap or .rrd, or --format",
                    args.out.display()
                )));
            }
        },
    })
}
