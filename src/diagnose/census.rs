//! What all events of the sensor show by their mere number and time, beyond the few pixels that are
//! predicted: hot pixels, events that come with the camera's own frames, a bus that is never free.

mod bus;
mod frames;
mod hot;

use super::{Departure, Evidence};

/// What a census shows.
pub(super) fn census(evidence: &Evidence) -> Vec<Departure> {
    let all = [hot::pixels(evidence), frames::coupling(evidence), bus::saturation(evidence)];
    all.into_iter().flatten().collect()
}

/// Columns and rows of the sensor.
fn size(evidence: &Evidence) -> [u16; 2] {
    evidence.middle.map(|half| (2.0 * half).round() as u16)
}
