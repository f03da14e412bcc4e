//! What the event pixels looked at: the light signal of a session.
//!
//! [`FramesDrive`] takes it from the event camera's own pixel grid, frame by frame, where
//! nothing else is known of the scene.

mod frames;

pub use frames::{FramesDrive, FramesError};
