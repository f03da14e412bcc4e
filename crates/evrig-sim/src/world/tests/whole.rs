//! What holds for the world as a whole.

use crate::world::effects::Effects;
use crate::world::stage::Stage;
use crate::world::{DavisTwin, PiTwin, World, WorldError};
use evrig_core::event::Events;
use evrig_core::time::Span;
use evrig_session::rig::Rig;
use evrig_session::trajectory::{OptionalSegments, Trajectory};

/// Nearly everything that draws at random.
const ALL: &str = "
shot_noise = { rms_thresholds = 0.3, bandwidth_hz = 50 }
background_activity = { rate_hz = 2 }
threshold_mismatch = { sigma_relative = 0.1 }
hot_pixels = { fraction = 0.01 }
event_drop = { fraction = 0.1 }
stamp_jitter = { sigma_us = 50 }
row_readout = { row_us = 1 }
aps_coupling = { events_fraction = 0.05, delay_us = 100, row_us = 10 }
";

fn stage() -> Stage {
    Stage::moving("leaves-3", 25.0).with(ALL)
}

#[test]
fn the_same_seed_gives_the_same_bytes_on_any_number_of_threads_and_at_any_pace() {
    let until = Span::from_micros(100_000);
    let on_threads = |n: usize, pace_us: i64| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap();
        pool.install(|| {
            let world = stage().world();
            let mut twin = DavisTwin::new(world.clone(), Span::ZERO);
            let (mut events, mut frames) = (Events::new(), Vec::new());
            let mut time = Span::ZERO;
            while time < until {
                time = time + Span::from_micros(pace_us);
                let packet = twin.advance_to(time.min(until));
                events.extend_from_slice(packet.events.as_slice());
                frames.extend(packet.frames);
            }
            let mut pi = PiTwin::new(world, Span::ZERO);
            (events, frames, pi.frames_until(Span::from_micros(30_000)))
        })
    };
    let (one, two) = (on_threads(1, 100_000), on_threads(2, 7_000));
    assert!(one.0.len() > 1_000 && one.0 == two.0);
    assert!(one.1.len() == 4 && one.1 == two.1);
    assert!(one.2.len() == 4 && one.2 == two.2);
}

#[test]
fn events_come_in_order_and_lie_on_the_sensor() {
    let mut twin = DavisTwin::new(stage().world(), Span::ZERO);
    let events = twin.advance_to(Span::from_micros(200_000)).events;
    assert_eq!(events.as_slice().first_disorder(), None);
    assert_eq!(events.as_slice().first_outside(evrig_core::geometry::Size::new(48, 32)), None);
}

#[test]
fn an_effect_of_no_strength_is_no_effect() {
    let silent = "
refractory_period = { refractory_us = 0 }
threshold_mismatch = { sigma_relative = 0 }
threshold_asymmetry = { on_off_ratio = 1 }
junction_leak = { rate_hz = 0 }
photocurrent_leak = { rate_hz_at_white = 0 }
shot_noise = { rms_thresholds = 0, bandwidth_hz = 100 }
background_activity = { rate_hz = 0 }
hot_pixels = { fraction = 0 }
dead_pixels = { count = 0 }
pixel_latency = { latency_us = 0 }
dark_current = { fraction_of_white = 0 }
temperature_drift = { rate_hz_per_s = 0 }
event_drop = { fraction = 0 }
stamp_jitter = { sigma_us = 0 }
row_readout = { row_us = 0 }
aps_coupling = { events_fraction = 0, delay_us = 0, row_us = 0 }
clock_offset = { offset_us = 0 }
clock_skew = { skew_ppm = 0 }
defocus = { sigma_px = 0 }
vignetting = { corner_loss = 0 }
misregistration = { shift_x_px = 0 }
flicker = { frequency_hz = 100, depth = 0 }
moving_shadow = { depth = 0 }
vibration = { frequency_hz = 50, amplitude_mm = 0 }
black_level = { offset_dn = 0 }
tone_curve = { gamma = 1 }
frame_noise = { sigma_dn = 0 }
rolling_shutter = { row_us = 9.21 }
exposure_blur = { exposure_us = 4000 }
";
    let stage = |effects: &str| Stage::moving("leaves-3", 25.0).with(effects);
    let n_on = toml::from_str::<Effects>(silent).unwrap().keys_on().len();
    assert!(n_on >= 29);
    assert_eq!(stage(silent).events(0.1), stage("").events(0.1));
    let frames = |effects: &str| {
        PiTwin::new(stage(effects).world(), Span::ZERO).frames_until(Span::from_micros(20_000))
    };
    assert_eq!(frames(silent), frames(""));
}

#[test]
fn a_camera_that_looks_away_is_refused_by_name() {
    let mut stage = Stage::still("plain");
    stage.rig_changes =
        vec![("centre_mm = [270.0, 0.0, -138.0]", "centre_mm = [270.0, 0.0, 400.0]")];
    let rig = stage.rig();
    let path = Trajectory::find("line").unwrap().path(&rig, OptionalSegments::LeftOut).unwrap();
    let error = World::along(&rig, &path, &stage.description, 1).unwrap_err();
    assert!(matches!(error, WorldError::LooksAway { camera: "davis", .. }), "{error}");
}

#[test]
fn the_simulated_rig_makes_a_world_along_its_trajectories() {
    let rig = Rig::simulated().unwrap();
    let trajectory = Trajectory::find("protocol-short").unwrap();
    let path = trajectory.path(&rig, OptionalSegments::LeftOut).unwrap();
    let description = crate::world::WorldDescription::default();
    let world = std::sync::Arc::new(World::along(&rig, &path, &description, 5).unwrap());
    let mut twin = DavisTwin::new(world, Span::from_micros(700_000));
    assert!(twin.advance_to(Span::from_micros(740_000)).events.len() > 100);
}
