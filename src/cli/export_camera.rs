//! `evrig export-camera`.

use clap::{Args, ValueEnum};
use std::path::PathBuf;

/// Arguments of `evrig export-camera`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    evrig export-camera sessions/street --for v2e\n  \
    evrig export-camera sessions/street --for iebcs --json")]
pub struct ExportCameraArgs {
    /// The session, diagnosed
    pub session: PathBuf,

    /// The simulator
    #[arg(long = "for", value_name = "NAME")]
    pub simulator: SimulatorChoice,
}

/// A simulator whose arguments are printed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum SimulatorChoice {
    /// Options of the command v2e
    V2e,
    /// The constructor of esim_py
    Esim,
    /// Calls of the Python interface of IEBCS
    Iebcs,
    /// The line SENSOR.K of DVS-Voltmeter, for 8-bit frames
    DvsVoltmeter,
}
