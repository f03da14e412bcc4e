//! A simulated session is synchronized, tracked, filtered and compared; the results are checked
//! against the simulated truth.

use crate::small_rig;

use evrig::clock::TimeReference;
use evrig::generate::{GenerateParameters, GeneratorChoice};
use evrig::pipeline::{
    AnyTrack, CompareRequest, FilterRequest, FilterSettings, Freshness, GenerateRequest,
    PipelineError, TrackRequest, compare, filter, generate, read_clocks, report, sync, track,
};
use evrig::session::{Session, StreamName};
use evrig::time::{PiSensor, Span, Stamp};
use std::path::Path;
use std::sync::OnceLock;
use tempfile::TempDir;

const UNIX_START_US: i64 = 1_700_000_000_000_000;
const PI_BOOT_NS: i64 = 54_321_000_000_000;

fn simulate_to(out: &Path) {
    let world = format!(
        "[clocks]\nunix_start_us = {UNIX_START_US}\npi_boot_ns = {PI_BOOT_NS}\npi_skew_ppm = 10.0\n\
         pi_wall_offset_us = 4321.0\n"
    );
    small_rig::corner_session(&world, out);
}

/// One session for all tests of this file; their results do not conflict.
fn session() -> Session {
    static FOLDER: OnceLock<TempDir> = OnceLock::new();
    let folder = FOLDER.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("session");
        simulate_to(&out);
        let session = Session::open(&out).unwrap();
        for stream in ["aps", "raw", "rgb"] {
            tracked(&session, stream);
        }
        sync(&session, false).unwrap();
        folder
    });
    Session::open(&folder.path().join("session")).unwrap()
}

fn tracked(session: &Session, stream: &str) -> evrig::pipeline::Tracked {
    let request = TrackRequest { stream: stream.into(), rig: None, force: false };
    track(session, &request, &mut |_, _| {}).unwrap()
}

#[test]
fn frames_of_the_pi_are_mapped_to_their_true_times() {
    let session = session();
    let clocks = read_clocks(&session).unwrap().unwrap();
    assert_eq!(clocks.reference, TimeReference::Host);
    let at_ns = 500_000_000;
    // The Pi's clock gains 10 us per second.
    let sensor = Stamp::<PiSensor>::from_nanos(PI_BOOT_NS + at_ns + at_ns / 100_000);
    let truth = UNIX_START_US * 1_000 + at_ns;
    let error_ns = clocks.unix_from_sensor.map(sensor).unwrap().as_nanos() - truth;
    let [low, high] = clocks.unix_from_sensor.absolute95(sensor).map(|end| end.unwrap().as_nanos());
    let slack = 2_000;
    assert!(low - slack <= -error_ns && -error_ns <= high + slack, "{low} {error_ns} {high}");
    let ahead_us = clocks.wall_minus_host.unwrap().as_nanos() as f64 * 1e-3;
    assert!((ahead_us - 4_321.0).abs() < 1_000.0, "{ahead_us}");
    let frame_error_ns = clocks.davis_from_sensor.map(sensor).unwrap().as_nanos() - truth;
    assert!(frame_error_ns.abs() < 2_000_000, "{frame_error_ns} ns");
    let motion = clocks.motion.as_ref().expect("tracks of both cameras are there");
    // A third of a second of motion may be too short for an estimate; then none may be stated.
    match (&motion.estimate, &motion.refused) {
        (Some(found), None) => {
            let sigma_ns = found.correction_us.standard_error * 1e3;
            assert!(
                (frame_error_ns as f64).abs() < 4.0 * sigma_ns + 20_000.0,
                "{frame_error_ns} of {sigma_ns} ns"
            );
        }
        (_, because) => assert!(because.is_some(), "{motion:?}"),
    }
}

#[test]
fn the_tag_is_found_upright_in_every_frame_of_every_stream() {
    let session = session();
    for (stream, scale_px_per_mm) in [("aps", 1.922), ("raw", 7.524), ("rgb", 7.524)] {
        let again = tracked(&session, stream);
        assert_eq!(again.freshness, Freshness::Fresh);
        let summary = &again.summary;
        // Found in all frames; in a short series one or two may be rejected as outliers of the
        // path.
        assert!(summary.n_used * 100 >= summary.n_seen * 97, "{stream}: {summary:?}");
        let expected = 14.35 * scale_px_per_mm;
        assert!((summary.picture_px / expected - 1.0).abs() < 0.02, "{stream}: {summary:?}");
        let angle = match &again.track {
            AnyTrack::Davis(track) => {
                let [from, to] = track.span().unwrap();
                track.at(from + Span::from_nanos((to - from).as_nanos() / 2)).unwrap().roi().angle
            }
            AnyTrack::Pi(track) => {
                let [from, to] = track.span().unwrap();
                track.at(from + Span::from_nanos((to - from).as_nanos() / 2)).unwrap().roi().angle
            }
        };
        assert!(angle.0.abs() < 1.0, "{stream}: {angle:?}");
    }
}

fn generated(session: &Session, light: &str, preset: &str) -> StreamName {
    let choice = GeneratorChoice {
        model: None,
        law: None,
        preset: Some(preset),
        k: None,
        knobs: &[],
        full_scale_dn: None,
        seed: 1,
    };
    let name = StreamName::new(light).unwrap();
    let request = GenerateRequest {
        from: light.into(),
        name: name.clone(),
        parameters: GenerateParameters::from_choice(&choice).unwrap(),
        conditions: evrig::pipeline::Conditions::default(),
        force: false,
    };
    let made = generate(session, &request, &mut |_, _| {}).unwrap();
    assert!(made.tally.n_events > 100, "{light}: {:?}", made.tally);
    name
}

#[test]
fn real_and_generated_events_are_compared_in_target_coordinates() {
    let session = session();
    let raw = generated(&session, "raw", "Raw2DVS346");
    let real = StreamName::new("real").unwrap();
    let request =
        CompareRequest { real: "real".into(), simulated: raw.clone(), seed: 0, force: false };
    let refused = compare(&session, &request).unwrap_err();
    assert!(matches!(refused, PipelineError::Missing { .. }), "two grids: {refused}");
    assert!(refused.to_string().contains("evrig filter --crop"), "{refused}");
    let settings = FilterSettings { crop_px: Some(29), ..FilterSettings::default() };
    for stream in [real, raw] {
        let request = FilterRequest { stream, settings, force: false };
        let tally = filter(&session, &request).unwrap().tally;
        assert!(tally.events.balances() && tally.events.kept > 100, "{tally:?}");
        assert!(tally.events.n_dropped() > 0, "{tally:?}");
        let again = filter(&session, &request).unwrap();
        assert_eq!((again.freshness, again.tally), (Freshness::Fresh, tally));
    }
    let (comparison, _) = compare(&session, &request).unwrap();
    let size = comparison.maps.size.unwrap();
    assert_eq!((size.width, size.height), (29, 29));
    let html = report(&session).unwrap();
    for title in ["Clocks", "Interval convergence", "Tracking", "Filters"] {
        assert!(html.contains(title), "{title}");
    }
}

#[test]
fn a_wrong_tag_is_reported_and_no_track_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("session");
    simulate_to(&out);
    let manifest = out.join("session.json");
    let text = std::fs::read_to_string(&manifest).unwrap();
    assert!(text.contains("tag_id = 0"));
    std::fs::write(&manifest, text.replace("tag_id = 0", "tag_id = 7")).unwrap();
    let session = Session::open(&out).unwrap();
    let request = TrackRequest { stream: "aps".into(), rig: None, force: false };
    let error = track(&session, &request, &mut |_, _| {}).unwrap_err().to_string();
    assert!(error.contains("tag36h11 id 7") && error.contains("id 0"), "{error}");
    assert!(!out.join("derived/track-aps").exists());
}
