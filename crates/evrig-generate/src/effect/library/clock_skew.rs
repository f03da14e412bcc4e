//! Clock skew: the event camera's clock runs fast.
//!
//! Signature: a lag that grows with time and with nothing else.

use crate::effect::model::{EffectModel, ReadoutContext};
use evrig_core::event::Events;

effect! {
    /// Stamps run ahead in proportion to the time since the start.
    ClockSkew, Stamps, "t_stamp = t + skew (t - t_start)" {
        /// Microseconds gained a second.
        skew_ppm: -1e5 to 1e5,
    }
}

impl EffectModel for ClockSkew {
    fn apply_to_events(&self, camera: &ReadoutContext<'_>, events: &mut Events) {
        let start_us = camera.window_us[0];
        camera.change(events, |mut events| {
            for event in &mut events {
                event.t += ((event.t - start_us) as f64 * self.skew_ppm * 1e-6).round() as i64;
            }
            events
        });
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::test_support::*;
    #[test]
    fn the_lag_grows_with_time() {
        let light = passing(4.0, -1.0);
        let (plain, fast) =
            (events(&light, 2.0, &[]), events(&light, 2.0, &["clock_skew:skew_ppm=500"]));
        for (a, b) in plain.iter().zip(&fast) {
            assert!((b.t - a.t - a.t / 2_000).abs() <= 1, "{a:?} {b:?}");
        }
    }
}
