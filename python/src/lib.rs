//! The extension module `evrig._evrig`: the library for the Python package `evrig`.
//!
//! The Python layer in `python/evrig` checks arguments, gives results their types and holds the
//! documentation. Event columns are handed over without copies; long work runs without Python's
//! lock.

mod arrays;
mod effects;
mod errors;
mod frame_reader;
mod generator;
mod pool;
mod session;
mod stages;
mod streams;
mod task;

use pyo3::prelude::*;
use std::ffi::OsString;
use std::path::PathBuf;

/// Runs a command line, whose first word is the program, and gives its exit code.
#[pyfunction]
fn run_command(py: Python<'_>, arguments: Vec<OsString>) -> u8 {
    py.detach(|| evrig::commands::run_arguments(arguments))
}

/// States the file that child processes are started from.
#[pyfunction]
fn set_program(path: PathBuf) {
    evrig::program::set_program(path);
}

#[pymodule]
fn _evrig(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add_class::<generator::FrameGenerator>()?;
    module.add_class::<session::SessionHandle>()?;
    module.add_class::<frame_reader::FrameReader>()?;
    module.add_function(wrap_pyfunction!(run_command, module)?)?;
    module.add_function(wrap_pyfunction!(set_program, module)?)?;
    module.add_function(wrap_pyfunction!(generator::generate, module)?)?;
    module.add_function(wrap_pyfunction!(effects::simulate_effects, module)?)?;
    module.add_function(wrap_pyfunction!(effects::effect_library, module)?)?;
    module.add_function(wrap_pyfunction!(streams::read_events, module)?)?;
    module.add_function(wrap_pyfunction!(streams::camera_report, module)?)?;
    module.add_function(wrap_pyfunction!(streams::compare_events, module)?)?;
    module.add_function(wrap_pyfunction!(streams::check_events, module)?)?;
    module.add_function(wrap_pyfunction!(streams::sorted_events, module)?)?;
    module.add_function(wrap_pyfunction!(session::import_session, module)?)?;
    Ok(())
}
