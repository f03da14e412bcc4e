//! Stamp jitter: stamps scatter about the instant of the event.
//!
//! Signature: intervals scatter by the same time at every slope, so innovations scatter in
//! proportion to the slope.

use crate::effect::model::{EffectModel, ReadoutContext};
use evrig_core::effect_id::EffectId;
use evrig_core::event::Events;

effect! {
    /// Normal scatter of each stamp.
    StampJitter, Stamps, "t_stamp = t + sigma z, z standard normal" {
        /// Standard deviation, µs.
        sigma_us: 0.0 to 1e5,
    }
}

impl EffectModel for StampJitter {
    fn apply_to_events(&self, camera: &ReadoutContext<'_>, events: &mut Events) {
        camera.change(events, |mut events| {
            for event in &mut events {
                let z = camera.draws(EffectId::StampJitter, *event).normal();
                event.t += (self.sigma_us * z).round() as i64;
            }
            events
        });
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::test_support::*;
    #[test]
    fn even_intervals_scatter_by_the_jitter() {
        let leak = "junction_leak:rate_hz=10";
        let all = events(&still(-1.0), 3.0, &[leak, "stamp_jitter:sigma_us=300"]);
        let (mean, sd) = mean_and_sd(intervals(&all).iter().map(|&gap| gap as f64));
        assert!((mean - 1e5).abs() < 10.0, "{mean}");
        assert!((sd / (300.0 * 2.0_f64.sqrt()) - 1.0).abs() < 0.02, "{sd}");
    }
}
