//! What all events of the sensor show by their mere number and time, beyond the few pixels that are
//! predicted: hot pixels, events that come with the camera's own frames, a bus that is never free.

mod bus;
mod frames;
mod hot;

use super::{Departure, Evidence};
use crate::effect_id::EffectId;

/// What a census shows.
pub(super) fn census(evidence: &Evidence) -> Vec<Departure> {
    let all = [hot::pixels(evidence), frames::coupling(evidence), bus::saturation(evidence)];
    all.into_iter().flatten().collect()
}

/// Whether a census tells an effect that no predicted pixel does, or why not.
pub(super) fn judge(evidence: &Evidence, id: EffectId) -> Result<(), String> {
    match id {
        EffectId::ReadoutSaturation => Ok(()),
        EffectId::ApsCoupling => frames::needs(evidence),
        other => Err(super::scan::absent(other).to_owned()),
    }
}

/// Columns and rows of the sensor.
fn size(evidence: &Evidence) -> [u16; 2] {
    evidence.middle.map(|half| (2.0 * half).round() as u16)
}
