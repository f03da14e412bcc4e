//! Readings of all clocks at a world time.

use super::description::WorldClocksDescription;
use super::effects::{ClockOffset, ClockSkew};
use evrig_core::time::{Davis, PiSensor, Span, Stamp, Unix};

/// The clocks of the world.
#[derive(Debug, Clone)]
pub struct WorldClocks {
    description: WorldClocksDescription,
    davis_offset_us: f64,
    davis_skew: f64,
}

impl WorldClocks {
    pub(super) fn new(
        description: &WorldClocksDescription,
        offset: Option<ClockOffset>,
        skew: Option<ClockSkew>,
    ) -> Self {
        Self {
            description: description.clone(),
            davis_offset_us: offset.map_or(0.0, |offset| offset.offset_us),
            davis_skew: skew.map_or(0.0, |skew| skew.skew_ppm * 1e-6),
        }
    }

    /// True Unix time, which the host shows.
    #[must_use]
    pub fn unix(&self, time: Span) -> Stamp<Unix> {
        Stamp::from_micros(self.description.unix_start_us) + time
    }

    /// The DAVIS's stamp, as its recorder would write it; not yet cut to microseconds.
    #[must_use]
    pub fn davis(&self, time: Span) -> Stamp<Davis> {
        let wrong = self.davis_offset_us * 1e3 + self.davis_skew * time.as_nanos() as f64;
        let shown = time + Span::from_nanos(wrong.round() as i64);
        Stamp::from_micros(self.description.unix_start_us) + shown
    }

    /// The Pi's SensorTimestamp clock, in whole microseconds as V4L2 hands it on.
    #[must_use]
    pub fn pi_sensor(&self, time: Span) -> Stamp<PiSensor> {
        Stamp::from_micros(self.pi_boot(time).as_micros())
    }

    /// The same clock as a program on the Pi reads it, to the nanosecond.
    #[must_use]
    pub fn pi_boot(&self, time: Span) -> Stamp<PiSensor> {
        Stamp::from_nanos(self.description.pi_boot_ns) + self.ran_on_pi(time)
    }

    /// The Pi's wall clock.
    #[must_use]
    pub fn pi_wall(&self, time: Span) -> Stamp<Unix> {
        let steps = self.description.pi_wall_steps.iter();
        let taken = steps.filter(|[at_s, _]| *at_s <= time.as_secs_f64());
        let stepped: f64 = taken.map(|[_, by_us]| by_us).sum();
        let ahead_us = self.description.pi_wall_offset_us + stepped;
        let start = Stamp::<Unix>::from_micros(self.description.unix_start_us);
        start + self.ran_on_pi(time) + Span::from_nanos((ahead_us * 1e3).round() as i64)
    }

    fn ran_on_pi(&self, time: Span) -> Span {
        let gained = time.as_nanos() as f64 * self.description.pi_skew_ppm * 1e-6;
        time + Span::from_nanos(gained.round() as i64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_clock_shows_its_own_time() {
        let description = WorldClocksDescription {
            unix_start_us: 1_000_000,
            pi_boot_ns: 5_000,
            pi_skew_ppm: 10.0,
            pi_wall_offset_us: 300.0,
            pi_wall_steps: vec![[2.0, -1000.0]],
        };
        let offset = Some(ClockOffset { offset_us: 250.0 });
        let clocks = WorldClocks::new(&description, offset, Some(ClockSkew { skew_ppm: 50.0 }));
        let second = Span::from_secs_f64(1.0);
        assert_eq!(clocks.unix(second).as_micros(), 2_000_000);
        assert_eq!(clocks.davis(second).as_micros(), 2_000_300);
        assert_eq!(clocks.pi_sensor(second).as_nanos(), 1_000_015_000);
        assert_eq!(clocks.pi_wall(second).as_micros(), 2_000_310);
        assert_eq!(clocks.pi_wall(second + second).as_micros(), 3_000_320 - 1000);
    }
}
