//! The true pose of the tool: the planner's pose with backlash, vibration and base offset.

use evrig_core::units::{Degrees, Hertz};

/// Deviations of the simulated arm from its planner; all zero for an ideal arm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Imperfections {
    /// Backlash of the base joint: the arm lags by half of it in either direction.
    pub backlash: Degrees,
    /// How far the tool swings per acceleration, mm per mm/s^2 (1 / omega^2 for a true spring);
    /// zero switches vibration off.
    pub vibration_gain: f64,
    /// Frequency of the swing.
    pub vibration_frequency: Hertz,
    /// Damping of the swing as a share of the critical one.
    pub damping: f64,
    /// Error of the base joint until the arm is homed: its encoder only counts steps.
    pub base_offset: Degrees,
}

impl Default for Imperfections {
    fn default() -> Self {
        Self {
            backlash: Degrees(0.0),
            vibration_gain: 0.0,
            vibration_frequency: Hertz(12.0),
            damping: 0.1,
            base_offset: Degrees(0.0),
        }
    }
}

/// Step of the simulation, seconds: well below the period of any swing of the arm.
pub(super) const STEP_S: f64 = 1e-3;

/// State of backlash and vibration, advanced in steps of [`STEP_S`].
#[derive(Debug, Clone)]
pub(super) struct ToolDynamics {
    base_deg: f64,
    swing_mm: [f64; 3],
    swing_speed: [f64; 3],
    /// The planner's places one and two steps ago, mm.
    before: [[f64; 3]; 2],
}

impl ToolDynamics {
    /// At rest with the planner at `xyz` mm and the base at `base_deg`.
    #[must_use]
    pub(super) const fn at_rest(base_deg: f64, xyz: [f64; 3]) -> Self {
        Self { base_deg, swing_mm: [0.0; 3], swing_speed: [0.0; 3], before: [xyz; 2] }
    }

    /// One step on, the planner now being at `xyz` mm with the base at `base_deg`.
    pub(super) fn step(&mut self, like: &Imperfections, base_deg: f64, xyz: [f64; 3]) {
        let half = like.backlash.value() / 2.0;
        self.base_deg = self.base_deg.clamp(base_deg - half, base_deg + half);
        if like.vibration_gain > 0.0 {
            self.swing(like, xyz);
        }
        self.before = [xyz, self.before[0]];
    }

    /// A damped spring driven by the planner's acceleration.
    fn swing(&mut self, like: &Imperfections, xyz: [f64; 3]) {
        let omega = std::f64::consts::TAU * like.vibration_frequency.value();
        for (axis, here) in xyz.iter().enumerate() {
            let acceleration =
                (here - 2.0 * self.before[0][axis] + self.before[1][axis]) / (STEP_S * STEP_S);
            let drive = -like.vibration_gain * omega * omega * acceleration;
            let force = drive
                - omega * omega * self.swing_mm[axis]
                - 2.0 * like.damping * omega * self.swing_speed[axis];
            // Speed first, then place with the new speed: stable for any swing.
            self.swing_speed[axis] += force * STEP_S;
            self.swing_mm[axis] += self.swing_speed[axis] * STEP_S;
        }
    }

    /// Whether the vibration has decayed.
    #[must_use]
    pub(super) fn is_calm(&self) -> bool {
        self.swing_mm.iter().chain(&self.swing_speed).all(|value| value.abs() < 1e-6)
    }

    /// The true pose when the planner is at `xyzr`, its base at `base_deg`.
    #[must_use]
    pub(super) fn pose(&self, xyzr: [f64; 4], base_deg: f64, offset_deg: f64) -> [f64; 4] {
        let turned = self.base_deg - base_deg + offset_deg;
        let (sin, cos) = turned.to_radians().sin_cos();
        let [x, y, z, r] = xyzr;
        [
            x * cos - y * sin + self.swing_mm[0],
            x * sin + y * cos + self.swing_mm[1],
            z + self.swing_mm[2],
            r + turned,
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_base_lags_by_half_the_play_in_either_direction() {
        let like = Imperfections { backlash: Degrees(0.4), ..Imperfections::default() };
        let mut truth = ToolDynamics::at_rest(0.0, [200.0, 0.0, 0.0]);
        for base_deg in [1.0, 2.0] {
            truth.step(&like, base_deg, [200.0, 0.0, 0.0]);
        }
        assert!((truth.pose([200.0, 0.0, 0.0, 2.0], 2.0, 0.0)[3] - 1.8).abs() < 1e-9);
        truth.step(&like, 1.9, [200.0, 0.0, 0.0]);
        assert!((truth.pose([200.0, 0.0, 0.0, 1.9], 1.9, 0.0)[3] - 1.8).abs() < 1e-9, "play");
        truth.step(&like, 1.0, [200.0, 0.0, 0.0]);
        assert!((truth.pose([200.0, 0.0, 0.0, 1.0], 1.0, 0.0)[3] - 1.2).abs() < 1e-9);
    }

    #[test]
    fn a_jerk_swings_at_the_stated_frequency_and_dies_out() {
        let like = Imperfections {
            vibration_gain: 1e-4,
            vibration_frequency: Hertz(10.0),
            damping: 0.05,
            ..Imperfections::default()
        };
        let mut truth = ToolDynamics::at_rest(0.0, [0.0; 3]);
        // One step of speed 50 mm/s: an impulse of acceleration.
        let mut crossings = Vec::new();
        let mut previous = 0.0;
        for step in 0..2000 {
            let x = 50.0 * STEP_S * f64::from(step);
            truth.step(&like, 0.0, [x, 0.0, 0.0]);
            let swing = truth.pose([x, 0.0, 0.0, 0.0], 0.0, 0.0)[0] - x;
            if previous < 0.0 && swing >= 0.0 {
                crossings.push(step);
            }
            previous = swing;
        }
        let period = f64::from(crossings[3] - crossings[0]) / 3.0 * STEP_S;
        let expected = 0.1 / (1.0 - 0.05_f64.powi(2)).sqrt();
        assert!((period - expected).abs() < 1e-3, "{period} s");
        assert!(crossings.len() > 5);
        for _ in 0..10_000 {
            truth.step(&like, 0.0, [100.0, 0.0, 0.0]);
        }
        assert!(truth.is_calm());
    }
}
