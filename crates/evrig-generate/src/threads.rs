//! Where the blocks of a frame are worked on.

use crate::parameter_error::ParameterError;
use rayon::prelude::*;
use std::num::NonZeroUsize;

/// The threads of a generator.
#[derive(Debug)]
pub(super) enum Threads {
    /// The caller's own thread.
    One,
    /// Rayon's pool for the whole program.
    Common,
    /// A pool of this generator's own.
    Own(rayon::ThreadPool),
}

impl Threads {
    /// As many threads as asked for, or the program's common pool.
    pub(super) fn new(threads: Option<NonZeroUsize>) -> Result<Self, ParameterError> {
        match threads.map(NonZeroUsize::get) {
            None => Ok(Self::Common),
            Some(1) => Ok(Self::One),
            Some(threads) => rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .map(Self::Own)
                .map_err(|error| ParameterError::Threads { threads, reason: error.to_string() }),
        }
    }

    /// Works on every block, in any order.
    pub(super) fn for_each<B: Send>(&self, blocks: Vec<B>, work: impl Fn(B) + Send + Sync) {
        match self {
            Self::One => blocks.into_iter().for_each(work),
            Self::Common => blocks.into_par_iter().for_each(work),
            Self::Own(pool) => pool.install(|| blocks.into_par_iter().for_each(work)),
        }
    }
}
