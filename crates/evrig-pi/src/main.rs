//! `evrig-pi`: serves the camera of a Raspberry Pi until Ctrl-C.

use clap::Parser;
use evrig_pi::cli::ServeOptions;
use evrig_pi::serve::{SERVING, ServeError, ServedCamera};
use std::io::Write;
use std::process::ExitCode;

/// Serves the camera of a Raspberry Pi to evrig
#[derive(Debug, Parser)]
#[command(name = "evrig-pi", version, max_term_width = 100)]
#[command(after_help = "Examples:\n  \
    evrig-pi --listen 0.0.0.0:7766 --keys ~/agent --spool /var/tmp   # on the Pi\n  \
    evrig-pi --camera synthetic                                      # a test pattern\n\n\
    It serves one recorder at a time until Ctrl-C; its address is the first line on stdout.\n\
    Beyond this machine it needs keys, which `evrig pair` makes on the host. The camera needs\n\
    Raspberry Pi OS with python3-picamera2. Exit codes: 0 done, 1 failed, 2 wrong use.")]
struct Args {
    #[command(flatten)]
    serve: ServeOptions,

    /// Print the address as JSON
    #[arg(long)]
    json: bool,

    /// Print nothing on stderr but warnings and errors
    #[arg(short, long)]
    quiet: bool,
}

fn main() -> ExitCode {
    match serve(Args::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            let _ = writeln!(std::io::stderr(), "error: {error}");
            ExitCode::from(if error.is_wrong_use() { 2 } else { 1 })
        }
    }
}

// A failed write is a closed pipe, which is the reader's choice.
fn serve(args: Args) -> Result<(), ServeError> {
    let Args { serve, json, quiet } = args;
    let served = ServedCamera::open(&serve)?;
    let mut stderr = std::io::stderr();
    let _ = match &served.camera {
        Ok(_) if quiet => Ok(()),
        Ok(camera) => writeln!(stderr, "camera: {camera}"),
        Err(error) => writeln!(stderr, "warning: {error}"),
    };
    let mut stdout = std::io::stdout();
    let _ = if json {
        writeln!(stdout, "{:#}", serde_json::json!({ "address": served.address }))
    } else {
        writeln!(stdout, "{}", served.address)
    };
    if !quiet {
        let _ = writeln!(stderr, "{SERVING}");
    }
    served.wait();
    Ok(())
}
