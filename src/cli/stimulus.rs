//! `stimulus`: the target on a screen.

use clap::Args;
use std::net::SocketAddr;
use std::path::PathBuf;

/// Arguments of `evrig stimulus`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    evrig stimulus rig/lab.toml --images images\n  \
    evrig stimulus rig/lab.toml --images images.csv --px-per-mm 3.78\n\n\
    On the page: c calibrates with a bank card, f is full screen, arrow keys change the image,\n\
    space pauses. `evrig record ... --images LIST` serves the same page and changes images\n\
    itself. Ctrl-C ends.")]
pub struct StimulusArgs {
    /// The rig whose target is shown: a file, or the name of a bundled one
    pub rig: String,

    /// The images: a folder, or a text file with lines `image[,label]`
    #[arg(long, value_name = "LIST")]
    pub images: PathBuf,

    /// Pixels per millimetre of the screen; calibrated on the page if not given
    #[arg(long, value_name = "X")]
    pub px_per_mm: Option<f64>,

    /// Where the page is served, on this machine alone (port 0: any)
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1:8646")]
    pub listen: SocketAddr,
}
