//! The program that child processes are started from.
//!
//! The guard of the arm's port, the tasks of a cluster and the diagnoses of concealed trials are
//! separate processes of the same program. That is this process's own file, unless the library runs
//! inside another program, such as Python.

use std::path::PathBuf;
use std::sync::OnceLock;

static HOSTED: OnceLock<PathBuf> = OnceLock::new();

/// States the program `evrig` for a library inside another program. The first statement holds.
pub fn set_program(path: PathBuf) {
    // A second statement comes from the same installation.
    let _ = HOSTED.set(path);
}

/// Whether the library runs inside another program, which handles signals itself.
#[must_use]
pub fn is_hosted() -> bool {
    HOSTED.get().is_some()
}

/// The program `evrig`.
///
/// # Errors
/// When this process's own file cannot be found.
pub fn program() -> std::io::Result<PathBuf> {
    HOSTED.get().map_or_else(std::env::current_exe, |path| Ok(path.clone()))
}
