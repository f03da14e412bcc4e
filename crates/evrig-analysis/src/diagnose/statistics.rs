//! Sensor-wide event statistics: hot pixels, coupling to the camera's own frames, bus saturation,
//! row readout, missing isolated events.

mod aps_coupling;
mod bus_saturation;
mod dead_pixels;
mod hot_pixels;
mod isolated_events;
mod row_readout;

use crate::diagnose::evidence::frame_bursts::FrameBursts;
use crate::diagnose::{Departure, Evidence};
use evrig_core::effect_id::EffectId;
use std::borrow::Cow;

pub(crate) use isolated_events::IsolatedEventDeficit;

/// Findings of the sensor-wide statistics, and the evidence without what they explain.
pub(crate) struct SensorWideStatistics<'a> {
    pub(crate) departures: Vec<Departure>,
    /// Without hot pixels, and with the bursts that follow frames.
    pub(crate) evidence: Cow<'a, Evidence>,
    /// Whether the readout determines event times, so that no pixel law can be inferred.
    pub(crate) is_saturated: bool,
    /// Whether isolated events are missing, which no effect of the library explains.
    pub(crate) isolated_events: Option<IsolatedEventDeficit>,
}

pub(crate) fn sensor_wide_statistics(evidence: &Evidence) -> SensorWideStatistics<'_> {
    let mut rest = Cow::Borrowed(evidence);
    let hot = hot_pixels::pixels(evidence).map(|(departure, hot)| {
        rest.to_mut().pixels.retain(|pixel| !hot.contains(&(pixel.x, pixel.y)));
        departure
    });
    let events = evidence.event_context.in_order();
    let (rows, is_held_up) = row_readout::readout(events.as_slice()).unzip();
    let bus = bus_saturation::saturation(events.as_slice().t);
    let is_saturated = bus.is_some() || is_held_up == Some(true);
    let bursts = aps_coupling::bursts(evidence, events.as_slice());
    let dead = dead_pixels::pixels(evidence, events.as_slice());
    let coupling = bursts.as_ref().map(FrameBursts::departure);
    if let Some(bursts) = bursts {
        rest = Cow::Owned(rest.into_owned().with_bursts(bursts));
    }
    SensorWideStatistics {
        departures: [hot, dead, coupling, bus, rows].into_iter().flatten().collect(),
        evidence: rest,
        is_saturated,
        isolated_events: isolated_events::missing(evidence),
    }
}

/// Whether an effect is found by these statistics.
pub(crate) fn is_statistic(id: EffectId) -> bool {
    use EffectId::{ApsCoupling, DeadPixels, HotPixels, ReadoutSaturation, RowReadout};
    matches!(id, ApsCoupling | DeadPixels | HotPixels | ReadoutSaturation | RowReadout)
}

/// Whether an effect can be tested by these statistics, or why not.
pub(crate) fn testable(evidence: &Evidence, id: EffectId) -> Result<(), String> {
    if id == EffectId::ApsCoupling { aps_coupling::needs(evidence) } else { Ok(()) }
}
