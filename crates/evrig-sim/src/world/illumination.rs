//! The lamps: level, flashes, flicker, and a shadow that wanders over the target.

use super::effects::{Flicker, MovingShadow};
use super::schedule::SettingSchedule;
use std::f64::consts::TAU;

/// A dimmed lamp takes so long to reach its new level.
const DIMMING_S: f64 = 0.02;

/// A flash raises the light by half for 20 ms, with edges of 0.2 ms; ten flashes a second.
const FLASH: Flash = Flash { rise: 0.5, first_s: 0.1, period_s: 0.1, length_s: 0.02, edge_s: 2e-4 };

struct Flash {
    rise: f64,
    first_s: f64,
    period_s: f64,
    length_s: f64,
    edge_s: f64,
}

/// Pieces of a ramp at which the light is looked at.
const PIECES_OF_RAMP: u32 = 10;

/// Light on the target over world time, 1 at the rig's full light.
#[derive(Debug, Clone)]
pub(super) struct Illumination {
    /// Time in seconds and level, straight lines between.
    levels: Vec<[f64; 2]>,
    /// The same for what flashes add, in shares.
    flashes: Vec<[f64; 2]>,
    flicker: Option<Flicker>,
    shadow: Option<MovingShadow>,
}

impl Illumination {
    pub(super) fn new(
        schedule: &SettingSchedule,
        flicker: Option<Flicker>,
        shadow: Option<MovingShadow>,
    ) -> Self {
        let mut levels: Vec<[f64; 2]> = Vec::new();
        let mut flashes: Vec<[f64; 2]> = Vec::new();
        for setting in schedule.settings() {
            let start = setting.start.as_secs_f64();
            let level = setting.light_level;
            let before = levels.last().map_or(level, |[_, level]| *level);
            if levels.is_empty() || before != level {
                // A step shorter than the ramp of the one before cuts that ramp off.
                let begin = levels.last().map_or(start, |[time, _]| time.max(start));
                levels.push([begin, before]);
                levels.push([begin + DIMMING_S, level]);
            }
            for flash in 0..setting.n_flashes {
                let up = start + FLASH.first_s + f64::from(flash) * FLASH.period_s;
                let down = up + FLASH.length_s;
                let edges = [[up, 0.0], [up + FLASH.edge_s, FLASH.rise], [down, FLASH.rise]];
                flashes.extend(edges.into_iter().chain([[down + FLASH.edge_s, 0.0]]));
            }
        }
        flashes.sort_by(|a, b| a[0].total_cmp(&b[0]));
        Self { levels, flashes, flicker, shadow }
    }

    /// Light of the lamps at a time, without the shadow.
    pub(super) fn level(&self, time_s: f64) -> f64 {
        let steady = between(&self.levels, time_s, 1.0);
        let flash = 1.0 + between(&self.flashes, time_s, 0.0);
        let flicker = self.flicker.map_or(1.0, |flicker| {
            1.0 + flicker.depth * (TAU * flicker.frequency_hz * time_s).sin()
        });
        steady * flash * flicker
    }

    /// The lamps' level without flicker, which is what one sets the exposure for.
    #[cfg(test)]
    pub(super) fn set_level(&self, time_s: f64) -> f64 {
        between(&self.levels, time_s, 1.0)
    }

    /// The share of the light that the shadow leaves at a place of the target (millimetres).
    pub(super) fn left_by_shadow(&self, x_mm: f64, y_mm: f64, time_s: f64) -> f64 {
        let Some(shadow) = self.shadow else { return 1.0 };
        let (sin, cos) = shadow.direction_deg.to_radians().sin_cos();
        let way = x_mm * cos + y_mm * sin - shadow.speed_mm_per_s * time_s;
        let half = shadow.period_mm / 2.0;
        let from_middle = (way + half).rem_euclid(shadow.period_mm) - half;
        let z = from_middle / shadow.width_mm;
        1.0 - shadow.depth * (-z * z / 2.0).exp()
    }

    pub(super) fn has_shadow(&self) -> bool {
        self.shadow.is_some_and(|shadow| shadow.depth > 0.0)
    }

    /// How often a second the light must be looked at because of its flicker.
    pub(super) fn rate_hz(&self) -> f64 {
        self.flicker.filter(|flicker| flicker.depth > 0.0).map_or(0.0, |f| 40.0 * f.frequency_hz)
    }

    /// Times strictly within an interval at which the light must be looked at besides: the corners
    /// of its ramps and some places on them.
    pub(super) fn corners(&self, from_s: f64, to_s: f64) -> Vec<f64> {
        let mut corners = Vec::new();
        for line in [&self.levels, &self.flashes] {
            for pair in line.windows(2) {
                let [[begin, low], [end, high]] = [pair[0], pair[1]];
                if end < from_s || begin > to_s || low == high {
                    continue;
                }
                for piece in 0..=PIECES_OF_RAMP {
                    let part = f64::from(piece) / f64::from(PIECES_OF_RAMP);
                    corners.push(begin + part * (end - begin));
                }
            }
        }
        corners.retain(|time| *time > from_s && *time < to_s);
        corners.sort_by(f64::total_cmp);
        corners
    }

    /// Whether nothing about the light changes within an interval.
    pub(super) fn is_steady(&self, from_s: f64, to_s: f64) -> bool {
        let same = self.level(from_s) == self.level(to_s);
        same && !self.has_shadow() && self.rate_hz() == 0.0 && self.corners(from_s, to_s).is_empty()
    }
}

/// The value of a line through points in order of time; `otherwise` where there are none.
fn between(points: &[[f64; 2]], time: f64, otherwise: f64) -> f64 {
    let after = points.partition_point(|[at, _]| *at <= time);
    match (after.checked_sub(1).and_then(|i| points.get(i)), points.get(after)) {
        (Some([t0, v0]), Some([t1, v1])) => v0 + (v1 - v0) * (time - t0) / (t1 - t0),
        (Some([_, value]), None) | (None, Some([_, value])) => *value,
        (None, None) => otherwise,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::schedule::RunSetting;
    use evrig_core::time::Span;

    fn light(flicker: Option<Flicker>) -> Illumination {
        let at = |s| Span::from_secs_f64(s);
        let settings = vec![
            RunSetting { n_flashes: 2, ..RunSetting::nominal(at(0.0), true) },
            RunSetting { light_level: 0.2, ..RunSetting::nominal(at(1.0), true) },
        ];
        Illumination::new(&SettingSchedule::new(settings), flicker, None)
    }

    #[test]
    fn light_is_dimmed_and_flashes_as_scheduled() {
        let light = light(None);
        assert_eq!(light.level(0.05), 1.0);
        assert_eq!(light.level(0.11), 1.5);
        assert_eq!(light.level(0.15), 1.0);
        assert_eq!(light.level(0.21), 1.5);
        assert_eq!(light.level(0.5), 1.0);
        assert!((light.level(1.01) - 0.6).abs() < 1e-9, "half way down");
        assert!((light.level(2.0) - 0.2).abs() < 1e-12);
        assert_eq!(light.set_level(0.11), 1.0);
    }

    #[test]
    fn light_is_steady_between_its_corners_only() {
        let light = light(None);
        assert!(light.is_steady(0.3, 0.9) && light.is_steady(1.1, 5.0));
        assert!(!light.is_steady(0.09, 0.13), "a whole flash lies within");
        assert!(light.corners(0.0999, 0.1003).len() >= 10);
    }

    #[test]
    fn flicker_has_its_depth_about_the_mean() {
        let light = light(Some(Flicker { frequency_hz: 100.0, depth: 0.2 }));
        let levels: Vec<f64> = (0..1000).map(|i| light.level(0.3 + f64::from(i) * 1e-5)).collect();
        let (low, high) =
            levels.iter().fold((9.0_f64, 0.0_f64), |(l, h), v| (l.min(*v), h.max(*v)));
        assert!((low - 0.8).abs() < 1e-3 && (high - 1.2).abs() < 1e-3);
        assert!(!light.is_steady(0.5, 0.51));
    }
}
