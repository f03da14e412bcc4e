//! What the cameras of a session saw, and when: clock maps, the target's track, and the
//! log-intensity signal of each event pixel.

pub mod clock;
pub mod roi;
pub mod scene;
