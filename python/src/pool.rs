//! The threads of parallel work, made anew in each process.
//!
//! Only the calling thread survives `fork`: in the workers of a PyTorch `DataLoader`, and of
//! `multiprocessing` before Python 3.14, a pool of the parent process would never answer.

use crate::errors::Failure;
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::sync::{Arc, Mutex, PoisonError};

static POOL: Mutex<Option<(u32, Arc<ThreadPool>)>> = Mutex::new(None);

/// Runs work on this process's pool.
pub(crate) fn run<T: Send>(work: impl FnOnce() -> Result<T, Failure> + Send) -> Result<T, Failure> {
    let wrong = |error| Failure::Internal(format!("no threads can be made: {error}"));
    let process = std::process::id();
    let mut known = POOL.lock().unwrap_or_else(PoisonError::into_inner);
    let pool = match &*known {
        Some((of, pool)) if *of == process => Arc::clone(pool),
        _ => {
            let pool = Arc::new(ThreadPoolBuilder::new().build().map_err(wrong)?);
            let of_parent = known.replace((process, Arc::clone(&pool)));
            // Its threads do not exist here, so that nothing is to be ended.
            std::mem::forget(of_parent);
            pool
        }
    };
    drop(known);
    pool.install(work)
}
