//! Readout saturation: the bus carries so many events a second and no more.
//!
//! One server takes requests in their order, each for 1/max; a stamp is given when it is served,
//! and a pixel that waits cannot ask again, so its further events are lost. With some of the
//! camera's pixels run, the bus serves them their share. Signature: lag that grows with the load of
//! the whole camera; above the limit counts are cut.

use crate::effect::model::{EffectModel, ReadoutContext};
use evrig_core::event::Events;

effect! {
    /// A queue with one server.
    ReadoutSaturation, Readout, "t_out = max(t_request, t_out of the one before) + 1/R; one \
        request a pixel" {
        /// Most events a second of the whole camera.
        max_events_per_s: 1.0 to 1e9,
    }
}

impl EffectModel for ReadoutSaturation {
    fn apply_to_events(&self, camera: &ReadoutContext<'_>, events: &mut Events) {
        let service_us = 1e6 / (self.max_events_per_s * camera.share());
        let mut free_us = f64::MIN;
        let mut busy_until = vec![i64::MIN; camera.size.n_pixels()];
        camera.change(events, |requests| {
            let served = requests.into_iter().filter_map(|mut event| {
                let busy = &mut busy_until[camera.size.index(event.x, event.y)];
                if event.t < *busy {
                    return None;
                }
                free_us = free_us.max(event.t as f64) + service_us;
                event.t = free_us.floor() as i64;
                *busy = event.t;
                Some(event)
            });
            served.collect()
        });
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::test_support::*;
    #[test]
    fn no_second_carries_more_and_a_light_load_passes_untouched() {
        let light = synthetic(|_, t| 2.0 * (std::f64::consts::TAU * t).sin() - 3.0);
        let free = events(&light, 1.0, &[]);
        assert!(free.len() > 80_000);
        let cut = events(&light, 1.0, &["readout_saturation:max_events_per_s=20000"]);
        assert!(cut.windows(2_000).all(|run| run[1_999].t - run[0].t >= 99_900));
        assert!(cut.len() < 24_000 && cut.len() > 15_000, "{}", cut.len());
        let wide = events(&light, 1.0, &["readout_saturation:max_events_per_s=1e9"]);
        assert_eq!(wide.len(), free.len());
    }
}
