//! Speed over time along a path: a trapezoid, as the vendor's firmware drives it.

/// Acceleration, cruise, braking along a length; any unit of length, seconds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct SpeedProfile {
    length: f64,
    entry: f64,
    cruise: f64,
    exit: f64,
    acceleration: f64,
    accelerating_s: f64,
    cruising_s: f64,
    braking_s: f64,
}

impl SpeedProfile {
    /// From rest to rest.
    #[must_use]
    pub(super) fn at_rest(length: f64, speed: f64, acceleration: f64) -> Self {
        Self::between(length, 0.0, speed, 0.0, acceleration)
    }

    /// From one speed to another, not faster than `speed`. A length too short to change
    /// from `entry` to `exit` is driven at a jump of speed.
    #[must_use]
    pub(super) fn between(
        length: f64,
        entry: f64,
        speed: f64,
        exit: f64,
        acceleration: f64,
    ) -> Self {
        // A speed or acceleration of zero would never arrive; the firmware's own floor is unknown.
        let speed = speed.abs().max(1e-3);
        let acceleration = acceleration.abs().max(1e-3);
        let (entry, exit) = (entry.min(speed), exit.min(speed));
        let peak = ((2.0 * acceleration * length + entry * entry + exit * exit) / 2.0).sqrt();
        let cruise = peak.min(speed).max(entry).max(exit);
        let covered = |from: f64| (cruise * cruise - from * from) / (2.0 * acceleration);
        let at_cruise = (length - covered(entry) - covered(exit)).max(0.0);
        Self {
            length,
            entry,
            cruise,
            exit,
            acceleration,
            accelerating_s: (cruise - entry) / acceleration,
            cruising_s: if cruise > 0.0 { at_cruise / cruise } else { 0.0 },
            braking_s: (cruise - exit) / acceleration,
        }
    }

    /// Seconds from start to end.
    #[must_use]
    pub(super) fn duration_s(&self) -> f64 {
        self.accelerating_s + self.cruising_s + self.braking_s
    }

    /// Speed at the end.
    #[must_use]
    pub(super) const fn exit(&self) -> f64 {
        self.exit
    }

    /// Share of the length covered `t_s` seconds after the start, 0..=1.
    #[must_use]
    pub(super) fn fraction(&self, t_s: f64) -> f64 {
        if self.length <= 0.0 || t_s >= self.duration_s() {
            return 1.0;
        }
        let a = self.acceleration;
        let t = t_s.max(0.0);
        let t_up = t.min(self.accelerating_s);
        let t_level = (t - self.accelerating_s).clamp(0.0, self.cruising_s);
        let t_down = (t - self.accelerating_s - self.cruising_s).max(0.0);
        let covered = self.entry * t_up
            + a * t_up * t_up / 2.0
            + self.cruise * t_level
            + self.cruise * t_down
            - a * t_down * t_down / 2.0;
        (covered / self.length).clamp(0.0, 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn the_papers_circle_takes_two_and_a_half_seconds() {
        // 2 pi 12 mm at 50 mm/s and 50 mm/s^2: length / v + v / a.
        let length = std::f64::consts::TAU * 12.0;
        let profile = SpeedProfile::at_rest(length, 50.0, 50.0);
        assert!((profile.duration_s() - (length / 50.0 + 1.0)).abs() < 1e-12);
        assert!((profile.fraction(profile.duration_s() / 2.0) - 0.5).abs() < 1e-12);
    }

    #[test]
    fn a_short_length_never_reaches_the_speed() {
        let profile = SpeedProfile::at_rest(1.0, 50.0, 50.0);
        assert!((profile.duration_s() - 2.0 * (1.0_f64 / 50.0).sqrt()).abs() < 1e-12);
    }

    proptest! {
        #[test]
        fn the_way_is_covered_forwards_without_jumps(
            length in 0.01..500.0_f64, speed in 1.0..300.0_f64, a in 10.0..500.0_f64,
        ) {
            let profile = SpeedProfile::at_rest(length, speed, a);
            let duration = profile.duration_s();
            let mut previous = 0.0;
            for step in 0..=200 {
                let t = duration * f64::from(step) / 200.0;
                let here = profile.fraction(t);
                let most = speed * duration / 200.0 / length;
                prop_assert!(here >= previous - 1e-9 && here - previous <= most + 1e-9);
                previous = here;
            }
            prop_assert!((previous - 1.0).abs() < 1e-9);
        }
    }
}
