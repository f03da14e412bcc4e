//! Trapezoidal speed profile of the arm's planner.

use evrig_core::time::Span;

/// Rest to rest over a distance: constant acceleration, constant speed, constant deceleration.
///
/// The distance's unit is the caller's (millimetres along a path, degrees of a
/// wrist). A distance too short to reach the speed gives a triangle. This is
/// the profile the vendor's own firmware sources show: symmetric, no jerk limit,
/// each command from rest to rest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Trapezoid {
    distance: f64,
    peak: f64,
    ramp_s: f64,
    cruise_s: f64,
}

impl Trapezoid {
    /// The fastest profile over `distance` (>= 0) within `speed` and `acceleration` (both > 0).
    #[must_use]
    pub fn new(distance: f64, speed: f64, acceleration: f64) -> Self {
        let distance = distance.max(0.0);
        let peak = speed.min((distance * acceleration).sqrt());
        if peak <= 0.0 {
            return Self { distance, peak: 0.0, ramp_s: 0.0, cruise_s: 0.0 };
        }
        let ramp_s = peak / acceleration;
        Self { distance, peak, ramp_s, cruise_s: (distance / peak - ramp_s).max(0.0) }
    }

    /// The same shape stretched to last `seconds` (longer than it does now), so that two axes end
    /// together.
    #[must_use]
    pub fn stretched_to(self, seconds: f64) -> Self {
        let own = self.seconds();
        if own <= 0.0 || seconds <= own {
            return self;
        }
        let factor = seconds / own;
        Self {
            peak: self.peak / factor,
            ramp_s: self.ramp_s * factor,
            cruise_s: self.cruise_s * factor,
            ..self
        }
    }

    /// How long it takes.
    #[must_use]
    pub fn duration(&self) -> Span {
        Span::from_secs_f64(self.seconds())
    }

    /// How long it takes, in seconds.
    #[must_use]
    pub fn seconds(&self) -> f64 {
        2.0 * self.ramp_s + self.cruise_s
    }

    /// The whole distance.
    #[must_use]
    pub fn distance(&self) -> f64 {
        self.distance
    }

    /// The highest speed, in units of distance per second.
    #[must_use]
    pub fn peak_speed(&self) -> f64 {
        self.peak
    }

    /// The acceleration of the ramps, in units of distance per second squared; zero for a
    /// standstill.
    #[must_use]
    pub fn acceleration(&self) -> f64 {
        if self.ramp_s > 0.0 { self.peak / self.ramp_s } else { 0.0 }
    }

    /// Seconds at constant speed.
    #[must_use]
    pub fn cruise_seconds(&self) -> f64 {
        self.cruise_s
    }

    /// Distance done after `seconds`; held at both ends.
    #[must_use]
    pub fn distance_at(&self, seconds: f64) -> f64 {
        let total = self.seconds();
        if seconds <= 0.0 || total <= 0.0 {
            0.0
        } else if seconds >= total {
            self.distance
        } else if seconds < self.ramp_s {
            0.5 * self.acceleration() * seconds * seconds
        } else if seconds <= total - self.ramp_s {
            self.peak * (seconds - 0.5 * self.ramp_s)
        } else {
            let left = total - seconds;
            self.distance - 0.5 * self.acceleration() * left * left
        }
    }

    /// Speed after `seconds`; zero outside.
    #[must_use]
    pub fn speed_at(&self, seconds: f64) -> f64 {
        let left = self.seconds() - seconds;
        if seconds <= 0.0 || left <= 0.0 {
            return 0.0;
        }
        (self.acceleration() * seconds.min(left)).min(self.peak)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn the_papers_circle_takes_two_and_a_half_seconds() {
        let circle = Trapezoid::new(std::f64::consts::TAU * 12.0, 50.0, 50.0);
        let closed_form = std::f64::consts::TAU * 12.0 / 50.0 + 50.0 / 50.0;
        assert!((circle.seconds() - closed_form).abs() < 1e-12);
        assert!((circle.seconds() - 2.508).abs() < 5e-4);
        assert!((circle.cruise_seconds() - 0.508).abs() < 5e-4);
    }

    #[test]
    fn a_short_way_is_a_triangle_below_the_speed() {
        let short = Trapezoid::new(1.0, 50.0, 100.0);
        assert!((short.peak_speed() - 10.0).abs() < 1e-12);
        assert!((short.seconds() - 0.2).abs() < 1e-12);
    }

    #[test]
    fn no_way_takes_no_time() {
        let none = Trapezoid::new(0.0, 50.0, 50.0);
        assert_eq!(none.duration(), Span::ZERO);
        assert!(none.distance_at(1.0).abs() < 1e-12 && none.speed_at(1.0).abs() < 1e-12);
    }

    proptest! {
        #[test]
        fn the_speed_is_the_slope_of_the_distance_and_stays_within_both_limits(
            distance in 0.1..500.0_f64, speed in 1.0..300.0_f64, acceleration in 1.0..500.0_f64,
            part in 0.0..1.0_f64, stretch in 1.0..4.0_f64,
        ) {
            let fastest = Trapezoid::new(distance, speed, acceleration);
            let profile = fastest.stretched_to(fastest.seconds() * stretch);
            prop_assert!(profile.peak_speed() <= speed * (1.0 + 1e-9));
            prop_assert!(profile.acceleration() <= acceleration * (1.0 + 1e-9));
            prop_assert!((profile.distance_at(profile.seconds()) - distance).abs() < 1e-9);
            let (t, dt) = (part * profile.seconds(), 1e-6 * profile.seconds());
            let slope = (profile.distance_at(t + dt) - profile.distance_at(t)) / dt;
            let bound = profile.acceleration() * dt + 1e-4 * profile.peak_speed();
            prop_assert!((slope - profile.speed_at(t)).abs() <= bound);
        }
    }
}
