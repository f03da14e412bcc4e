//! Event drop: events are lost on the way.
//!
//! Each is lost by itself, as on an overrun of a small buffer; the pixel was reset all the same.
//! Signature: innovations at whole numbers, and fewer events by the same share everywhere.

use crate::effect::model::{EffectModel, ReadoutContext};
use evrig_core::effect_id::EffectId;
use evrig_core::event::Events;

effect! {
    /// Each event is lost with a probability.
    EventDrop, Readout, "each event is lost with probability f" {
        /// Share of events that is lost.
        fraction: 0.0 to 1.0,
    }
}

impl EffectModel for EventDrop {
    fn apply_to_events(&self, camera: &ReadoutContext<'_>, events: &mut Events) {
        camera.change(events, |mut events| {
            events.retain(|event| {
                camera.draws(EffectId::EventDrop, *event).uniform() >= self.fraction
            });
            events
        });
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::test_support::*;
    #[test]
    fn the_stated_share_is_lost_and_what_is_left_is_as_it_was() {
        let light = passing(4.0, -1.0);
        let all = events(&light, 1.0, &[]);
        let kept = events(&light, 1.0, &["event_drop:fraction=0.3"]);
        let share = kept.len() as f64 / all.len() as f64;
        assert!((share - 0.7).abs() < 4.0 * (0.21 / all.len() as f64).sqrt(), "{share}");
        let all: std::collections::HashSet<_> = all.into_iter().collect();
        assert!(kept.iter().all(|event| all.contains(event)));
    }
}
