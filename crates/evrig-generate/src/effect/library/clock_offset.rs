//! Clock offset: the event camera's stamps are late against the frame camera's.
//!
//! Signature: a lag that neither speed, light, row nor direction changes.

use crate::effect::model::{EffectModel, ReadoutContext};
use evrig_core::event::Events;

effect! {
    /// A constant added to every stamp.
    ClockOffset, Stamps, "t_stamp = t + offset" {
        /// By how much the stamps are late, µs; negative when early.
        offset_us: -1e9 to 1e9,
    }
}

impl EffectModel for ClockOffset {
    fn apply_to_events(&self, camera: &ReadoutContext<'_>, events: &mut Events) {
        camera.change(events, |mut events| {
            events.iter_mut().for_each(|event| event.t += self.offset_us.round() as i64);
            events
        });
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::test_support::*;
    #[test]
    fn every_stamp_is_late_by_the_offset() {
        let light = passing(4.0, -1.0);
        let (plain, late) =
            (events(&light, 1.0, &[]), events(&light, 1.0, &["clock_offset:offset_us=-1234"]));
        assert!(plain.iter().zip(&late).all(|(a, b)| b.t - a.t == -1234 && a.x == b.x));
        assert_eq!(plain.len(), late.len());
    }
}
