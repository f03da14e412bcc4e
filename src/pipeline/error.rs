//! Why a stage failed.

use evrig_analysis::calibrate::CalibrateError;
use evrig_analysis::compare::CompareError;
use evrig_analysis::diagnose::DiagnoseError;
use evrig_analysis::filter::FilterError;
use evrig_format::aedat4::WriteError;
use evrig_generate::forward::ForwardError;
use evrig_generate::{GenerateError, ParameterError};
use evrig_reconstruct::clock::ClockError;
use evrig_reconstruct::roi::TrackError;
use evrig_reconstruct::scene::{FramesError, SceneError};
use evrig_report::page::PageError;
use evrig_report::plot::pixel_image::PixelImageError;
use evrig_session::{Session, SessionError};
use std::path::PathBuf;

/// Why a stage failed.
#[derive(Debug, thiserror::Error)]
pub enum PipelineError {
    /// The session cannot be read or written.
    #[error(transparent)]
    Session(#[from] SessionError),
    /// A simulator of other software failed.
    #[error("simulator `{stream}`: {what}; its log is {log}{last_lines}", log = log.display())]
    External {
        /// The stream it was to make.
        stream: String,
        /// What is wrong and what to do.
        what: String,
        /// What the command printed.
        log: PathBuf,
        /// The end of it, each line after a line feed.
        last_lines: String,
    },
    /// Frames cannot be turned into events.
    #[error("stream `{stream}` of {session}: {source}", session = session.display())]
    Generate {
        /// The session.
        session: PathBuf,
        /// The frames.
        stream: String,
        /// What is wrong with which frame.
        source: GenerateError,
    },
    /// The clocks cannot be synchronized.
    #[error("the clocks of {session}: {source}", session = session.display())]
    Clock {
        /// The session.
        session: PathBuf,
        /// What is wrong.
        source: ClockError,
    },
    /// The target cannot be reconstructed, or the event camera not registered to it.
    #[error("scene: {0}")]
    Scene(#[from] SceneError),
    /// The tag cannot be tracked.
    #[error("stream `{stream}` of {session}: {source}", session = session.display())]
    Track {
        /// The session.
        session: PathBuf,
        /// The frames.
        stream: String,
        /// What is wrong.
        source: Box<TrackError>,
    },
    /// Events cannot be filtered.
    #[error("stream `{stream}` of {session}: {source}", session = session.display())]
    Filter {
        /// The session.
        session: PathBuf,
        /// The events, or the track behind their region.
        stream: String,
        /// What is wrong.
        source: FilterError,
    },
    /// Effects or frames of a generation cannot be used.
    #[error("stream `{stream}` of {session}: {source}", session = session.display())]
    Forward {
        /// The session.
        session: PathBuf,
        /// The frames.
        stream: String,
        /// What is wrong.
        source: Box<ForwardError>,
    },
    /// Frames cannot be interpolated to a log-intensity signal.
    #[error("stream `{stream}` of {session}: {source}", session = session.display())]
    Frames {
        /// The session.
        session: PathBuf,
        /// The frames.
        stream: String,
        /// What is wrong.
        source: FramesError,
    },
    /// The request itself is wrong: a parameter, a name or a list of variants.
    #[error("{0}")]
    Request(String),
    /// The generator's parameters cannot be used.
    #[error(transparent)]
    Parameters(#[from] ParameterError),
    /// Constants cannot be calibrated on the session.
    #[error("calibrating on {session}: {source}", session = session.display())]
    Calibrate {
        /// The session.
        session: PathBuf,
        /// What is wrong.
        source: CalibrateError,
    },
    /// Events cannot be compared.
    #[error(
        "comparing `{simulated}` with `{real}` in {session}: {source}",
        session = session.display()
    )]
    Compare {
        /// The session.
        session: PathBuf,
        /// The reference stream.
        real: String,
        /// The simulated stream.
        simulated: String,
        /// What is wrong.
        source: CompareError,
    },
    /// A session cannot be diagnosed.
    #[error("diagnosing {session}: {source}", session = session.display())]
    Diagnose {
        /// The session.
        session: PathBuf,
        /// What is missing and what to do.
        source: DiagnoseError,
    },
    /// A stage lacks what it needs.
    #[error("{session}: {what}", session = session.display())]
    Missing {
        /// The session.
        session: PathBuf,
        /// What is missing and what to do.
        what: String,
    },
    /// An image of the report cannot be drawn.
    #[error("the report cannot be drawn: {0}; run the stage `compare` again with --force")]
    Image(#[source] PixelImageError),
    /// The report cannot be set.
    #[error(transparent)]
    Page(#[from] PageError),
    /// A result cannot be written.
    #[error(transparent)]
    Write(#[from] WriteError),
    /// A result is not what its stage wrote.
    #[error(
        "{path}: not what its stage wrote: {source}; run that stage again with --force",
        path = path.display()
    )]
    Damaged {
        /// The result.
        path: PathBuf,
        /// What is wrong with it.
        source: serde_json::Error,
    },
    /// The system returned an error.
    #[error("{path}: {source}", path = path.display())]
    Io {
        /// Where.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
}

pub(super) fn missing(session: &Session, what: String) -> PipelineError {
    PipelineError::Missing { session: session.root().to_owned(), what }
}
