//! The inertial unit beside the DAVIS's pixels: how the camera turns and what pushes it.
//!
//! An InvenSense MPU-6500 (PS-MPU-6500A-01; the MPU-9250 of other cameras has the same gyroscope),
//! set as the camera's drivers set it: a thousand samples a second, 500 degrees a second and 4 g at
//! full scale, low-pass at 92 Hz. Axes are those of the image: x to its right, y down, z along the
//! view. A unit at rest feels what holds it up, so one that looks at the floor shows -1 g along z.
//! It sits where the optical centre is; at the rotation rates of an arm, an offset of a few
//! millimetres cannot be measured.

use super::draws::{RandomPurpose, WorldRandom};
use super::scene::World;
use evrig_core::imu::ImuSample;
use evrig_core::time::{Span, Stamp};
use evrig_session::rig::CameraFrame;
use nalgebra::Vector3;

/// Between two samples.
const PERIOD: Span = Span::from_micros(1_000);
/// What a sample is the mean of: such a mean has the noise bandwidth of 100 Hz, with which the
/// sheet's density of noise becomes its total noise at this low-pass (0.01 and 0.1 degrees a
/// second).
const N_MEAN: u64 = 5;
/// The filter's delay in the sheet's table of low-passes.
const DELAY: Span = Span::from_micros(3_900);
/// Speeds are taken over twice this.
const INSTANT: Span = Span::from_micros(500);
const STANDARD_GRAVITY_MM_PER_S2: f64 = 9_806.65;
/// Steps of the converters at these full scales, and of the thermometer, which shows 0 at 21
/// degrees.
const STEPS_PER_G: f64 = 8_192.0;
const STEPS_PER_DEG_PER_S: f64 = 65.5;
const STEPS_PER_C: f64 = 333.87;
const ZERO_C: f64 = 21.0;

/// Gives sample after sample.
#[derive(Debug)]
pub(super) struct SimulatedImu {
    from: Span,
    next: u64,
    /// Its own zeros: acceleration in g, turning in degrees a second.
    zeros: [Vector3<f64>; 2],
}

impl SimulatedImu {
    pub(super) fn new(world: &World, from: Span) -> Self {
        let unit = &world.description.imu;
        let mut draws = WorldRandom::new(world.seed, RandomPurpose::ImuZero, 0, 0);
        let mut zero =
            |within: f64| Vector3::from_fn(|_, _| within * (2.0 * draws.uniform() - 1.0));
        let zeros = [zero(unit.acceleration_zero_mg * 1e-3), zero(unit.rotation_zero_deg_per_s)];
        Self { from, next: 0, zeros }
    }

    /// The samples taken before `until` that were not given yet.
    pub(super) fn samples_until(&mut self, world: &World, until: Span) -> Vec<ImuSample> {
        let mut samples = Vec::new();
        loop {
            let at = self.from + Span::from_nanos(PERIOD.as_nanos() * self.next as i64);
            if at >= until {
                return samples;
            }
            samples.push(self.sample(world, at));
            self.next += 1;
        }
    }

    fn sample(&self, world: &World, at: Span) -> ImuSample {
        let length = Span::from_nanos(PERIOD.as_nanos() * N_MEAN as i64);
        let begin = at - DELAY - Span::from_nanos(length.as_nanos() / 2);
        let [before, after] = [begin, begin + length];
        let seconds = length.as_secs_f64();
        // The means over the low-pass are what it was at its end less what it was at its beginning.
        let push = (velocity(world, after) - velocity(world, before)) / seconds;
        let push_g = push / STANDARD_GRAVITY_MM_PER_S2 + Vector3::z();
        let turned_deg = world.true_pose(after).r.0 - world.true_pose(before).r.0;
        let turn = Vector3::z() * (turned_deg / seconds);
        let camera = frame(world, begin + Span::from_nanos(length.as_nanos() / 2));
        let unit = &world.description.imu;
        let [push_noise, turn_noise] = self.noise(world);
        let push = along(&camera, push_g)
            + self.zeros[0]
            + push_noise * (unit.acceleration_noise_ug_per_rthz * 1e-6);
        let turn = along(&camera, turn)
            + self.zeros[1]
            + turn_noise * unit.rotation_noise_deg_per_s_per_rthz;
        let temperature = stepped(unit.temperature_c - ZERO_C, STEPS_PER_C) + ZERO_C as f32;
        ImuSample {
            stamp: Stamp::from_micros(world.clocks.davis(at).as_micros()),
            temperature_c: temperature,
            acceleration_g: push.map(|value| stepped(value, STEPS_PER_G)).into(),
            rotation_deg_per_s: turn.map(|value| stepped(value, STEPS_PER_DEG_PER_S)).into(),
            magnetic_ut: [0.0; 3],
        }
    }

    /// Noise of unit density in the next sample: white, through the same low-pass as the signal.
    fn noise(&self, world: &World) -> [Vector3<f64>; 2] {
        let white = (0.5 / PERIOD.as_secs_f64()).sqrt() / N_MEAN as f64;
        let mut sums = [Vector3::zeros(); 2];
        for number in self.next..self.next + N_MEAN {
            let mut draws = WorldRandom::new(world.seed, RandomPurpose::ImuNoise, number, 0);
            for sum in &mut sums {
                *sum += Vector3::from_fn(|_, _| f64::from(draws.normal()) * white);
            }
        }
        sums
    }
}

fn frame(world: &World, at: Span) -> CameraFrame {
    world.rig.mount.davis.frame(world.true_pose(at))
}

/// Of the camera in the base frame, mm/s.
fn velocity(world: &World, at: Span) -> Vector3<f64> {
    let way = frame(world, at + INSTANT).centre_mm - frame(world, at - INSTANT).centre_mm;
    way / (2.0 * INSTANT.as_secs_f64())
}

/// A direction of the base frame in the camera's axes.
fn along(camera: &CameraFrame, vector: Vector3<f64>) -> Vector3<f64> {
    Vector3::new(camera.right.dot(&vector), camera.down.dot(&vector), camera.forward.dot(&vector))
}

/// What a converter of 16 bits makes of a value.
fn stepped(value: f64, steps_per_unit: f64) -> f32 {
    let steps = (value * steps_per_unit).round().clamp(f64::from(i16::MIN), f64::from(i16::MAX));
    (steps / steps_per_unit) as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::test_world::{MIDDLE, TestWorld};
    use crate::world::{DavisTwin, SettingSchedule, ToolMotion};
    use evrig_session::rig::Pose;
    use std::sync::Arc;

    /// Turns about the tool's axis and goes to and fro, both smoothly.
    #[derive(Debug)]
    struct Swaying {
        turn_deg: f64,
        way_mm: f64,
        frequency_hz: f64,
    }

    impl ToolMotion for Swaying {
        fn pose_at(&self, time: Span) -> Pose {
            let [x, y, z, r] = MIDDLE;
            let phase = std::f64::consts::TAU * self.frequency_hz * time.as_secs_f64();
            let share = (1.0 - phase.cos()) / 2.0;
            Pose::from_mm_deg([x + self.way_mm * share, y, z, r + self.turn_deg * share])
        }
    }

    fn world(motion: Swaying, change: impl FnOnce(&mut TestWorld)) -> World {
        let mut stage = TestWorld::still("plain");
        change(&mut stage);
        World::new(
            &stage.rig(),
            Arc::new(motion),
            SettingSchedule::default(),
            &stage.description,
            5,
        )
        .unwrap()
    }

    fn samples(world: &World, until: Span) -> Vec<ImuSample> {
        SimulatedImu::new(world, Span::ZERO).samples_until(world, until)
    }

    fn perfect(stage: &mut TestWorld) {
        let unit = &mut stage.description.imu;
        unit.acceleration_zero_mg = 0.0;
        unit.rotation_zero_deg_per_s = 0.0;
    }

    const REST: Swaying = Swaying { turn_deg: 0.0, way_mm: 0.0, frequency_hz: 0.0 };

    fn mean(values: &[f64]) -> f64 {
        values.iter().sum::<f64>() / values.len() as f64
    }

    #[test]
    fn at_rest_it_feels_what_holds_it_up_and_the_noise_of_its_sheet() {
        let world = world(REST, perfect);
        let samples = samples(&world, Span::from_micros(10_000_000));
        assert_eq!(samples.len(), 10_000);
        for (axis, expected) in [0.0, 0.0, -1.0].into_iter().enumerate() {
            let push: Vec<_> = samples.iter().map(|s| f64::from(s.acceleration_g[axis])).collect();
            // Of white noise, the mean over ten seconds has a standard error of 67 ug.
            assert!((mean(&push) - expected).abs() < 3e-4, "{axis}: {}", mean(&push));
            let turn: Vec<_> =
                samples.iter().map(|s| f64::from(s.rotation_deg_per_s[axis])).collect();
            let rms = mean(&turn.iter().map(|v| v * v).collect::<Vec<_>>()).sqrt();
            // 0.1 degrees a second in all at 92 Hz, according to the data sheet; 2,000 of them are
            // independent.
            assert!((rms - 0.1).abs() < 0.008, "{axis}: {rms}");
            // Neighbours share four of five.
            let products: Vec<_> = turn.windows(2).map(|pair| pair[0] * pair[1]).collect();
            assert!((mean(&products) / (rms * rms) - 0.8).abs() < 0.05, "{axis}");
        }
        assert!(samples.iter().all(|sample| (sample.temperature_c - 35.0).abs() < 2e-3));
    }

    #[test]
    fn its_turns_add_up_to_the_wrists() {
        // Half a period: 40 degrees of the tool against the clock as seen from above; the camera
        // looks down, so it sees itself turn the other way about its view.
        let world = world(Swaying { turn_deg: 40.0, way_mm: 0.0, frequency_hz: 0.5 }, perfect);
        let samples = samples(&world, Span::from_micros(1_000_000) + DELAY);
        for (axis, expected) in [0.0, 0.0, -40.0].into_iter().enumerate() {
            let rates = samples.iter().map(|sample| f64::from(sample.rotation_deg_per_s[axis]));
            let turned = rates.sum::<f64>() * PERIOD.as_secs_f64();
            // The density of noise over a second makes a standard error of 0.007 degrees.
            assert!((turned - expected).abs() < 0.04, "{axis}: {turned}");
        }
    }

    #[test]
    fn its_pushes_add_up_to_the_cameras_speed() {
        // After a quarter of a period of 2 Hz it is at its fastest: 10 mm * pi * 2 Hz.
        let world = world(Swaying { turn_deg: 0.0, way_mm: 10.0, frequency_hz: 2.0 }, perfect);
        let samples = samples(&world, Span::from_micros(125_000) + DELAY);
        let camera = frame(&world, Span::ZERO);
        let expected = along(&camera, Vector3::new(10.0 * std::f64::consts::PI * 2.0, 0.0, 0.0));
        for axis in 0..2 {
            let pushes = samples.iter().map(|sample| f64::from(sample.acceleration_g[axis]));
            let speed = pushes.sum::<f64>() * PERIOD.as_secs_f64() * STANDARD_GRAVITY_MM_PER_S2;
            assert!((speed - expected[axis]).abs() < 4.0, "{axis}: {speed}, {}", expected[axis]);
        }
        assert!(expected.norm() > 60.0, "there is a speed to find");
    }

    #[test]
    fn its_zeros_are_off_by_what_the_sheet_allows_and_the_same_for_the_whole_session() {
        let world = world(REST, |stage| {
            let unit = &mut stage.description.imu;
            unit.rotation_noise_deg_per_s_per_rthz = 0.0;
            unit.acceleration_noise_ug_per_rthz = 0.0;
        });
        let samples = samples(&world, Span::from_micros(50_000));
        let first = samples[0];
        assert!(samples.iter().all(|s| s.rotation_deg_per_s == first.rotation_deg_per_s));
        assert!(first.rotation_deg_per_s.iter().all(|rate| rate.abs() <= 5.01));
        assert!(first.rotation_deg_per_s.iter().any(|rate| rate.abs() > 0.1));
        assert!((first.acceleration_g[2] + 1.0).abs() <= 0.0601);
    }

    #[test]
    fn the_twin_gives_it_with_its_packets_at_the_cameras_own_time() {
        let world = Arc::new(world(REST, |_| {}));
        let packet =
            DavisTwin::new(Arc::clone(&world), Span::ZERO).advance_to(Span::from_micros(30_000));
        let start = world.clocks().davis(Span::ZERO).as_micros();
        let times: Vec<_> = packet.imu.iter().map(|s| s.stamp.as_micros() - start).collect();
        assert_eq!(times, (0..30).map(|n| n * 1_000).collect::<Vec<_>>());
    }
}
