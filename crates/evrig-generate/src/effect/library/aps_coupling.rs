//! APS coupling: the camera's own frames disturb its event pixels.
//!
//! Exposure and readout of the active pixels share supply and photodiode with the event pixels
//! (DAVIS; Brandli et al., JSSC 2014): a burst of events a fixed time after each start of
//! exposure, row by row where the readout is. Signature: event rate locked to the frames' phase.

use crate::effect::model::{EffectModel, ReadoutContext};
use crate::effect::pixel_site::{RecordingContext, stream_of};
use evrig_core::effect_id::EffectId;
use evrig_core::event::{Event, Events};

effect! {
    /// Events at a fixed time after each start of exposure.
    ApsCoupling, Readout, "n extra events at t_start + delay + y T_row in pixels at random, sides \
        at random" {
        /// Share of all events that the frames make.
        events_fraction: 0.0 to 0.95,
        /// From the start of exposure, µs.
        delay_us: -1e6 to 1e6,
        /// From row to row, µs; 0 when all rows fire at once.
        row_us: -1e4 to 1e4,
    }
}

impl EffectModel for ApsCoupling {
    fn missing_input(&self, context: &RecordingContext) -> Option<&'static str> {
        context.aps_starts_us.is_empty().then_some(
            "the starts of exposure of the event camera's own frames; the recording has none",
        )
    }

    fn apply_to_events(&self, camera: &ReadoutContext<'_>, events: &mut Events) {
        let [from, to] = camera.window_us;
        let starts = camera.context.aps_starts_us.iter();
        let starts: Vec<i64> = starts.copied().filter(|t| (from..to).contains(t)).collect();
        let pixels: Vec<(u16, u16)> =
            camera.pixels.iter().copied().filter(|(x, y)| camera.region.contains(*x, *y)).collect();
        if starts.is_empty() || pixels.is_empty() {
            return;
        }
        camera.change(events, |mut all| {
            let n_extra = all.len() as f64 * self.events_fraction / (1.0 - self.events_fraction);
            // A frame's share of them, and the rest that is left by rounding, to the first frames.
            let n_extra = n_extra.round() as usize;
            for (i, start) in starts.iter().enumerate() {
                let n = n_extra / starts.len() + usize::from(i < n_extra % starts.len());
                let mut draws = camera.source.draws(i as u32, stream_of(EffectId::ApsCoupling));
                for _ in 0..n {
                    let (x, y) = pixels[(draws.uniform() * pixels.len() as f64) as usize];
                    let late = self.delay_us + f64::from(y) * self.row_us;
                    let on = draws.uniform() < 0.5;
                    all.push(Event { t: start + late.round() as i64, x, y, on });
                }
            }
            all
        });
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::pixel_site::RecordingContext;
    use crate::effect::test_support::*;

    #[test]
    fn the_stated_share_of_events_comes_at_the_stated_time_after_each_start() {
        let starts: Vec<i64> = (0..40).map(|i| 10_000 + 25_000 * i).collect();
        let around = RecordingContext { aps_starts_us: starts, ..RecordingContext::default() };
        let light = passing(4.0, -1.0);
        let n_plain = events(&light, 1.0, &[]).len();
        let words = ["aps_coupling:events_fraction=0.2,delay_us=500,row_us=10"];
        let all = events_in(&light, 1.0, &words, around);
        let n_extra = (all.len() - n_plain) as f64;
        assert!((n_extra / all.len() as f64 - 0.2).abs() < 1e-3);
        let locked = all.iter().filter(|e| (e.t - 10_000) % 25_000 == 500 + 10 * i64::from(e.y));
        assert!(locked.count() as f64 >= n_extra);
    }
}
