//! The DAVIS346: events, frames and inertial samples, from a server or a recording.
//!
//! A server is dv-runtime, dv-processing's `NetworkWriter` or [`serve`]: AEDAT4 over TCP, one stream
//! a port, so a source has one address a stream. What arrives is handed on as it came, with
//! the host's time of its arrival; nothing is sorted, cut or corrected here.

mod network;
mod replay;
pub mod serve;
#[cfg(feature = "usb")]
mod usb;

pub use network::{NetworkDavis, Patience};
pub use replay::{Pace, ReplayDavis};
#[cfg(feature = "usb")]
pub use usb::UsbDavis;

use super::recorder::{Outlet, RecorderError, Sample, Tally, host_time};
use crate::format::aedat4::{Content, Stream, StreamSpec};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

/// What threads that read and those that look share.
#[derive(Debug, Default)]
struct Shared {
    is_ending: AtomicBool,
    state: Mutex<State>,
    changed: Condvar,
}

#[derive(Debug, Default)]
struct State {
    tally: Tally,
    failed: Option<RecorderError>,
    n_running: usize,
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, State> {
        // Counters and words: whole between any two statements.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn is_ending(&self) -> bool {
        self.is_ending.load(Ordering::Relaxed)
    }

    fn change(&self, change: impl FnOnce(&mut State)) {
        change(&mut self.lock());
        self.changed.notify_all();
    }

    fn progress(&self) -> Result<Tally, RecorderError> {
        let state = self.lock();
        state.failed.clone().map_or_else(|| Ok(state.tally.clone()), Err)
    }

    /// Waits while `is_waiting` holds, no longer than `patience`.
    fn wait(
        &self,
        patience: Duration,
        is_waiting: impl Fn(&State) -> bool,
    ) -> MutexGuard<'_, State> {
        let waited =
            self.changed.wait_timeout_while(self.lock(), patience, |state| is_waiting(state));
        waited.unwrap_or_else(PoisonError::into_inner).0
    }

    /// Hands a packet on and counts it, or counts it as dropped.
    fn deliver(&self, outlet: &Outlet, stream: u32, content: Content, may_wait: bool) -> bool {
        let sample = Sample::Packet { stream, arrived: host_time(), content };
        let is_taken = if may_wait { outlet.put(sample) } else { outlet.offer(sample) };
        self.change(|state| {
            let tally = &mut state.tally;
            *(if is_taken { &mut tally.n_samples } else { &mut tally.n_dropped }) += 1;
        });
        is_taken
    }
}

/// Runs `work` on a thread of its own that is counted as running until it ends.
fn spawn(
    shared: &Arc<Shared>,
    work: impl FnOnce(&Shared) + Send + 'static,
) -> std::io::Result<JoinHandle<()>> {
    shared.lock().n_running += 1;
    let its = Arc::clone(shared);
    let started = std::thread::Builder::new().name("davis".to_owned()).spawn(move || {
        work(&its);
        its.change(|state| state.n_running -= 1);
    });
    if started.is_err() {
        shared.lock().n_running -= 1;
    }
    started
}

/// The stream as it is written again.
fn spec(stream: &Stream) -> StreamSpec {
    StreamSpec {
        name: stream.name.clone(),
        kind: stream.kind.clone(),
        size: stream.size,
        source: stream.source.clone(),
    }
}

/// The streams, for the manifest.
fn says(source: &str, streams: &[StreamSpec]) -> serde_json::Value {
    let stream = |spec: &StreamSpec| {
        serde_json::json!({
            "name": spec.name, "kind": spec.kind.identifier(), "camera": spec.source,
            "size": spec.size,
        })
    };
    serde_json::json!({"source": source, "streams": streams.iter().map(stream).collect::<Vec<_>>()})
}
