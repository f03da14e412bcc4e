//! Event drop: events are lost on the way.
//!
//! Each is lost by itself, as on an overrun of a small buffer; the pixel was reset all the same.
//! Signature: innovations at whole numbers, and fewer events by the same share everywhere.

use super::{EffectModel, ReadoutContext, SignalStage, EffectParameter, parameter};
use evrig_core::effect_id::EffectId;
use evrig_core::event::Events;
use serde::{Deserialize, Serialize};

/// Each event is lost with a probability.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EventDrop {
    /// Share of events that is lost.
    pub fraction: f64,
}

impl EffectModel for EventDrop {
    fn enters(&self) -> SignalStage {
        SignalStage::Readout
    }

    fn equation(&self) -> &'static str {
        "each event is lost with probability f"
    }

    fn parameters(&self) -> Vec<EffectParameter> {
        vec![parameter("fraction", self.fraction, 0.0, 1.0)]
    }

    fn readout(&self, bench: &ReadoutContext<'_>, events: &mut Events) {
        bench.change(events, |mut events| {
            events.retain(|event| {
                bench.draws(EffectId::EventDrop, *event).uniform() >= self.fraction
            });
            events
        });
    }
}

#[cfg(test)]
mod tests {
    use super::super::trial::*;
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
