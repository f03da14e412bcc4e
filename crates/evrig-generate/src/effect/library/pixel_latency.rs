//! Pixel latency: from the crossing to the request a while passes.
//!
//! The comparator and the request logic take their time; the pixel is reset only with the request,
//! so what the light does in between is lost (Posch, Matolin, Wohlgenannt, JSSC 2011; Joubert et
//! al., IEBCS, 2021). Signature: events late by a constant, and intervals longer by it, which a
//! clock offset does not do.

use crate::effect::model::EffectModel;
use crate::effect::pixel_site::PixelSite;
use crate::pixel_model::PixelModel;

effect! {
    /// A constant delay of request and reset.
    PixelLatency, Emission, "t = t_crossing + t_latency; the reference is the light at t" {
        /// From the crossing to request and reset, µs.
        latency_us: 0.0 to 1e5,
    }
}

impl EffectModel for PixelLatency {
    fn apply_to_pixel(&self, _site: &PixelSite<'_>, pixel: &mut PixelModel) {
        pixel.latency_us += self.latency_us;
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::test_support::*;
    #[test]
    fn the_first_event_is_late_by_the_latency_and_the_next_by_twice_of_it() {
        let slope = synthetic(|_, t| 10.0 * t - 3.0);
        let all = events(&slope, 0.2, &["pixel_latency:latency_us=3000"]);
        let times: Vec<i64> = all.iter().filter(|e| (e.x, e.y) == (5, 5)).map(|e| e.t).collect();
        assert_eq!(times[..3], [23_000, 46_000, 69_000].map(|t| t + times[0] % 10));
    }
}
