//! `evrig export`: a stream in a format other programs read.

use super::{Ending, Output, WrongUse};
use crate::cli::{ExportArgs, ExportFormatArg as Chosen, ExportKind};
use crate::export::{EventSelection, ExportFormat, ExportRequest, export};
use evrig_report::number::counted;
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
    let mut words: Vec<String> = made.n_events.map(|n| counted(n, "event")).into_iter().collect();
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

/// Formats by the ending of the file; `v2e` and `ros2` share theirs with `hdf5` and `mcap`.
const ENDINGS: [(&str, ExportFormat); 13] = [
    ("npz", ExportFormat::Npz),
    ("h5", ExportFormat::Hdf5),
    ("hdf5", ExportFormat::Hdf5),
    ("parquet", ExportFormat::Parquet),
    ("csv", ExportFormat::Csv),
    ("txt", ExportFormat::Txt),
    ("zip", ExportFormat::Zip),
    ("aedat4", ExportFormat::Aedat4),
    ("raw", ExportFormat::Raw),
    ("mcap", ExportFormat::Mcap),
    ("gif", ExportFormat::Gif),
    ("mp4", ExportFormat::Mp4),
    ("rrd", ExportFormat::Rrd),
];

fn format(args: &ExportArgs) -> Result<ExportFormat, WrongUse> {
    if let Some(chosen) = args.format {
        return Ok(match chosen {
            Chosen::Npz => ExportFormat::Npz,
            Chosen::Hdf5 => ExportFormat::Hdf5,
            Chosen::Parquet => ExportFormat::Parquet,
            Chosen::Csv => ExportFormat::Csv,
            Chosen::Txt => ExportFormat::Txt,
            Chosen::Zip => ExportFormat::Zip,
            Chosen::Aedat4 => ExportFormat::Aedat4,
            Chosen::Raw => ExportFormat::Raw,
            Chosen::V2e => ExportFormat::V2e,
            Chosen::Ros2 => ExportFormat::Ros2,
            Chosen::Gif => ExportFormat::Gif,
            Chosen::Mp4 => ExportFormat::Mp4,
            Chosen::Mcap => ExportFormat::Mcap,
            Chosen::Rrd => ExportFormat::Rrd,
        });
    }
    let ending = args.out.extension().and_then(|extension| extension.to_str());
    let found = ENDINGS.iter().find(|(name, _)| ending == Some(*name)).map(|(_, format)| *format);
    found.ok_or_else(|| {
        let names: Vec<String> = ENDINGS.iter().map(|(name, _)| format!(".{name}")).collect();
        WrongUse(format!(
            "the ending of {} names no format; expected {}, or --format",
            args.out.display(),
            names.join(", ")
        ))
    })
}
