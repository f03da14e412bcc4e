//! Refractory period: after an event a pixel is held at reset.
//!
//! The reset switch of the differencing amplifier stays closed for the refractory time; change of
//! the signal meanwhile is lost, and the new reference level is that of its end (Lichtsteiner,
//! Posch, Delbruck, JSSC 2008). Signature: no interval below it, and steep edges give fewer events.
//!
//! Event filters and some simulators implement another one: the pixel keeps firing and storing its
//! reference level, and events too soon after one that passed are removed.

use crate::effect::model::{
    EffectDescription, EffectModel, EffectParameter, ReadoutContext, SignalStage,
};
use crate::effect::pixel_site::PixelSite;
use crate::pixel_model::PixelModel;
use evrig_core::event::{Events, RefractoryFilter};
use serde::{Deserialize, Serialize};

/// Held at the reset for a fixed time.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RefractoryPeriod {
    /// From an event until the pixel sees light again, µs.
    pub refractory_us: f64,
    /// 1 where the pixel keeps comparing and events are removed behind it, 0 where it is held.
    #[serde(default)]
    pub compares_on: f64,
}

impl RefractoryPeriod {
    fn is_behind_the_pixel(&self) -> bool {
        self.compares_on >= 0.5
    }
}

impl EffectDescription for RefractoryPeriod {
    fn stage(&self) -> SignalStage {
        SignalStage::Memory
    }

    fn equation(&self) -> &'static str {
        if self.is_behind_the_pixel() {
            "an event before t_kept + t_r is taken out; the reference is the light at each event"
        } else {
            "V = 0 and no event until t_event + t_r; the reference is the light at t_event + t_r"
        }
    }

    fn parameters(&self) -> Vec<EffectParameter> {
        let parameter = |key, value, high| EffectParameter { key, value, low: 0.0, high };
        vec![
            parameter("refractory_us", self.refractory_us, 1e6),
            parameter("compares_on", self.compares_on, 1.0),
        ]
    }
}

impl EffectModel for RefractoryPeriod {
    fn apply_to_pixel(&self, _site: &PixelSite<'_>, pixel: &mut PixelModel) {
        if !self.is_behind_the_pixel() {
            pixel.refractory_us += self.refractory_us;
        }
    }

    fn apply_to_events(&self, camera: &ReadoutContext<'_>, events: &mut Events) {
        if !self.is_behind_the_pixel() {
            return;
        }
        let mut dead = RefractoryFilter::new(camera.size, self.refractory_us.round() as i64);
        camera.change(events, |mut events| {
            events.retain(|e| dead.passes(e.t, camera.size.index(e.x, e.y)));
            events
        });
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::test_support::*;
    #[test]
    fn no_interval_is_shorter_and_what_rose_meanwhile_is_lost() {
        let light = passing(8.0, -1.0);
        let free = events(&light, 2.0, &[]);
        let held = events(&light, 2.0, &["refractory_period:refractory_us=4000"]);
        assert!(intervals(&free).iter().any(|&gap| gap < 9_000));
        assert!(intervals(&held).iter().all(|&gap| gap >= 4_000));
        // At the steepest place 125 thresholds a second pass: 8 ms each, and 4 ms are lost.
        let shortest = intervals(&held).into_iter().min().unwrap();
        assert!((11_500..12_700).contains(&shortest), "{shortest}");
        assert!(held.len() < free.len() * 9 / 10);
    }

    #[test]
    fn behind_the_pixel_it_takes_events_out_and_changes_none() {
        let light = passing(8.0, -1.0);
        let free = events(&light, 2.0, &[]);
        let dead = ["refractory_period:refractory_us=12000,compares_on=1"];
        let kept = events(&light, 2.0, &dead);
        assert!(intervals(&kept).iter().all(|&gap| gap >= 12_000));
        let all: std::collections::HashSet<_> = free.iter().collect();
        assert!(kept.iter().all(|event| all.contains(event)));
        assert!(kept.len() < free.len() * 9 / 10 && kept.len() > free.len() / 3);
    }
}
