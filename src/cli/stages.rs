//! The stages of analysis: `generate`, `calibrate`, `compare`, `process`.

use crate::pipeline::ModelChoice;
use clap::{Args, ValueEnum};
use std::path::PathBuf;

/// Arguments of `evrig generate`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    evrig generate sessions/street\n  \
    evrig generate sessions/street --from aps --preset dvs346 --seed 7 --name aps-7\n  \
    evrig generate sessions/street --k 5.265,20,1e-4,1e-7,5e-9,1e-5 --law reference --name \
    published\n  evrig generate sessions/street --knob contrast-sensitivity=3 --knob \
    bright-leakage=0 --name calm\n  evrig generate sessions/street --model v2e --name v2e\n  \
    evrig generate sessions/street --effect refractory_period:refractory_us=800 --name held\n  \
    evrig generate sessions/one --from scene --k @calibrated --name scene-tuned\n  \
    evrig generate sessions/one --diagnosed      # the camera that `evrig diagnose` found there\n  \
    evrig generate sessions/next --diagnosed sessions/one/derived/diagnose/camera.json\n  \
    evrig generate sessions/street --variants davis\n\n\
    Knobs of the voltmeter (recommended range): event-sensitivity (1..10), contrast-sensitivity \
    (1..10), bright-leakage (0..1e-7), temporal-jitter (a factor), dark-noise-floor (0..1e-7), \
    global-noise (0..1e-4).")]
pub struct GenerateArgs {
    /// The session
    pub session: PathBuf,

    /// The frames: raw or rgb (the Pi's), aps (the DAVIS's own), frames (imported), or scene (the
    /// signal reconstructed by `evrig scene`) [default: what the session has]
    #[arg(long, value_name = "STREAM")]
    pub from: Option<String>,

    /// Name of the generated stream [default: that of the frames; with --diagnosed: diagnosed]
    #[arg(long)]
    pub name: Option<String>,

    /// Instead of a model: the camera that `evrig diagnose` fitted in this session, with its law,
    /// noise and named effects, on the signal of that diagnosis (own); or the camera.json of
    /// another session, on this session's scene, or on its frames with motion-compensated
    /// interpolation
    #[arg(
        long,
        value_name = "CAMERA_JSON",
        num_args = 0..=1,
        default_missing_value = "own",
        conflicts_with_all = [
            "model", "preset", "k", "knobs", "law", "full_scale_dn", "effects", "effects_file",
            "interpolate", "in_plane", "colour", "subtract_black", "divide_exposure", "variants"
        ]
    )]
    pub diagnosed: Option<PathBuf>,

    /// The generator and its parameters.
    #[command(flatten)]
    pub choice: ModelArgs,

    /// Preparation of the frames and physical effects.
    #[command(flatten)]
    pub conditions: ConditionArgs,

    /// Generate a list of variants and compare them in one table: twelve or davis, or a TOML file
    #[arg(long, value_name = "LIST", conflicts_with_all = ["from", "name"])]
    pub variants: Option<String>,

    /// Run even when the result is already there
    #[arg(long)]
    pub force: bool,
}

/// The generator and its parameters.
#[derive(Debug, Clone, Default, Args)]
pub struct ModelArgs {
    /// The event model: voltmeter, esim or v2e
    #[arg(long, value_name = "MODEL")]
    pub model: Option<String>,

    /// A published set of parameters: dvs346, dvs240, raw2dvs346, rgb2dvs346, one of esim and v2e;
    /// or tuned: those of `evrig calibrate` on this session
    #[arg(long, value_name = "PRESET", conflicts_with = "k")]
    pub preset: Option<String>,

    /// The voltmeter's parameters k1,...,k6; @calibrated: those of `evrig calibrate`
    #[arg(long, value_name = "K1,...,K6", allow_hyphen_values = true)]
    pub k: Option<String>,

    /// Set a knob of the voltmeter, as contrast-sensitivity=6; may be given several times
    #[arg(long = "knob", value_name = "NAME=VALUE")]
    pub knobs: Vec<String>,

    /// Value of white in the frames, for esim and v2e [default: 255]
    #[arg(long, value_name = "DN", value_parser = super::import::positive)]
    pub full_scale_dn: Option<f64>,

    /// exact: the stated equation; reference: the published program's shortcuts
    #[arg(long, value_name = "LAW")]
    pub law: Option<String>,

    /// Seed of all draws; the same seed gives the same events
    #[arg(long, default_value_t = 0)]
    pub seed: u64,
}

/// Preparation of the frames and physical effects.
#[derive(Debug, Clone, Default, Args)]
pub struct ConditionArgs {
    /// A physical effect, as refractory_period:refractory_us=800 (commas between parameters); may
    /// be given several times
    #[arg(hide_short_help = true, long = "effect", value_name = "ID:KEY=VALUE,...")]
    pub effects: Vec<String>,

    /// A TOML file of effects: refractory_period = { refractory_us = 800 }
    #[arg(hide_short_help = true, long = "effects", value_name = "FILE")]
    pub effects_file: Option<PathBuf>,

    /// Interpolate frames to at most this interval, linearly in log intensity
    #[arg(hide_short_help = true, long, value_name = "STEP_US", num_args = 0..=1, default_missing_value = "1000")]
    pub interpolate: Option<u32>,

    /// Interpolate along the motion of the target instead of per pixel: needs the stream's track,
    /// removes the frame rhythm and the rolling shutter from the events; raw frames are taken as
    /// luma
    #[arg(hide_short_help = true, long)]
    pub in_plane: bool,

    /// Channel of raw frames: mosaic, luma, or red, green, blue at half the size [default: mosaic]
    #[arg(hide_short_help = true, long, value_name = "COLOUR")]
    pub colour: Option<String>,

    /// Subtract the stated black level; the published generator does not
    #[arg(hide_short_help = true, long)]
    pub subtract_black: bool,

    /// Divide by exposure time and gain, so that automatic exposure generates no events
    #[arg(hide_short_help = true, long)]
    pub divide_exposure: bool,
}

impl ModelArgs {
    /// The same as a value of the pipeline.
    #[must_use]
    pub fn choice(&self) -> ModelChoice {
        let Self { model, preset, k, knobs, full_scale_dn, law, seed } = self.clone();
        ModelChoice { model, preset, k, knobs, full_scale_dn, law, seed }
    }
}

/// Arguments of `evrig calibrate`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    evrig calibrate sessions/street\n  \
    evrig calibrate sessions/street --objective emd --evaluations 120\n  \
    evrig generate sessions/street --k @calibrated --name tuned\n\n\
    score: the predictive log score of the recorded events, nats per event. emd: the paper's \
    normalised earth mover's distance of the points (t, x, y); it sees neither polarity nor \
    number of events.")]
pub struct CalibrateArgs {
    /// The session
    pub session: PathBuf,

    /// The frames: aps (the DAVIS's own), frames (imported), raw or rgb (the Pi's, mapped by the
    /// tracks of both cameras) or scene [default: what the session has]
    #[arg(long, value_name = "STREAM")]
    pub from: Option<String>,

    /// The events to calibrate to
    #[arg(long, value_name = "NAME", default_value = "real")]
    pub real: String,

    /// Objective of the search
    #[arg(long, value_enum, default_value = "score")]
    pub objective: CalibrateObjective,

    /// Evaluations of the search; 0: no search, the best fit is taken
    #[arg(long, value_name = "N", default_value_t = 300)]
    pub evaluations: usize,

    /// Seed of all draws
    #[arg(long, default_value_t = 0)]
    pub seed: u64,

    /// Run even when the result is already there
    #[arg(long)]
    pub force: bool,
}

/// Objective of a calibration's search.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum CalibrateObjective {
    /// Predictive log score of the real events on held-out tiles
    Score,
    /// The paper's normalised earth mover's distance
    Emd,
}

/// Arguments of `evrig compare`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    evrig compare sessions/street\n  \
    evrig compare sessions/street --stream aps --json\n  \
    evrig compare dataset --variants twelve      # writes dataset/comparison.html, .csv, .json\n  \
    evrig compare dataset --table paper/table --measures count_ratio,interval_ks --each-session\n\n\
    Over a dataset each measure is the mean over its sessions, with the error of a bootstrap over \
    them.")]
pub struct CompareArgs {
    /// The session, or a dataset: a folder of sessions
    pub session: PathBuf,

    /// The simulated stream [default: every one the session has]
    #[arg(long, value_name = "NAME")]
    pub stream: Option<String>,

    /// The stream to compare with
    #[arg(long, value_name = "NAME", default_value = "real")]
    pub real: String,

    /// A dataset: first generate this list of variants in each session: twelve or davis, or a TOML
    /// file; with --engine slurm each task also updates its session's stages
    #[arg(long, value_name = "LIST", conflicts_with = "stream")]
    pub variants: Option<String>,

    /// A dataset: only the sessions of this rig, named as in dataset.json, or a prefix of it
    #[arg(long, value_name = "NAME")]
    pub rig: Option<String>,

    /// Also write a paper's table: OUT.tex (LaTeX with booktabs) and OUT.csv, with errors and the best
    /// value of each column marked
    #[arg(long, value_name = "OUT")]
    pub table: Option<PathBuf>,

    /// Columns of the table [default: all measures]
    #[arg(long, value_name = "KEY,...", value_delimiter = ',', requires = "table")]
    pub measures: Vec<String>,

    /// Rows of the table for each session of a dataset, before the means
    #[arg(long, requires = "table")]
    pub each_session: bool,

    /// Seed of the resampling behind the errors
    #[arg(long, default_value_t = 0)]
    pub seed: u64,

    /// Run even when the result is already there
    #[arg(long)]
    pub force: bool,

    /// Where the variants of a dataset are generated.
    #[command(flatten)]
    pub engine: super::EngineArgs,
}

/// Arguments of `evrig process`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    evrig process sessions/street\n  \
    evrig process dataset --variants twelve --splits train=0.8,test=0.2 --split-by stimulus\n  \
    evrig process dataset --engine slurm --cpus 8 --time-limit 02:00:00 \
    --sbatch=--partition=long\n  evrig process dataset --status\n\n\
    Runs every stage for which a session has the inputs and states which it left out and why.\n\
    A stage whose inputs did not change is not run again. In a dataset, a folder of sessions, a\n\
    failed session does not stop the others; exit code 3 when something was lost or failed.")]
pub struct ProcessArgs {
    /// The session, or a dataset: a folder of sessions
    pub session: PathBuf,

    /// The generator and its parameters.
    #[command(flatten)]
    pub choice: ModelArgs,

    /// Also generate a list of variants in each session and compare them: twelve or davis, or a
    /// TOML file
    #[arg(long, value_name = "LIST")]
    pub variants: Option<String>,

    /// Run every stage even when its result is already there
    #[arg(long)]
    pub force: bool,

    /// How a dataset is processed.
    #[command(flatten)]
    pub batch: super::BatchArgs,
}
