//! Pixel latency: from the crossing to the request a while passes.
//!
//! The comparator and the request logic take their time; the pixel is reset only with the request, so
//! what the light does in between is lost (Posch, Matolin, Wohlgenannt, JSSC 2011; Joubert et al.,
//! IEBCS, 2021). Signature: events late by a constant, and intervals longer by it, which a clock
//! offset does not do.

use super::{EffectModel, SignalStage, EffectParameter, PixelModel, PixelSite, parameter};
use serde::{Deserialize, Serialize};

/// A constant delay of request and reset.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PixelLatency {
    /// From the crossing to request and reset, µs.
    pub latency_us: f64,
}

impl EffectModel for PixelLatency {
    fn enters(&self) -> SignalStage {
        SignalStage::Emission
    }

    fn equation(&self) -> &'static str {
        "t = t_crossing + t_latency; the reference is the light at t"
    }

    fn parameters(&self) -> Vec<EffectParameter> {
        vec![parameter("latency_us", self.latency_us, 0.0, 100000.0)]
    }

    fn pixel(&self, _site: &PixelSite<'_>, pixel: &mut PixelModel) {
        pixel.latency_us += self.latency_us;
    }
}

#[cfg(test)]
mod tests {
    use super::super::trial::*;
    #[test]
    fn the_first_event_is_late_by_the_latency_and_the_next_by_twice_of_it() {
        let slope = synthetic(|_, t| 10.0 * t - 3.0);
        let all = events(&slope, 0.2, &["pixel_latency:latency_us=3000"]);
        let times: Vec<i64> = all.iter().filter(|e| (e.x, e.y) == (5, 5)).map(|e| e.t).collect();
        assert_eq!(times[..3], [23_000, 46_000, 69_000].map(|t| t + times[0] % 10));
    }
}
