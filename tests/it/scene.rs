//! The light signal against the truth of the simulated world, on a small rig.

use crate::small_rig::small_rig;
use evrig::drive::{Drive, TimeGrid};
use evrig::frame::Frame;
use evrig::rig::{Pose, Rig};
use evrig::roi::{Lens, SampleFormat, Track, TrackOptions, Tracker};
use evrig::scene::{
    DavisInputs, PiInputs, PointSpread, RawLevels, Scene, SceneError, align_davis,
    reconstruct_target,
};
use evrig::sim::world::{
    CameraName, DavisTwin, PiTwin, RunSetting, SettingSchedule, ToolMotion, World, WorldDescription,
};
use evrig::time::{Clock, ClockMap, Davis, PiSensor, Span};
use std::f64::consts::TAU;
use std::sync::{Arc, OnceLock};

const SECONDS: f64 = 1.0;

/// A small print over which both cameras hang, with a tag as large as on the whole one.
fn rig() -> Rig {
    small_rig(&[
        ("[0.0, 18.0, -13.0]", "[0.0, 2.0, -13.0]"),
        ("[0.0, -18.0, -13.0]", "[0.0, -2.0, -13.0]"),
        ("size_px = [346, 260]", "size_px = [112, 80]"),
        ("size_px = [692, 520]", "size_px = [372, 240]"),
        ("picture_side_mm = 43.05", "picture_side_mm = 14.35"),
        ("gap_mm = 4.1\n", "gap_mm = 3.0\n"),
    ])
}

/// A small circle, twice, with a wrist that swings.
#[derive(Debug)]
struct Circle;

impl ToolMotion for Circle {
    fn pose_at(&self, time: Span) -> Pose {
        let phase = TAU * time.as_secs_f64() / 0.5;
        let turn = 2.0 * (0.7 * phase).sin();
        Pose::from_mm_deg([270.0 + 2.0 * phase.cos(), 2.0 * phase.sin(), 100.0, 90.0 + turn])
    }
}

struct Seen {
    world: Arc<World>,
    rig: Rig,
    scene: Scene,
}

fn tracked<C: Clock>(mut tracker: Tracker<C>, frames: &[Frame<C>]) -> Track<C> {
    for frame in frames {
        // A frame without the tag is counted by the tracker.
        let _ = tracker.see(frame);
    }
    tracker.finish().unwrap()
}

/// The scene of one recording in an orderly world; made once.
fn seen() -> &'static Seen {
    static SEEN: OnceLock<Seen> = OnceLock::new();
    SEEN.get_or_init(|| seen_in(&WorldDescription::default()))
}

/// The scene of one recording.
fn seen_in(description: &WorldDescription) -> Seen {
    let rig = rig();
    let schedule = SettingSchedule::new(vec![RunSetting::nominal(Span::ZERO, true)]);
    let world = World::new(&rig, Arc::new(Circle), schedule, description, 5).unwrap();
    let world = Arc::new(world);
    let until = Span::from_secs_f64(SECONDS);
    let shown = PiTwin::new(Arc::clone(&world), Span::from_micros(8_000)).frames_until(until);
    let raw: Vec<_> = shown.into_iter().filter_map(|frame| frame.raw).collect();
    let aps = DavisTwin::new(Arc::clone(&world), Span::ZERO).advance_to(until).frames;
    let black_level_dn = rig.pi.camera.black_level_dn;
    let mosaic = TrackOptions::new(SampleFormat::Mosaic { black_level_dn });
    let pi_track = tracked(Tracker::new(&rig.target, &rig.pi.camera, mosaic).unwrap(), &raw);
    let grey = TrackOptions::new(SampleFormat::Brightness);
    let davis_track = tracked(Tracker::new(&rig.target, &rig.davis.camera, grey).unwrap(), &aps);
    let known = PiInputs {
        size: rig.pi.camera.size,
        lens: Lens::of(&rig.pi.camera),
        raw: RawLevels { black_dn: black_level_dn, full_dn: 1023 },
        row_time: rig.pi.camera.row_time,
        mount: rig.mount,
        track: &pi_track,
    };
    let mut reconstruction = reconstruct_target(&known, &mut raw.as_slice()).unwrap();
    let known = DavisInputs {
        lens: Lens::of(&rig.davis.camera),
        mount: rig.mount,
        track: &davis_track,
        pi_from_davis: clocks_off_by(&world, Span::from_micros(6_000)),
        is_measured: true,
    };
    let registration = align_davis(&mut reconstruction, &known, &aps).unwrap();
    let scene = Scene { size: rig.davis.camera.size, reconstruction, registration };
    Seen { world, rig, scene }
}

/// The clocks as one would know them before: wrong by a few milliseconds.
fn clocks_off_by(world: &World, wrong: Span) -> ClockMap<PiSensor, Davis> {
    let at = Span::from_secs_f64(SECONDS / 2.0);
    ClockMap::from_anchor(world.clocks().pi_sensor(at) + wrong, world.clocks().davis(at))
}

fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|value| value * value).sum::<f64>() / values.len() as f64).sqrt()
}

fn grid(world: &World) -> TimeGrid {
    let start_us = world.clocks().davis(Span::from_micros(100_000)).as_micros();
    TimeGrid { start_us, step_us: 4_000, n: 200 }
}

/// The drive's error at textured pixels, in contrast thresholds: root mean square over time without
/// the mean, the median over pixels; and the median of what is stated.
fn drive_error(seen: &Seen, drive: &dyn Drive) -> [f64; 2] {
    let size = seen.rig.davis.camera.size;
    let threshold = seen.world.description().davis.threshold;
    let grid = grid(&seen.world);
    let (mut errors, mut stated) = (Vec::new(), Vec::new());
    for pixel in (0..size.n_pixels()).step_by(17) {
        let [x, y] = [pixel % 112, pixel / 112].map(|part| part as u16);
        let Some(curve) = drive.curve(x, y, grid) else { continue };
        let (mut apart, mut truth) = (Vec::new(), Vec::new());
        for (i, value) in curve.values().iter().enumerate().filter(|(_, v)| v.is_finite()) {
            let time = Span::from_micros(100_000 + 4_000 * i as i64);
            let light = f64::from(seen.world.light_on(CameraName::Davis, [x, y], time)).ln();
            apart.push(f64::from(*value) - light);
            truth.push(light);
        }
        let centred = |values: &[f64]| {
            let mean = values.iter().sum::<f64>() / values.len() as f64;
            rms(&values.iter().map(|value| value - mean).collect::<Vec<_>>())
        };
        if truth.len() > 150 && centred(&truth) > 0.1 {
            errors.push(centred(&apart) / threshold);
            let place = [f64::from(x) + 0.5, f64::from(y) + 0.5];
            stated.push(f64::from(drive.error(place)) / threshold);
        }
    }
    assert!(errors.len() > 50, "{} textured pixels", errors.len());
    let median = |values: &mut Vec<f64>| {
        values.sort_by(f64::total_cmp);
        values[values.len() / 2]
    };
    [median(&mut errors), median(&mut stated)]
}

#[test]
fn the_drive_is_within_a_fraction_of_a_threshold_of_the_true_signal() {
    let seen = seen();
    let [error, stated] = drive_error(seen, &seen.scene.drive());
    assert!(error < 0.06, "{error} thresholds, stated {stated}");
    assert!(stated > 0.1 * error && stated < 3.0 * error, "{stated} stated, {error} true");
}

#[test]
fn the_clock_offset_and_the_row_time_are_recovered() {
    let seen = seen();
    let (tie, path) = (&seen.scene.registration.alignment, &seen.scene.reconstruction.path);
    let at = Span::from_secs_f64(SECONDS / 2.0);
    let clocks = seen.world.clocks();
    let mapped = (tie.pi_from_davis.map(clocks.davis(at)) - path.zero).as_secs_f64();
    let found = mapped + tie.lag_s + tie.skew * (mapped - tie.lag_at_s);
    let truth = (clocks.pi_sensor(at) - path.zero).as_secs_f64();
    assert!((found - truth).abs() < 1e-4, "{} us", (found - truth) * 1e6);
    let row_us = seen.scene.reconstruction.row_s[0] * 1e6;
    assert!((row_us - 9.21).abs() < 0.5, "{row_us}");
}

#[test]
fn a_wrong_offset_shift_or_blur_increases_the_drive_error() {
    let seen = seen();
    let drive = seen.scene.drive();
    let [best, _] = drive_error(seen, &drive);
    let blurred = drive.with_spread(PointSpread::of_sigma(drive.spread().sigma_px + 0.4));
    for (what, other) in [
        ("late", drive.with_offset_us(3_000.0)),
        ("moved", drive.with_shift_px([0.3, 0.0])),
        ("blurred", blurred),
    ] {
        let [error, _] = drive_error(seen, &other);
        assert!(error > 1.5 * best, "{what}: {error} against {best}");
    }
}

#[test]
fn a_scene_restored_from_its_parts_gives_the_same_signal() {
    let seen = seen();
    let scene = &seen.scene;
    // With the keys of former versions.
    let text = serde_json::to_string(&scene.parameters())
        .unwrap()
        .replace("\"alignment", "\"tie")
        .replace("\"residual_", "\"left_")
        .replace("moving_illumination", "moving_light");
    let map = &scene.reconstruction.map;
    let back = Scene::from_parts(
        serde_json::from_str(&text).unwrap(),
        map.values().to_vec(),
        map.errors().to_vec(),
        &scene.path_table(),
    )
    .unwrap();
    let grid = grid(&seen.world);
    let (a, b) = (scene.drive().curve(40, 40, grid), back.drive().curve(40, 40, grid));
    let (a, b) = (a.unwrap(), b.unwrap());
    let pairs = a.values().iter().zip(b.values());
    assert!(pairs.clone().any(|(a, _)| a.is_finite()));
    for (a, b) in pairs {
        assert!((a - b).abs() < 1e-6 || (a.is_nan() && b.is_nan()), "{a} {b}");
    }
    let cut = &map.values()[1..];
    let parts = (scene.parameters(), cut.to_vec(), map.errors().to_vec());
    assert!(Scene::from_parts(parts.0, parts.1, parts.2, &scene.path_table()).is_none());
}

#[test]
fn frames_of_another_size_are_refused() {
    let seen = seen();
    let rig = &seen.rig;
    let shown = PiTwin::new(Arc::clone(&seen.world), Span::from_micros(8_000))
        .frames_until(Span::from_micros(150_000));
    let raw: Vec<_> = shown.into_iter().filter_map(|frame| frame.raw).collect();
    let black_level_dn = rig.pi.camera.black_level_dn;
    let mosaic = TrackOptions::new(SampleFormat::Mosaic { black_level_dn });
    let track = tracked(Tracker::new(&rig.target, &rig.pi.camera, mosaic).unwrap(), &raw);
    let known = PiInputs {
        size: evrig::geometry::Size::new(100, 100),
        lens: Lens::of(&rig.pi.camera),
        raw: RawLevels { black_dn: black_level_dn, full_dn: 1023 },
        row_time: rig.pi.camera.row_time,
        mount: rig.mount,
        track: &track,
    };
    let error = reconstruct_target(&known, &mut raw.as_slice()).unwrap_err();
    assert!(matches!(error, SceneError::NotRaw { .. }), "{error}");
}

fn with_effects(effects: serde_json::Value) -> WorldDescription {
    serde_json::from_value(serde_json::json!({ "effects": effects })).unwrap()
}

#[test]
fn an_unaffected_camera_shows_no_tone_curve_no_vignetting_and_its_stated_noise() {
    let scene = &seen().scene;
    let [loss, error] = scene.reconstruction.corner_loss.unwrap();
    assert!(loss < 0.02 && error < 0.02, "{loss} {error}");
    let tone = scene.registration.tone.unwrap();
    assert!(tone.nonlinear_sigmas().is_none(), "{tone:?}");
    assert!(tone.corner_loss[0] < 0.03, "{tone:?}");
    let [noise, error] = scene.reconstruction.read_noise_dn.unwrap();
    let stated = seen().world.description().pi.read_noise_dn.hypot(1.0 / 12.0_f64.sqrt());
    assert!((noise - stated).abs() < 0.2 + 3.0 * error, "{noise} {error} for {stated}");
    assert!(scene.reconstruction.moving_illumination.is_none());
}

#[test]
fn vignetting_and_unstated_read_noise_are_estimated_from_frames() {
    let effects = serde_json::json!({
        "vignetting": { "corner_loss": 0.3 },
        "frame_noise": { "sigma_dn": 4.0 },
    });
    let Seen { scene, .. } = seen_in(&with_effects(effects));
    let [loss, error] = scene.reconstruction.corner_loss.unwrap();
    assert!((loss - 0.3).abs() < 0.02 + 3.0 * error, "{loss} {error}");
    let [noise, error] = scene.reconstruction.read_noise_dn.unwrap();
    assert!((noise - 4.08).abs() < 0.2 + 3.0 * error, "{noise} {error}");
    let [loss, error] = scene.registration.tone.unwrap().corner_loss;
    assert!((loss - 0.3).abs() < 0.03 + 3.0 * error, "{loss} {error}");
}

#[test]
fn a_tone_curve_is_estimated_from_frames_and_inverted_in_the_drive() {
    let effects = serde_json::json!({ "tone_curve": { "gamma": 0.8 } });
    let seen = seen_in(&with_effects(effects));
    let tone = seen.scene.registration.tone.unwrap();
    assert!((tone.gamma[0] - 0.8).abs() < 3.0 * tone.gamma[1], "{tone:?}");
    assert!(tone.gamma[1] < 0.03, "{tone:?}");
    let [error, _] = drive_error(&seen, &seen.scene.drive());
    assert!(error < 0.15, "{error} thresholds");
}

#[test]
fn a_moving_shadow_is_estimated_from_frames_and_included_in_the_drive() {
    // A band as narrow against this small print as others are against a whole one.
    let shadow = serde_json::json!({
        "depth": 0.25, "speed_mm_per_s": 20.0, "width_mm": 5.0, "period_mm": 40.0,
        "direction_deg": 30.0,
    });
    let seen = seen_in(&with_effects(serde_json::json!({ "moving_shadow": shadow })));
    let moving = seen.scene.reconstruction.moving_illumination.clone().expect("a shadow");
    let [depth, error] = moving.depth;
    assert!((depth - 0.25).abs() < 0.03 + 3.0 * error, "{moving:?}");
    let [error, _] = drive_error(&seen, &seen.scene.drive());
    let mut still = seen.scene.clone();
    still.reconstruction.moving_illumination = None;
    let [without, _] = drive_error(&seen, &still.drive());
    assert!(error < 0.5 * without, "{error} thresholds with the shadow, {without} without");
}
