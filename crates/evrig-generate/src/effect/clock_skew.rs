//! Clock skew: the event camera's clock runs fast.
//!
//! Signature: a lag that grows with time and with nothing else.

use super::{EffectModel, ReadoutContext, SignalStage, EffectParameter, parameter};
use evrig_core::event::Events;
use serde::{Deserialize, Serialize};

/// Stamps run ahead in proportion to the time since the start.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ClockSkew {
    /// Microseconds gained a second.
    pub skew_ppm: f64,
}

impl EffectModel for ClockSkew {
    fn enters(&self) -> SignalStage {
        SignalStage::Stamps
    }

    fn equation(&self) -> &'static str {
        "t_stamp = t + skew (t - t_start)"
    }

    fn parameters(&self) -> Vec<EffectParameter> {
        vec![parameter("skew_ppm", self.skew_ppm, -100000.0, 100000.0)]
    }

    fn readout(&self, bench: &ReadoutContext<'_>, events: &mut Events) {
        let start_us = bench.window_us[0];
        bench.change(events, |mut events| {
            for event in &mut events {
                event.t += ((event.t - start_us) as f64 * self.skew_ppm * 1e-6).round() as i64;
            }
            events
        });
    }
}

#[cfg(test)]
mod tests {
    use super::super::trial::*;
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
