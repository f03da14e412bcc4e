//! The guard: a small process that owns the arm's port and stops the arm when evrig dies.
//!
//! A Magician runs its queue on when its host falls silent. So the port belongs to a
//! process of its own (the same program, a hidden verb), in a process group of its own,
//! that relays evrig's requests over a pipe. When the pipe closes, however evrig died, or when no
//! heartbeat came for a while, it sends force stop, clears the queue and exits.
//! It never exits without doing so, and nothing else needs to work for it.

mod host;
mod orders;
mod serve;

pub use host::{GuardLink, GuardStop};
pub use orders::{HEARTBEAT, HEARTBEAT_LIMIT};
pub use serve::serve;
