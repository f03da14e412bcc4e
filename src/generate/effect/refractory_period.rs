//! Refractory period: after the reset a pixel is held at it and sees nothing.
//!
//! The reset switch of the differencing amplifier stays closed for the refractory time; what the
//! light did meanwhile is lost, and the reference is that of its end (Lichtsteiner, Posch,
//! Delbruck, JSSC 2008). Signature: no interval below it, and steep edges give fewer events.

use super::{Acts, Enters, Parameter, PixelModel, Site, parameter};
use serde::{Deserialize, Serialize};

/// Held at the reset for a fixed time.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RefractoryPeriod {
    /// From an event until the pixel sees light again, µs.
    pub refractory_us: f64,
}

impl Acts for RefractoryPeriod {
    fn enters(&self) -> Enters {
        Enters::Memory
    }

    fn equation(&self) -> &'static str {
        "V = 0 and no event until t_event + t_r; the reference is the light at t_event + t_r"
    }

    fn parameters(&self) -> Vec<Parameter> {
        vec![parameter("refractory_us", self.refractory_us, 0.0, 1000000.0)]
    }

fn pixel(&self, _site: &Site<'_>, pixel: &mut PixelModel) {
        pixel.refractory_us += self.refractory_us;
    }
}

#[cfg(test)]
mod tests {
    use super::super::trial::*;
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
}
