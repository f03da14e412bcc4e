//! The effects inside the pixels.

use crate::world::test_world::{N_PIXELS, TestWorld, by_pixel, n_on};
use evrig_core::event::Event;
use std::f64::consts::TAU;

/// Log contrast of the stripes: from white to 0.04.
fn contrast() -> f64 {
    -0.04_f64.ln()
}

/// Stripes of 4 mm over which the tool goes at 8 mm/s: two a second for each pixel in the image.
fn stripes() -> TestWorld {
    TestWorld::moving("stripes-4-0", 8.0)
}

/// What pixels in the image's middle fire while one whole period of the stripes passes, after they
/// have found their rhythm.
fn one_period(effects: &str) -> Vec<Event> {
    let events = stripes().with(effects).events(0.75);
    let is_inner = |event: &&Event| {
        (4..10).contains(&event.x) && (6..26).contains(&event.y) && event.t >= 250_000
    };
    events.iter().filter(is_inner).copied().collect()
}

#[test]
fn a_pixel_fires_once_per_threshold_of_log_contrast_that_passes() {
    let events = one_period("");
    let pixels = by_pixel(&events);
    assert_eq!(pixels.len(), 6 * 20);
    // Point spread and aperture take from both ends of a stripe its curvature times half their
    // variance. A pixel runs up and down one ladder of thresholds, so that of the rungs within the
    // contrast the outermost one is passed over each time.
    let curvature_per_mm2 = contrast() / 2.0 * (TAU / 4.0).powi(2);
    let px_mm = 18.5e-3 * 225.0 / 16.0;
    let variance_mm2 = (0.25 + 1.0 / 12.0) * px_mm * px_mm;
    let expected = (contrast() - curvature_per_mm2 * variance_mm2) / 0.19 - 1.0;
    for pixel in &pixels {
        let (on, off) = (n_on(pixel), pixel.len() as f64 - n_on(pixel));
        assert!((on - expected).abs() < 1.8, "{on} On, expected {expected}");
        assert!((on - off).abs() <= 2.0, "On and Off alike: {on}, {off}");
    }
    let mean = events.len() as f64 / pixels.len() as f64;
    assert!((mean - 2.0 * expected).abs() < 0.3, "{mean} against {}", 2.0 * expected);
}

#[test]
fn a_still_camera_under_steady_light_sees_nothing() {
    assert!(TestWorld::still("leaves-1").events(1.0).is_empty());
}

#[test]
fn a_refractory_period_leaves_a_hole_in_the_intervals() {
    let shortest = |stage: TestWorld| {
        let events = stage.events(0.3);
        let pixels = by_pixel(&events);
        let gaps = pixels.iter().flat_map(|p| p.windows(2).map(|w| w[1].t - w[0].t));
        (gaps.min().unwrap(), events.len())
    };
    let (free, n_free) = shortest(TestWorld::moving("leaves-1", 30.0));
    let dead = "refractory_period = { refractory_us = 4000 }";
    let (refractory, n_refractory) = shortest(TestWorld::moving("leaves-1", 30.0).with(dead));
    assert!(free < 1_500, "{free}");
    assert!(refractory >= 4_000, "{refractory}");
    assert!(n_refractory < n_free);
}

#[test]
fn leaks_fire_on_events_at_their_rate_in_proportion_to_light_where_it_is_light_that_leaks() {
    let rate = |stage: TestWorld| {
        let events = stage.events(2.0);
        assert_eq!(n_on(&events), events.len() as f64, "a leak fires On only");
        events.iter().filter(|event| event.t >= 1_000_000).count() as f64 / N_PIXELS
    };
    let junction = "junction_leak = { rate_hz = 5 }";
    assert!((rate(TestWorld::still("plain").with(junction)) - 5.0).abs() < 0.1);
    assert!((rate(TestWorld::still("plain").light(0.0, 0.2).with(junction)) - 5.0).abs() < 0.1);
    let photo = "photocurrent_leak = { rate_hz_at_white = 5 }";
    let bare = |stage: TestWorld| TestWorld { rig_changes: vec![NO_TAG], ..stage }.with(photo);
    let (bright, dim) =
        (bare(TestWorld::still("plain")), bare(TestWorld::still("plain").light(0.0, 0.2)));
    let (bright, dim) = (rate(bright), rate(dim));
    assert!((dim / bright - 0.2).abs() < 0.02, "{dim} over {bright}");
    assert!((bright - 5.0).abs() < 0.1, "{bright}");
}

/// The target moved out of sight: paper alone.
const NO_TAG: (&str, &str) =
    ("centre_mm = [270.0, 0.0, -138.0]", "centre_mm = [370.0, 0.0, -138.0]");

#[test]
fn a_warming_chip_leaks_more_and_more() {
    let drift = "temperature_drift = { rate_hz_per_s = 4 }";
    let events = TestWorld::still("plain").with(drift).events(2.0);
    let late = events.iter().filter(|event| event.t >= 1_000_000).count() as f64;
    let early = events.iter().filter(|event| (500_000..1_000_000).contains(&event.t)).count();
    // The integral of 4 t: 1.5 a pixel in the second half of the first second, 6 in the second.
    assert!((early as f64 / N_PIXELS - 1.5).abs() < 0.1, "{early}");
    assert!((late / N_PIXELS - 6.0).abs() < 0.2, "{late}");
}

fn alternation(events: &[Event]) -> f64 {
    let pixels = by_pixel(events);
    let pairs: Vec<_> = pixels.iter().flat_map(|p| p.windows(2)).collect();
    pairs.iter().filter(|pair| pair[0].on != pair[1].on).count() as f64 / pairs.len() as f64
}

#[test]
fn band_limited_noise_alternates_in_polarity_and_random_activity_does_not() {
    let noise = "shot_noise = { rms_thresholds = 0.4, bandwidth_hz = 60 }";
    let noisy = TestWorld::still("plain").with(noise).events(1.0);
    assert!(noisy.len() > 500, "{}", noisy.len());
    assert!(alternation(&noisy) > 0.75, "{}", alternation(&noisy));
    let random = "background_activity = { rate_hz = 5 }";
    let random = TestWorld::still("plain").with(random).events(1.0);
    assert!((random.len() as f64 / N_PIXELS - 5.0).abs() < 0.25);
    assert!((alternation(&random) - 0.5).abs() < 0.03);
}

/// Mean lag of ON events behind those of the nominal world, in seconds, from their phase in the
/// stripes.
fn lag_s(effects: &str) -> f64 {
    let phase = |effects: &str| {
        let frequency = 2.0;
        let (sin, cos) = one_period(effects).iter().filter(|event| event.on).fold(
            (0.0, 0.0),
            |(sin, cos), event| {
                // A pixel to the right sees a stripe earlier: 3.84 px a mm, 8 mm a second.
                let x_mm = f64::from(event.x) / (16.0 / (18.5e-3 * 225.0));
                let turn = TAU * (frequency * event.t as f64 * 1e-6 + x_mm / 4.0);
                (sin + turn.sin(), cos + turn.cos())
            },
        );
        sin.atan2(cos) / (TAU * frequency)
    };
    phase(effects) - phase("")
}

#[test]
fn poles_and_latency_delay_events_by_what_they_say() {
    let pole = lag_s("fixed_pole = { cutoff_hz = 30 }");
    let tau = 1.0 / (TAU * 30.0);
    assert!((pole - tau).abs() < 0.1 * tau, "{pole} against {tau}");
    let latency = lag_s("pixel_latency = { latency_us = 2500 }");
    assert!((latency - 2.5e-3).abs() < 5e-5, "{latency}");
    let receptor = lag_s("photoreceptor_bandwidth = { cutoff_hz_at_white = 300 }");
    let at_white = 1.0 / (TAU * 300.0);
    assert!(
        receptor > 2.0 * at_white && receptor < 20.0 * at_white,
        "darkness is slower: {receptor}"
    );
}

#[test]
fn what_slows_a_pixel_costs_events_where_things_are_fast() {
    let count = |effects: &str| {
        TestWorld::moving("stripes-2-0", 60.0).with(effects).events(0.05).len() as f64
    };
    let base = count("");
    for slow in [
        "fixed_pole = { cutoff_hz = 20 }",
        "photoreceptor_bandwidth = { cutoff_hz_at_white = 40, order = 2 }",
        "slew_limit = { per_s = 40 }",
        "threshold_fatigue = { rise = 0.3, recovery_s = 0.2 }",
    ] {
        assert!(count(slow) < 0.8 * base, "{slow}: {} of {base}", count(slow));
    }
}

#[test]
fn a_pixel_that_adapts_answers_a_step_of_light_with_the_opposite_later() {
    let step = || TestWorld::still("plain").light(0.0, 0.3).light(0.2, 1.0);
    let plain = step().events(1.0);
    assert!(!plain.is_empty() && plain.iter().all(|event| event.on));
    let slow = "adaptation = { time_constant_s = 0.15, fraction = 0.8 }";
    let adapted = step().with(slow).events(1.0);
    let (up, down): (Vec<Event>, Vec<Event>) = adapted.iter().partition(|event| event.on);
    let mean_time = |events: &[Event]| {
        events.iter().map(|event| event.t as f64).sum::<f64>() / events.len() as f64
    };
    assert!(down.len() > plain.len() / 2, "{} Off of {} On", down.len(), up.len());
    assert!(mean_time(&down) > mean_time(&up) + 50_000.0);
}

#[test]
fn dark_current_takes_contrast_from_the_dark() {
    let count = |effects: &str| one_period(effects).len() as f64;
    let (bare, dark) = (count(""), count("dark_current = { fraction_of_white = 0.05 }"));
    let expected = (1.05_f64 / 0.09).ln() / contrast();
    assert!((dark / bare - expected).abs() < 0.05, "{} against {expected}", dark / bare);
}

#[test]
fn unequal_thresholds_balance_their_counts_over_a_whole_period() {
    let uneven = "threshold_asymmetry = { on_off_ratio = 1.5 }";
    let events = one_period(uneven);
    let ratio = n_on(&events) / (events.len() as f64 - n_on(&events));
    assert!((ratio - 1.0 / 1.5).abs() < 0.06, "{ratio}");
}

#[test]
fn mismatched_thresholds_give_each_pixel_its_own_count() {
    let spread = |effects: &str| {
        let events = one_period(effects);
        let counts: Vec<f64> = by_pixel(&events).iter().map(|p| p.len() as f64).collect();
        let mean = counts.iter().sum::<f64>() / counts.len() as f64;
        let square = counts.iter().map(|n| (n - mean).powi(2)).sum::<f64>() / counts.len() as f64;
        square.sqrt() / mean
    };
    assert!(spread("") < 0.04, "{}", spread(""));
    let uneven = spread("threshold_mismatch = { sigma_relative = 0.15 }");
    assert!((uneven - 0.14).abs() < 0.05, "{uneven}");
}

#[test]
fn hot_pixels_fire_at_rest_and_dead_ones_never() {
    let hot = "hot_pixels = { fraction = 0.02 }\ndead_pixels = { count = 40 }";
    let resting = TestWorld::still("plain").with(hot).events(1.0);
    let n_hot = by_pixel(&resting).len() as f64;
    assert!((n_hot - 0.02 * N_PIXELS).abs() < 18.0, "{n_hot}");
    assert!(by_pixel(&resting).iter().all(|pixel| (9..=301).contains(&pixel.len())));
    let flash = || TestWorld::still("plain").light(0.0, 0.3).light(0.1, 1.0);
    let alive = by_pixel(&flash().events(0.3)).len();
    let left = by_pixel(&flash().with("dead_pixels = { count = 40 }").events(0.3)).len();
    assert_eq!(alive - left, 40);
}

#[test]
fn an_effect_limited_to_a_region_stays_in_it() {
    let leak = "junction_leak = { rate_hz = 10 }\nregion = { x_px = [5, 20], y_px = [0, 10] }";
    let events = TestWorld::still("plain").with(leak).events(0.5);
    assert!(events.len() > 500);
    assert!(events.iter().all(|event| (5..20).contains(&event.x) && event.y < 10));
}
