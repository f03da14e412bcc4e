//! Clock offset: the event camera's stamps are late against the frame camera's.
//!
//! Signature: a lag that neither speed, light, row nor direction changes.

use super::{EffectModel, ReadoutContext, SignalStage, EffectParameter, parameter};
use evrig_core::event::Events;
use serde::{Deserialize, Serialize};

/// A constant added to every stamp.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ClockOffset {
    /// By how much the stamps are late, µs; negative when early.
    pub offset_us: f64,
}

impl EffectModel for ClockOffset {
    fn enters(&self) -> SignalStage {
        SignalStage::Stamps
    }

    fn equation(&self) -> &'static str {
        "t_stamp = t + offset"
    }

    fn parameters(&self) -> Vec<EffectParameter> {
        vec![parameter("offset_us", self.offset_us, -1000000000.0, 1000000000.0)]
    }

    fn readout(&self, bench: &ReadoutContext<'_>, events: &mut Events) {
        bench.change(events, |mut events| {
            events.iter_mut().for_each(|event| event.t += self.offset_us.round() as i64);
            events
        });
    }
}

#[cfg(test)]
mod tests {
    use super::super::trial::*;
    #[test]
    fn every_stamp_is_late_by_the_offset() {
        let light = passing(4.0, -1.0);
        let (plain, late) =
            (events(&light, 1.0, &[]), events(&light, 1.0, &["clock_offset:offset_us=-1234"]));
        assert!(plain.iter().zip(&late).all(|(a, b)| b.t - a.t == -1234 && a.x == b.x));
        assert_eq!(plain.len(), late.len());
    }
}
