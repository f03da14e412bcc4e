//! `guard`: owns the arm's port for the evrig process at the other end of the pipe.

use super::{Ending, Output};
use crate::cli::GuardArgs;
use crate::drivers::serve_guard;
use evrig_record::GuardEnd;
use signal_hook::consts::{SIGHUP, SIGINT, SIGQUIT, SIGTERM};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

pub(super) fn guard(args: &GuardArgs, output: &Output) -> anyhow::Result<Ending> {
    // A signal does not end the guard: it stops the arm and stays until evrig is gone.
    let is_signalled = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM, SIGHUP, SIGQUIT] {
        signal_hook::flag::register(signal, Arc::clone(&is_signalled))?;
    }
    match serve_guard(&args.port, &is_signalled) {
        GuardEnd::NotBegun(_) => Ok(Ending::Failed),
        GuardEnd::HostGone => Ok(Ending::Done),
        GuardEnd::HeartbeatLate => {
            output.warn("evrig hangs or was suspended: the arm was stopped");
            Ok(Ending::Failed)
        }
    }
}
