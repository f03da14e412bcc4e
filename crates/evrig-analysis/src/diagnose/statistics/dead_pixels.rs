//! Pixels without events among active neighbours.

use super::{Departure, Evidence};
use crate::camera_report::pixel_outliers;
use crate::diagnose::levels::SIGNIFICANT_STANDARD_ERRORS;
use evrig_core::effect_id::EffectId;
use evrig_core::event::EventSlice;

/// Share of defective pixels that ordinary sensors have: a datasheet's yield limit is of this order.
const MAX_ORDINARY_FRACTION: f64 = 1e-3;

/// The dead pixels of the sensor, if they are more than ordinary.
pub(super) fn pixels(evidence: &Evidence, events: EventSlice<'_>) -> Option<Departure> {
    let size = evidence.event_context.recording().size();
    let found = pixel_outliers(events, size).known()?.clone();
    let (n, testable) = (found.silent.len() as f64, found.n_testable as f64);
    let fraction = n / testable;
    let error = (fraction * (1.0 - fraction) / testable).sqrt();
    let z = (fraction - MAX_ORDINARY_FRACTION) / error;
    (z > SIGNIFICANT_STANDARD_ERRORS).then(|| Departure {
        id: EffectId::DeadPixels,
        // Those that cannot be judged are as often dead.
        parameters: vec![("count", [fraction, error].map(|v| v * size.n_pixels() as f64))],
        description: format!(
            "{n:.0} pixels have no event although their neighbours have many, {:.2} % of those \
             that can be judged",
            100.0 * fraction
        ),
        z,
        without: None,
    })
}
