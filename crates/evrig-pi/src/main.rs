//! `evrig-pi`: serves the camera of a Raspberry Pi until Ctrl-C.

use clap::{Parser, ValueEnum};
use evrig_pi::picamera::Picamera;
use evrig_pi::serve::{SERVING, ServeError, ServeOptions, ServedCamera};
use evrig_pi::source::{FrameSource, Synthetic};
use std::io::Write;
use std::net::SocketAddr;
use std::path::PathBuf;
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
    /// Where to listen; beyond loopback only with keys
    #[arg(long, value_name = "ADDRESS:PORT", default_value = "127.0.0.1:7766")]
    listen: SocketAddr,

    /// The `agent` half of a pair of keys
    #[arg(long, value_name = "DIR")]
    keys: Option<PathBuf>,

    /// Where frames wait that the network is too slow for, and RGB frames until the take is over
    #[arg(long, value_name = "DIR")]
    spool: Option<PathBuf>,

    /// How much the spool may hold, gigabytes
    #[arg(long, value_name = "GB", default_value_t = 8.0)]
    spool_gb: f64,

    /// Where frames come from
    #[arg(long, value_enum, default_value_t = CameraArg::Picamera2)]
    camera: CameraArg,

    /// The Python that has picamera2
    #[arg(long, value_name = "PROGRAM", default_value = "/usr/bin/python3")]
    python: PathBuf,

    /// Print the address as JSON
    #[arg(long)]
    json: bool,

    /// Print nothing on stderr but warnings and errors
    #[arg(short, long)]
    quiet: bool,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum CameraArg {
    /// The Pi's own
    Picamera2,
    /// A pattern that identifies frame, column and row
    Synthetic,
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
    let Args { listen, keys, spool, spool_gb, camera, python, json, quiet } = args;
    let camera: Box<dyn FrameSource> = match camera {
        CameraArg::Picamera2 => Box::new(Picamera::new(&python)),
        CameraArg::Synthetic => Box::new(Synthetic::paced()),
    };
    let served = ServedCamera::open(&ServeOptions { listen, keys, spool, spool_gb }, camera)?;
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
