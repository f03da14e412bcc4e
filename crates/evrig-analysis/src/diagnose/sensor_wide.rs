//! What all events of the sensor show by their mere number and time, beyond the few pixels that are
//! predicted: hot pixels, events that come with the camera's own frames, a bus that is never free, rows that are
//! read in turn, events that a filter took away.

mod aps_coupling;
mod bus_saturation;
mod hot_pixels;
mod isolated_events;
mod row_readout;

use crate::diagnose::{Departure, Evidence};
use evrig_core::effect_id::EffectId;

pub(crate) use isolated_events::IsolatedEventDeficit;

/// What a census shows, and the evidence without what that explains already.
pub(crate) struct SensorWideStatistics {
    pub(crate) departures: Vec<Departure>,
    /// Without the hot pixels, where there are any.
    pub(crate) rest: Option<Evidence>,
    /// Whether the bus decides when events come, so that no pixel's own law can be read off them.
    pub(crate) is_saturated: bool,
    /// Whether events are missing that no neighbour's came before: no effect of the library does that.
    pub(crate) isolated_events: Option<IsolatedEventDeficit>,
}

/// Counts what the whole sensor did.
pub(crate) fn sensor_wide_statistics(evidence: &Evidence) -> SensorWideStatistics {
    let (hot, rest) = match hot_pixels::pixels(evidence) {
        Some((departure, hot)) => {
            let mut rest = evidence.clone();
            rest.pixels.retain(|pixel| !hot.contains(&(pixel.x, pixel.y)));
            (Some(departure), Some(rest))
        }
        None => (None, None),
    };
    let events = evidence.event_context.stamps_in_order();
    let (rows, is_held_up) = row_readout::readout(&events).unzip();
    // The stamps take the events' own memory: of a long recording both would be a gigabyte.
    let times: Vec<i64> = events.into_iter().map(|event| event.0).collect();
    let bus = bus_saturation::saturation(&times);
    let is_saturated = bus.is_some() || is_held_up == Some(true);
    let all = [hot, aps_coupling::coupling(evidence, &times), bus, rows];
    SensorWideStatistics {
        departures: all.into_iter().flatten().collect(),
        rest,
        is_saturated,
        isolated_events: isolated_events::missing(evidence),
    }
}

/// Whether a census tells an effect that no predicted pixel does, or why not.
pub(crate) fn testable(evidence: &Evidence, id: EffectId) -> Result<(), String> {
    match id {
        EffectId::ReadoutSaturation | EffectId::RowReadout => Ok(()),
        EffectId::ApsCoupling => aps_coupling::needs(evidence),
        _ => Err("it has no place in the library".to_owned()),
    }
}
