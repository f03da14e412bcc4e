//! Sensor-wide event statistics: hot pixels, coupling to the camera's own frames, bus saturation,
//! row readout, missing isolated events.

mod aps_coupling;
mod bus_saturation;
mod hot_pixels;
mod isolated_events;
mod row_readout;

use crate::diagnose::{Departure, Evidence};
use evrig_core::effect_id::EffectId;

pub(crate) use isolated_events::IsolatedEventDeficit;

/// Findings of the sensor-wide statistics, and the evidence without what they explain.
pub(crate) struct SensorWideStatistics {
    pub(crate) departures: Vec<Departure>,
    /// Without hot pixels; `None` where there are none.
    pub(crate) rest: Option<Evidence>,
    /// Whether the readout determines event times, so that no pixel law can be inferred.
    pub(crate) is_saturated: bool,
    /// Whether isolated events are missing, which no effect of the library explains.
    pub(crate) isolated_events: Option<IsolatedEventDeficit>,
}

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
    // The times reuse the events' memory: a copy of a long recording takes a gigabyte.
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

/// Whether an effect outside the library can be tested by these statistics, or why not.
pub(crate) fn testable(evidence: &Evidence, id: EffectId) -> Result<(), String> {
    match id {
        EffectId::ReadoutSaturation | EffectId::RowReadout => Ok(()),
        EffectId::ApsCoupling => aps_coupling::needs(evidence),
        _ => Err("it is not in the library".to_owned()),
    }
}
