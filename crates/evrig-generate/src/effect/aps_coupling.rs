//! APS coupling: the camera's own frames disturb its event pixels.
//!
//! Exposure and readout of the active pixels share supply and photodiode with the event pixels
//! (DAVIS; Brandli et al., JSSC 2014): a burst of events a fixed time after each start of
//! exposure, row by row where the readout is. Signature: event rate locked to the frames' phase.

use super::{EffectModel, ReadoutContext, SignalStage, EffectParameter, RecordingContext, parameter, stream_of};
use evrig_core::effect_id::EffectId;
use evrig_core::event::{Event, Events};
use serde::{Deserialize, Serialize};

/// Events at a fixed time after each start of exposure.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ApsCoupling {
    /// Share of all events that the frames make.
    pub events_fraction: f64,
    /// From the start of exposure, µs.
    pub delay_us: f64,
    /// From row to row, µs; 0 when all rows fire at once.
    pub row_us: f64,
}

impl EffectModel for ApsCoupling {
    fn enters(&self) -> SignalStage {
        SignalStage::Readout
    }

    fn equation(&self) -> &'static str {
        "n extra events at t_start + delay + y T_row in pixels at random, sides at random"
    }

    fn parameters(&self) -> Vec<EffectParameter> {
        vec![
            parameter("events_fraction", self.events_fraction, 0.0, 0.95),
            parameter("delay_us", self.delay_us, -1000000.0, 1000000.0),
            parameter("row_us", self.row_us, -10000.0, 10000.0),
        ]
    }

    fn lacks(&self, surroundings: &RecordingContext) -> Option<&'static str> {
        surroundings.aps_starts_us.is_empty().then_some(
            "the starts of exposure of the event camera's own frames; the recording has none",
        )
    }

    fn readout(&self, bench: &ReadoutContext<'_>, events: &mut Events) {
        let [from, to] = bench.window_us;
        let starts = bench.surroundings.aps_starts_us.iter();
        let starts: Vec<i64> = starts.copied().filter(|t| (from..to).contains(t)).collect();
        let pixels: Vec<(u16, u16)> =
            bench.pixels.iter().copied().filter(|(x, y)| bench.region.contains(*x, *y)).collect();
        if starts.is_empty() || pixels.is_empty() {
            return;
        }
        bench.change(events, |mut all| {
            let n_extra = all.len() as f64 * self.events_fraction / (1.0 - self.events_fraction);
            // A frame's share of them, and the rest that is left by rounding, to the first frames.
            let n_extra = n_extra.round() as usize;
            for (i, start) in starts.iter().enumerate() {
                let n = n_extra / starts.len() + usize::from(i < n_extra % starts.len());
                let mut draws = bench.source.draws(i as u32, stream_of(EffectId::ApsCoupling));
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
    use super::super::RecordingContext;
    use super::super::trial::*;

    #[test]
    fn the_stated_share_of_events_comes_at_the_stated_time_after_each_start() {
        let starts: Vec<i64> = (0..40).map(|i| 10_000 + 25_000 * i).collect();
        let around = RecordingContext { aps_starts_us: starts, ..Surroundings::default() };
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
