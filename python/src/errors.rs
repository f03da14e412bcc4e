//! Failures of the library as the exceptions of `evrig`, with the text that the command line prints.

use evrig::batch::BatchError;
use evrig::calibrate::CalibrateError;
use evrig::commands::error_text;
use evrig::compare::CompareError;
use evrig::generate::effect::EffectError;
use evrig::generate::forward::ForwardError;
use evrig::generate::{GenerateError, ParameterError};
use evrig::pipeline::PipelineError;
use evrig::session::SessionError;
use pyo3::PyErr;
use pyo3::exceptions::PyRuntimeError;

mod raised {
    pyo3::import_exception!(evrig._errors, ArgumentError);
    pyo3::import_exception!(evrig._errors, FileError);
    pyo3::import_exception!(evrig._errors, SessionError);
    pyo3::import_exception!(evrig._errors, AnalysisError);
}

/// Why a call failed.
#[derive(Debug)]
pub(crate) enum Failure {
    /// An argument is wrong.
    Argument(String),
    /// A file cannot be read or written.
    File(String),
    /// A session lacks what is asked of it.
    Session(String),
    /// The data do not allow the analysis.
    Analysis(String),
    /// The library stopped unexpectedly.
    Internal(String),
    /// Python's own: an interrupt, or an exception of a callback.
    Python(PyErr),
}

impl Failure {
    /// A wrong argument: its name, what was expected and what was given.
    pub(crate) fn argument(name: &str, error: &(dyn std::error::Error + 'static)) -> Self {
        Self::Argument(format!("{name}: {}", error_text(error)))
    }

    /// Data that do not allow the analysis.
    pub(crate) fn analysis(error: &(dyn std::error::Error + 'static)) -> Self {
        Self::Analysis(error_text(error))
    }
}

impl From<Failure> for PyErr {
    fn from(failure: Failure) -> Self {
        match failure {
            Failure::Argument(text) => raised::ArgumentError::new_err(text),
            Failure::File(text) => raised::FileError::new_err(text),
            Failure::Session(text) => raised::SessionError::new_err(text),
            Failure::Analysis(text) => raised::AnalysisError::new_err(text),
            Failure::Internal(text) => PyRuntimeError::new_err(text),
            Failure::Python(error) => error,
        }
    }
}

impl From<PyErr> for Failure {
    fn from(error: PyErr) -> Self {
        Self::Python(error)
    }
}

impl From<SessionError> for Failure {
    fn from(error: SessionError) -> Self {
        let text = error_text(&error);
        match error {
            SessionError::BadName { .. } => Self::Argument(text),
            SessionError::NotASession { .. }
            | SessionError::Manifest { .. }
            | SessionError::NoSuchStream { .. }
            | SessionError::OtherClock { .. }
            | SessionError::Busy { .. } => Self::Session(text),
            _ => Self::File(text),
        }
    }
}

impl From<PipelineError> for Failure {
    fn from(error: PipelineError) -> Self {
        let text = error_text(&error);
        match error {
            PipelineError::Session(error) => error.into(),
            PipelineError::Request(_) | PipelineError::Parameters(_) => Self::Argument(text),
            PipelineError::Missing { .. } | PipelineError::Damaged { .. } => Self::Session(text),
            PipelineError::Io { .. } | PipelineError::Write(_) => Self::File(text),
            _ => Self::Analysis(text),
        }
    }
}

impl From<BatchError> for Failure {
    fn from(error: BatchError) -> Self {
        match error {
            BatchError::Pipeline(error) => error.into(),
            error => Self::Session(error_text(&error)),
        }
    }
}

impl From<ParameterError> for Failure {
    fn from(error: ParameterError) -> Self {
        Self::Argument(error_text(&error))
    }
}

impl From<EffectError> for Failure {
    fn from(error: EffectError) -> Self {
        Self::argument("effects", &error)
    }
}

impl From<GenerateError> for Failure {
    fn from(error: GenerateError) -> Self {
        Self::argument("frames", &error)
    }
}

impl From<ForwardError> for Failure {
    fn from(error: ForwardError) -> Self {
        match error {
            ForwardError::Effect(error) => error.into(),
            error => Self::Argument(error_text(&error)),
        }
    }
}

impl From<CompareError> for Failure {
    fn from(error: CompareError) -> Self {
        Self::Argument(error_text(&error))
    }
}

impl From<CalibrateError> for Failure {
    fn from(error: CalibrateError) -> Self {
        Self::analysis(&error)
    }
}
