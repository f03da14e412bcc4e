//! Clocks planted in a session's evidence come back.

use super::*;
use evrig_core::units::Pixels;
use rand::rngs::StdRng;
use rand::{Rng, SeedableRng};

/// What the host's clock shows more than the Pi's boot clock.
const HOST_NS: i64 = 1_699_945_679_000_123_456;
/// What the Pi's wall clock shows more than the host's.
const WALL_AHEAD_NS: i64 = 7_300_000;
const FRAMES: i64 = 1_200;
const PERIOD_NS: i64 = 8_333_000;
const READOUT_NS: i64 = 6_000_000;

fn sensor(k: i64) -> Stamp<PiSensor> {
    Stamp::from_nanos(54_321_000_000_000 + k * PERIOD_NS)
}

fn host(at: Stamp<PiSensor>) -> Stamp<Unix> {
    Stamp::from_nanos(at.as_nanos() + HOST_NS)
}

fn wall(at: Stamp<PiSensor>) -> Stamp<Unix> {
    host(at) + Span::from_nanos(WALL_AHEAD_NS)
}

fn ns(dice: &mut StdRng, low: i64, high: i64) -> Span {
    Span::from_nanos(dice.random_range(low..high))
}

fn frames(dice: &mut StdRng) -> Vec<FramePair> {
    (0..FRAMES)
        .map(|k| {
            let latency = Span::from_nanos(READOUT_NS) + ns(dice, 40_000, 2_000_000);
            let real = wall(sensor(k) + latency);
            FramePair::new(sensor(k), Stamp::from_micros(real.as_micros()))
        })
        .collect()
}

/// Both kinds of readings, ten times a second: 2 us inside the Pi, 0.2 to 3 ms over the network.
fn readings(dice: &mut StdRng) -> (Vec<TwoSidedReading>, Vec<TwoSidedReading>) {
    let each = (0..FRAMES).step_by(12).map(|k| {
        let at = sensor(k);
        let wall_reading = TwoSidedReading {
            group: k as u64,
            before: at - Span::from_micros(1),
            real: wall(at),
            after: at + Span::from_micros(1),
        };
        let asked = host(at) - ns(dice, 100_000, 1_500_000);
        let answered = host(at) + ns(dice, 100_000, 1_500_000);
        (wall_reading, host_reading(k as u64, asked, [at; 2], answered))
    });
    each.unzip()
}

fn error(
    estimate: &ClockEstimate<Davis, PiSensor>,
    truth: Stamp<Unix>,
    at: Stamp<PiSensor>,
) -> i64 {
    estimate.map(at).unwrap().as_nanos() - truth.as_nanos()
}

#[test]
fn readings_on_both_sides_give_the_hosts_clock_within_their_bounds() {
    let mut dice = StdRng::seed_from_u64(1);
    let frames = frames(&mut dice);
    let (wall_readings, host_readings) = readings(&mut dice);
    let readout = Some(Span::from_nanos(READOUT_NS));
    let evidence = ClockObservations {
        frames,
        wall_readings,
        host_readings,
        readout,
        ..ClockObservations::default()
    };
    let clocks = synchronise(&evidence).unwrap();
    assert_eq!(clocks.reference, TimeReference::Host);
    let at = sensor(FRAMES / 2);
    let wrong = error(&clocks.davis_from_sensor, host(at), at);
    let [low, high] = clocks.davis_from_sensor.absolute95(at).map(|end| end.unwrap().as_nanos());
    assert!(low <= -wrong && -wrong <= high, "{low} {wrong} {high}");
    assert!(high - low < 500_000, "the quickest of a hundred answers bound it: {low} {high}");
    let ahead = clocks.wall_minus_host.unwrap().as_nanos();
    assert!((ahead - WALL_AHEAD_NS).abs() < 300_000, "{ahead}");
    assert_eq!(clocks.wall.len(), 6, "every method was run");
    // Files with the former keys are still read.
    let mut former = serde_json::to_value(&clocks).unwrap();
    former["late"] = serde_json::json!([{ "stream": "rgb", "against": "raw", "late_us": null, "refused": null }]);
    former["events"]["because"] = former["events"]["reason"].take();
    former.as_object_mut().unwrap().remove("stream_delays");
    former["events"].as_object_mut().unwrap().remove("reason");
    let back: SessionClocks = serde_json::from_value(former).unwrap();
    assert_eq!((back.stream_delays.len(), back.events.reason), (1, clocks.events.reason.clone()));
    assert!(clocks.wall.iter().all(|attempt| attempt.estimate.is_some()));
}

#[test]
fn frames_alone_give_the_pis_wall_clock_and_state_it() {
    let mut dice = StdRng::seed_from_u64(2);
    let readout = Some(Span::from_nanos(READOUT_NS));
    let evidence =
        ClockObservations { frames: frames(&mut dice), readout, ..ClockObservations::default() };
    let clocks = synchronise(&evidence).unwrap();
    assert_eq!(clocks.reference, TimeReference::PiWall);
    assert_eq!(clocks.unix_from_sensor.method, Method::Envelope);
    let at = sensor(FRAMES / 2);
    let wrong = error(&clocks.davis_from_sensor, wall(at), at);
    assert!(
        (0..100_000).contains(&wrong),
        "late by what lies between readout and handing over: {wrong}"
    );
    assert!(clocks.events.is_as_stamped && clocks.wall_minus_host.is_none());
}

#[test]
fn a_host_too_busy_to_take_packets_does_not_make_their_stamps_wrong() {
    // For two thirds of the time what is taken falls behind, by up to three seconds.
    let arrivals: Vec<FramePair<Unix, Davis>> = (0..500)
        .map(|k| {
            let at = host(sensor(k));
            let behind = Span::from_micros(2_000 + 10_000 * (k - 150).clamp(0, 300));
            FramePair::new(Stamp::from_nanos(at.as_nanos()), at + behind)
        })
        .collect();
    let clock = events_clock(&arrivals);
    assert!(clock.is_as_stamped, "{}", clock.reason);
}

#[test]
fn events_that_arrive_before_their_stamps_are_on_another_clock() {
    let mut dice = StdRng::seed_from_u64(3);
    let ahead = Span::from_micros(4_000_000);
    let mut arrivals = |early: Span| -> Vec<FramePair<Unix, Davis>> {
        (0..500)
            .map(|k| {
                let at = host(sensor(k));
                let stamp = Stamp::from_nanos((at + early).as_nanos());
                FramePair::new(stamp, at + ns(&mut dice, 1_000_000, 3_000_000))
            })
            .collect()
    };
    let (honest, wrong) = (events_clock(&arrivals(Span::ZERO)), events_clock(&arrivals(ahead)));
    assert!(honest.is_as_stamped, "{}", honest.reason);
    assert!(!wrong.is_as_stamped, "{}", wrong.reason);
    let at = host(sensor(250));
    let mapped = wrong.unix_from_davis.map(Stamp::from_nanos((at + ahead).as_nanos()));
    assert!((mapped - at).as_nanos() < 1_200_000, "within the quickest transport: {}", mapped - at);
}

#[test]
fn a_session_without_any_usable_stamp_is_refused_with_the_reason() {
    let error = synchronise(&ClockObservations::default()).unwrap_err().to_string();
    assert!(error.contains("0 usable frames"), "{error}");
}

/// A figure of eight as the DAVIS sees it, and as the Pi does when its clock is `late_us` behind
/// what the readings say; `stray_px` of another motion on top.
fn figures(late_us: i64, stray_px: f64) -> (Vec<TrackSample<Davis>>, Vec<TrackSample<PiSensor>>) {
    let place = |t_s: f64, radius_px: f64| {
        let turn = std::f64::consts::TAU * 0.5 * t_s;
        [radius_px * turn.cos(), radius_px * (2.0 * turn).sin()]
    };
    // A hundredth of a pixel one way or the other, ten times what is stated.
    let off = |k: i64, salt: i64| ((k * 7_919 + salt * 104_729) % 1_000) as f64 * 2e-5 - 0.01;
    let sample = |k: i64, [x, y]: [f64; 2]| (Pixels(x + off(k, 1)), Pixels(y + off(k, 2)));
    let error = Pixels(0.001);
    let davis = (0..400).map(|k| {
        let t_s = k as f64 / 40.0;
        let (x, y) = sample(k, place(t_s, 20.0));
        let at = Stamp::from_nanos(host(sensor(0)).as_nanos() + (t_s * 1e9) as i64);
        TrackSample { at, x, y, error }
    });
    let pi = (0..FRAMES).map(|k| {
        let t_s = (k * PERIOD_NS + late_us * 1_000) as f64 * 1e-9;
        let [x, y] = place(t_s, 80.0);
        let stray = stray_px * (3.1 * t_s).sin();
        let (x, y) = sample(k, [x + stray, y]);
        TrackSample { at: sensor(k), x, y, error }
    });
    (davis.collect(), pi.collect())
}

fn refined(late_us: i64, stray_px: f64) -> SessionClocks {
    let mut dice = StdRng::seed_from_u64(5);
    let frames = frames(&mut dice);
    let (wall_readings, host_readings) = readings(&mut dice);
    let evidence =
        ClockObservations { frames, wall_readings, host_readings, ..ClockObservations::default() };
    let mut clocks = synchronise(&evidence).unwrap();
    let (davis, pi) = figures(late_us, stray_px);
    let options = MotionOptions { search: Span::from_micros(50_000), ..MotionOptions::default() };
    clocks.refine(["aps", "raw"], &davis, &pi, &options);
    clocks
}

#[test]
fn a_motion_that_both_cameras_saw_decides_though_its_tracks_state_too_small_an_error() {
    let clocks = refined(3_000, 0.0);
    let motion = clocks.motion.as_ref().unwrap();
    let found = motion.estimate.as_ref().unwrap();
    assert!(motion.refused.is_none() && found.chi2_per_dof > 4.0, "{motion:?}");
    assert_eq!(clocks.davis_from_sensor.method, Method::Motion);
    let at = sensor(FRAMES / 2);
    let wrong = error(&clocks.davis_from_sensor, host(at), at) - 3_000_000;
    let [low, high] = clocks.davis_from_sensor.absolute95(at).map(|end| end.unwrap().as_nanos());
    assert!(2 * low <= -wrong && -wrong <= 2 * high, "{low} {wrong} {high}");
    assert!(high < 200_000, "{high}");
}

#[test]
fn tracks_of_two_motions_do_not_decide_and_the_reason_is_kept() {
    let clocks = refined(3_000, 4.0);
    let refused = clocks.motion.as_ref().unwrap().refused.clone().unwrap();
    assert!(!refused.is_empty());
    assert_eq!(clocks.davis_from_sensor.method, Method::ClockPair);
}
