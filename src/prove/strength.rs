//! Strengths of concealed effects: parameters at strength 1 and their growth with strength.
//!
//! Strength 1 is about where an effect begins to matter at the speeds of the simulated rig
//! (20 to 45 pixels a second, a threshold of 0.19), and beyond what every camera has of it (a leak
//! of 0.3 Hz, a background of 0.2 Hz, rows of 9.21 us); a trial draws from 1 to 4. The detection
//! floor is not assumed here: it is what the trials measure.

use std::collections::BTreeMap;

/// How one effect grows with strength.
#[derive(Debug, Clone, Copy)]
pub struct StrengthScale {
    /// The effect's id.
    pub id: &'static str,
    /// The parameter that grows, its value at strength 1, and how.
    key: &'static str,
    at_one: f64,
    growth: Growth,
    /// Parameters that stay.
    fixed: &'static [(&'static str, f64)],
}

#[derive(Debug, Clone, Copy)]
enum Growth {
    /// In proportion to strength.
    Up,
    /// In inverse proportion: a lower cutoff is a stronger effect.
    Down,
    /// The departure from one grows.
    FromOne,
}

impl StrengthScale {
    /// The effect's parameters at a strength.
    #[must_use]
    pub fn parameters(&self, strength: f64) -> BTreeMap<String, f64> {
        let value = match self.growth {
            Growth::Up => self.at_one * strength,
            Growth::Down => self.at_one / strength,
            Growth::FromOne => 1.0 + (self.at_one - 1.0) * strength,
        };
        let fixed = self.fixed.iter().map(|&(key, value)| (key.to_owned(), value));
        fixed.chain([(self.key.to_owned(), value)]).collect()
    }
}

const fn up(id: &'static str, key: &'static str, at_one: f64) -> StrengthScale {
    StrengthScale { id, key, at_one, growth: Growth::Up, fixed: &[] }
}

const fn down(id: &'static str, key: &'static str, at_one: f64) -> StrengthScale {
    StrengthScale { id, key, at_one, growth: Growth::Down, fixed: &[] }
}

const fn from_one(id: &'static str, key: &'static str, at_one: f64) -> StrengthScale {
    StrengthScale { id, key, at_one, growth: Growth::FromOne, fixed: &[] }
}

impl StrengthScale {
    const fn with(mut self, fixed: &'static [(&'static str, f64)]) -> Self {
        self.fixed = fixed;
        self
    }
}

/// Effects of the simulated world that the library knows.
const WORLD: &[StrengthScale] = &[
    down("photoreceptor_bandwidth", "cutoff_hz_at_white", 60.0).with(&[("order", 1.0)]),
    down("fixed_pole", "cutoff_hz", 40.0),
    up("refractory_period", "refractory_us", 1_500.0),
    up("threshold_mismatch", "sigma_relative", 0.05),
    from_one("threshold_asymmetry", "on_off_ratio", 1.06),
    up("junction_leak", "rate_hz", 0.4),
    up("photocurrent_leak", "rate_hz_at_white", 0.5),
    up("shot_noise", "rms_thresholds", 0.12).with(&[("bandwidth_hz", 300.0)]),
    up("background_activity", "rate_hz", 0.5),
    up("hot_pixels", "fraction", 0.001),
    up("adaptation", "fraction", 0.1).with(&[("time_constant_s", 0.3)]),
    up("dark_current", "fraction_of_white", 0.02),
    down("readout_saturation", "max_events_per_s", 200_000.0),
    up("row_readout", "row_us", 5.0),
    up("event_drop", "fraction", 0.05),
    up("stamp_jitter", "sigma_us", 700.0),
    up("aps_coupling", "events_fraction", 0.004).with(&[("delay_us", 300.0), ("row_us", 0.0)]),
    up("clock_offset", "offset_us", 1_500.0),
    up("clock_skew", "skew_ppm", 600.0),
    up("rolling_shutter", "row_us", 12.0),
    up("black_level", "offset_dn", 12.0),
    from_one("tone_curve", "gamma", 0.92),
    up("frame_noise", "sigma_dn", 1.5),
    up("defocus", "sigma_px", 0.5),
    up("vignetting", "corner_loss", 0.1),
    up("moving_shadow", "depth", 0.05),
    up("flicker", "depth", 0.02).with(&[("frequency_hz", 100.0)]),
    up("vibration", "amplitude_mm", 0.06).with(&[("frequency_hz", 12.0)]),
];

/// Effects of the simulated world that no library names.
const OUTSIDE_LIBRARY: &[StrengthScale] = &[
    down("support_filter", "window_us", 20_000.0),
    down("slew_limit", "per_s", 12.0),
    up("threshold_fatigue", "rise", 0.15).with(&[("recovery_s", 0.2)]),
];

/// Effects that can be applied to a recording that is there. They are far stronger than in the
/// world: the recording at hand has one or two events in a pixel and a frame every 40 ms.
const PLASMODE: &[StrengthScale] = &[
    up("refractory_period", "refractory_us", 20_000.0),
    up("event_drop", "fraction", 0.2),
    up("dead_pixels", "count", 9_000.0),
    up("hot_pixels", "fraction", 0.005).with(&[("rate_hz", 40.0)]),
    up("background_activity", "rate_hz", 0.3),
    up("shot_noise", "rate_hz", 0.3).with(&[("lag_us", 3_000.0)]),
    up("stamp_jitter", "sigma_us", 10_000.0),
    up("clock_offset", "offset_us", 15_000.0),
    up("clock_skew", "skew_ppm", 10_000.0),
    up("black_level", "offset_dn", 12.0),
    from_one("tone_curve", "gamma", 0.85),
    up("defocus", "sigma_px", 1.0),
];

/// Effects that can be applied to a recording and that no library names.
const PLASMODE_OUTSIDE_LIBRARY: &[StrengthScale] =
    &[up("burst_loss", "share", 0.15).with(&[("window_us", 30_000.0)])];

/// The table of a family: effects the library knows, then those it does not.
#[must_use]
pub fn strengths(
    family: super::truth::Family,
) -> (&'static [StrengthScale], &'static [StrengthScale]) {
    match family {
        super::truth::Family::World => (WORLD, OUTSIDE_LIBRARY),
        super::truth::Family::Plasmode => (PLASMODE, PLASMODE_OUTSIDE_LIBRARY),
        super::truth::Family::ThirdParty => (&[], &[]),
    }
}

#[cfg(test)]
mod tests {
    use super::super::{ConcealedEffect, Family};
    use super::*;
    use evrig_core::effect_id::EffectId;
    use evrig_sim::world::WorldDescription;

    #[test]
    fn the_library_knows_the_one_table_and_not_the_other() {
        for family in [Family::World, Family::Plasmode] {
            let (known, alien) = strengths(family);
            for entry in known {
                let effect: EffectId = entry.id.parse().unwrap();
                assert_eq!(effect.as_str(), entry.id);
            }
            assert!(alien.iter().all(|entry| entry.id.parse::<EffectId>().is_err()));
        }
    }

    #[test]
    fn every_known_parameter_of_the_world_is_one_of_its_effect() {
        for entry in WORLD {
            let effect: EffectId = entry.id.parse().unwrap();
            for key in entry.parameters(1.0).keys() {
                assert!(effect.parameters().contains(&key.as_str()), "{}: {key}", entry.id);
            }
        }
    }

    #[test]
    fn the_world_takes_every_entry_of_its_table() {
        for entry in WORLD.iter().chain(OUTSIDE_LIBRARY) {
            let parameters = entry.parameters(2.0);
            let concealed = ConcealedEffect { id: entry.id.into(), parameters, strength: 2.0 };
            let effects = serde_json::json!({ entry.id: concealed.description() });
            let description = serde_json::json!({ "effects": effects });
            let parsed = serde_json::from_value::<WorldDescription>(description);
            assert!(parsed.is_ok(), "{}: {:?}", entry.id, parsed.err());
        }
    }

    #[test]
    fn strength_moves_a_parameter_the_way_its_effect_grows() {
        let of = |id: &str, s| WORLD.iter().find(|e| e.id == id).unwrap().parameters(s);
        assert_eq!(of("refractory_period", 2.0)["refractory_us"], 3_000.0);
        assert_eq!(of("fixed_pole", 2.0)["cutoff_hz"], 20.0);
        assert!((of("threshold_asymmetry", 2.0)["on_off_ratio"] - 1.12).abs() < 1e-12);
        assert_eq!(of("fixed_pole", 1.0).len(), 1);
    }
}
