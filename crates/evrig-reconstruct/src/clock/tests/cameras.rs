//! The offset from a motion that two cameras saw.

use super::seen_motion::{Path, Scene, Tracks};
use super::*;
use evrig_core::stats::Estimate;
use evrig_core::time::ClockMap;

type Found = Result<MotionEstimate<PiSensor, Davis>, ClockError>;

fn find(tracks: &Tracks, options: &MotionOptions) -> Found {
    let (pi, davis) = Scene::zeros();
    motion(&tracks.pi, &tracks.davis, ClockMap::from_anchor(pi, davis), options)
}

/// Map minus truth in the middle of the tracks, µs.
fn error_us(scene: &Scene, tracks: &Tracks, found: &MotionEstimate<PiSensor, Davis>) -> f64 {
    let at = tracks.davis[tracks.davis.len() / 2].at;
    (found.clock.map(at).unwrap().as_nanos() - scene.pi_from_davis(at)) as f64 * 1e-3
}

#[test]
fn the_offset_comes_back_at_the_cramer_rao_limit_and_its_interval_covers() {
    let trials = 60;
    let scene = Scene::new(Path::BothWays, 5.0);
    let (mut squares, mut n_covered, mut limit_us) = (0.0, 0, 0.0);
    for seed in 0..trials {
        let tracks = scene.film(seed);
        let found = find(&tracks, &MotionOptions::default()).unwrap();
        let error = error_us(&scene, &tracks, &found);
        squares += error * error;
        n_covered += u64::from(found.clock.segments[0].error.unwrap().offset_us.covers(-error));
        let n_davis = found.clock.tally.n_kept as usize;
        assert!(n_davis > 190, "{n_davis} of 200 used");
        limit_us = 1e6 * scene.limit_s(3 * n_davis, n_davis);
    }
    let rms = (squares / trials as f64).sqrt();
    assert!(rms < 1.3 * limit_us, "rms {rms} us, limit {limit_us} us");
    assert!(rms > 0.6 * limit_us, "rms {rms} us, limit {limit_us} us");
    let coverage = n_covered as f64 / trials as f64;
    assert!(coverage > 0.8, "{coverage} within the 90 % interval");
}

#[test]
fn a_good_track_against_a_rare_one_is_followed_through_its_turns() {
    // The event camera's frames come rarely and carry the path; the other track shows its turns.
    let scene = Scene { noise_px: 0.005, ..Scene::new(Path::BothWays, 4.0) };
    let tracks = scene.film(6);
    let (pi, davis) = Scene::zeros();
    let initial = ClockMap::from_anchor(davis, pi);
    let found = motion(&tracks.davis, &tracks.pi, initial, &MotionOptions::default()).unwrap();
    assert!(found.chi2_per_dof < 1.5, "{found:?}");
    let at = tracks.pi[tracks.pi.len() / 2].at;
    let back = scene.pi_from_davis(found.clock.map(at).unwrap());
    let error_us = (back - at.as_nanos()) as f64 * 1e-3;
    let sigma_us = found.correction_us.standard_error;
    assert!(error_us.abs() < 3.5 * sigma_us && sigma_us < 20.0, "{error_us} of {sigma_us} us");
}

#[test]
fn corners_that_err_by_where_they_fall_among_the_pixels_widen_the_interval() {
    let (trials, mut n_covered) = (40, 0);
    for seed in 0..trials {
        let scene = Scene { noise_px: 0.01, ..Scene::new(Path::BothWays, 5.0) };
        let mut tracks = scene.film(seed);
        for sample in &mut tracks.davis {
            // Common to samples that fall alike, and nothing that the stated error knows of.
            let phase = std::f64::consts::TAU * (sample.x.value() / 7.0 + 0.37 * seed as f64);
            sample.x = Pixels(sample.x.value() + 0.05 * phase.sin());
        }
        let found = find(&tracks, &MotionOptions::default()).unwrap();
        assert!(found.chi2_per_dof > 1.3, "{found:?}");
        let error = error_us(&scene, &tracks, &found);
        n_covered += u64::from(error.abs() < 1.96 * found.correction_us.standard_error);
    }
    let coverage = n_covered as f64 / trials as f64;
    assert!(coverage >= 0.85, "{coverage} within the 95 % interval");
}

#[test]
fn geometry_and_skew_come_back_too() {
    let scene = Scene::new(Path::Lissajous, 20.0);
    let found = find(&scene.film(3), &MotionOptions::default()).unwrap();
    let near = |estimate: Estimate, truth: f64| {
        let off = (estimate.value - truth) / estimate.standard_error;
        assert!(off.abs() < 4.0, "{estimate} is {off} errors from {truth}");
    };
    near(found.roll_deg, scene.roll_deg);
    near(found.scale, super::seen_motion::SCALE);
    near(found.skew_ppm.unwrap(), scene.skew * 1e6);
    assert!(found.ratio < 1.5 && (found.chi2_per_dof - 1.0).abs() < 0.15, "{found:?}");
}

#[test]
fn a_circle_in_one_direction_is_never_answered() {
    for seed in 0..10 {
        for noise_px in [0.02, 0.1, 0.5] {
            let scene = Scene { noise_px, ..Scene::new(Path::OneWay, 6.0) };
            let found = find(&scene.film(seed), &MotionOptions::default());
            assert!(
                matches!(found, Err(ClockError::DegenerateMotion { .. })),
                "seed {seed}, noise {noise_px}: {found:?}"
            );
        }
    }
}

#[test]
fn a_known_roll_answers_for_the_circle_with_the_error_it_brings() {
    let scene = Scene::new(Path::OneWay, 6.0);
    let roll = Estimate::normal(scene.roll_deg, 0.1, 1);
    let options = MotionOptions { roll_deg: Some(roll), ..MotionOptions::default() };
    let tracks = scene.film(2);
    let found = find(&tracks, &options).unwrap();
    // A tenth of a degree at half a turn a second is 556 us.
    let sigma = found.correction_us.standard_error;
    assert!((500.0..700.0).contains(&sigma), "{sigma} us");
    assert!(error_us(&scene, &tracks, &found).abs() < 3.0 * sigma);
}

#[test]
fn wild_detections_and_a_lost_second_do_not_move_the_answer() {
    let scene = Scene::new(Path::BothWays, 8.0);
    let mut tracks = scene.film(9);
    for index in [100, 333, 700] {
        tracks.pi[index].x = Pixels(500.0);
    }
    tracks.davis[150].y = Pixels(3.0);
    tracks.davis[151].x = Pixels(f64::NAN);
    tracks.pi.drain(200..320);
    let found = find(&tracks, &MotionOptions::default()).unwrap();
    assert_eq!(found.n_outliers, [3, 1]);
    let error = error_us(&scene, &tracks, &found);
    assert!(error.abs() < 4.0 * found.correction_us.standard_error, "{error} us");
}

#[test]
fn a_motion_that_repeats_itself_within_the_search_is_ambiguous() {
    let scene = Scene::new(Path::Lissajous, 12.0);
    let options = MotionOptions { search: Span::from_secs_f64(2.5), ..MotionOptions::default() };
    let found = find(&scene.film(1), &options);
    assert!(matches!(found, Err(ClockError::AmbiguousOffset { .. })), "{found:?}");
}

#[test]
fn a_still_tag_and_a_short_track_are_named_errors() {
    let scene = Scene::new(Path::BothWays, 5.0);
    let mut still = scene.film(4);
    for sample in &mut still.davis {
        (sample.x, sample.y) = (Pixels(100.0), Pixels(100.0));
    }
    let found = find(&still, &MotionOptions::default());
    assert!(matches!(found, Err(ClockError::WeakMotion { .. })), "{found:?}");
    let mut short = scene.film(4);
    short.davis.truncate(10);
    let found = find(&short, &MotionOptions::default());
    assert!(matches!(found, Err(ClockError::TooFewSamples { track: "other", .. })), "{found:?}");
    short.pi.clear();
    let found = find(&short, &MotionOptions::default());
    assert!(
        matches!(found, Err(ClockError::TooFewSamples { track: "reference", .. })),
        "{found:?}"
    );
}
