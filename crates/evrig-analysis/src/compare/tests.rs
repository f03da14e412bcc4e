//! Whole comparisons with planted truths.

use super::*;
use evrig_core::event::{Event, Events};
use evrig_core::stats::Estimate;
use evrig_core::stats::SplitMix;

const SIZE: Size = Size::new(48, 48);
const WINDOW: [i64; 2] = [0, 4_000_000];

fn setup(seed: u64) -> Setup<'static> {
    Setup { size: SIZE, window: WINDOW, region: None, seed, n_bootstrap: 200, frames: None }
}

/// Events at random pixels and times, several to a microsecond.
fn scattered(n: usize, seed: u64) -> Events {
    let mut random = SplitMix::new(seed, 1);
    let mut event = || Event {
        t: (random.below(4_000) * 1_000) as i64,
        x: random.below(48) as u16,
        y: random.below(30) as u16,
        on: random.below(3) > 0,
    };
    let mut events: Events = (0..n).map(|_| event()).collect();
    events.sort_by_time();
    events
}

fn of(events: &Events, other: &Events) -> Comparison {
    compare(events.as_slice(), other.as_slice(), &setup(1)).unwrap()
}

fn estimate(comparison: &Comparison, id: MeasureId) -> Estimate {
    comparison.measure(id).unwrap().estimate
}

fn value(comparison: &Comparison, id: MeasureId) -> f64 {
    estimate(comparison, id).value
}

const ALL: [(MeasureId, f64); 10] = [
    (MeasureId::CountRatio, 1.0),
    (MeasureId::PolarityDelta, 0.0),
    (MeasureId::ActivePixelRatio, 1.0),
    (MeasureId::SpatialEntropyRatio, 1.0),
    (MeasureId::SpatialEmd, 0.0),
    (MeasureId::IntervalTv, 0.0),
    (MeasureId::IntervalEmd, 0.0),
    (MeasureId::IntervalKs, 0.0),
    (MeasureId::TemporalEmd, 0.0),
    (MeasureId::EventImageSsim, 1.0),
];

#[test]
fn a_stream_against_itself_is_ideal_in_every_measure_without_error() {
    let events = scattered(20_000, 3);
    let comparison = of(&events, &events);
    for (id, ideal) in ALL {
        let estimate = estimate(&comparison, id);
        assert!((estimate.value - ideal).abs() < 1e-12, "{id:?}: {estimate:?}");
        assert!(estimate.standard_error < 1e-12, "{id:?}: {estimate:?}");
        let healthy = comparison.measure(id).unwrap().is_healthy();
        assert_ne!(healthy, Some(false), "{id:?}");
    }
    let psnr = comparison.measure(MeasureId::EventImagePsnr).unwrap();
    assert!(psnr.unknown_because.as_ref().is_some_and(|because| because.contains("infinite")));
    assert_eq!(comparison.curves.intervals.real, comparison.curves.intervals.simulated);
    assert!(comparison.curves.rate_map.rmse_hz.value < 1e-12);
}

#[test]
fn the_order_within_a_microsecond_does_not_matter() {
    let (real, simulated) = (scattered(20_000, 3), scattered(15_000, 4));
    let mut turned: Vec<Event> = real.as_slice().iter().collect();
    turned.reverse();
    let mut turned: Events = turned.into_iter().collect();
    turned.sort_by_time();
    assert_ne!(turned, real, "ties were turned around");
    assert_eq!(of(&turned, &simulated), of(&real, &simulated));
}

#[test]
fn the_same_pixel_mirror_and_time_shift_of_both_streams_do_not_matter() {
    let (real, simulated) = (scattered(20_000, 3), scattered(15_000, 4));
    let moved = |events: &Events| -> Events {
        let moved = |e: Event| Event { t: e.t + 1_600_000_000_000_000, x: 47 - e.x, ..e };
        events.as_slice().iter().map(moved).collect()
    };
    let window = WINDOW.map(|t| t + 1_600_000_000_000_000);
    let there = Setup { window, ..setup(1) };
    let here = of(&real, &simulated);
    let there = compare(moved(&real).as_slice(), moved(&simulated).as_slice(), &there).unwrap();
    for (id, _) in ALL {
        let (here, there) = (value(&here, id), value(&there, id));
        // Of equally short ways the mirrored transport may choose others, a little straighter.
        let slack = if id == MeasureId::SpatialEmd { 1e-3 * here } else { 1e-9 };
        assert!((here - there).abs() < slack, "{id:?}: {here} and {there}");
    }
}

#[test]
fn swapped_polarities_of_both_streams_keep_every_measure() {
    let (real, simulated) = (scattered(20_000, 3), scattered(15_000, 4));
    let swapped = |events: &Events| -> Events {
        events.as_slice().iter().map(|e| Event { on: !e.on, ..e }).collect()
    };
    let (as_is, swapped) = (of(&real, &simulated), of(&swapped(&real), &swapped(&simulated)));
    for (id, _) in ALL {
        let (a, b) = (value(&as_is, id), value(&swapped, id));
        assert!((a - b).abs() < 1e-12, "{id:?}: {a} and {b}");
    }
}

/// `n` events at each of `pixels`, `interval` apart, the first `n_on` of them On.
fn trains(pixels: &[(u16, u16)], n: i64, interval: i64, n_on: i64) -> Events {
    let train = |&(x, y): &(u16, u16)| {
        (0..n).map(move |i| Event { t: 1_000 + i * interval, x, y, on: i < n_on })
    };
    let mut events: Events = pixels.iter().flat_map(train).collect();
    events.sort_by_time();
    events
}

#[test]
fn planted_differences_come_out_as_planted() {
    let square = |from: u16, n: u16| -> Vec<(u16, u16)> {
        (0..n * n).map(|i| (from + i % n, 4 + i / n)).collect()
    };
    let real = trains(&square(2, 12), 20, 1_000, 8);
    let simulated = trains(&square(26, 12), 30, 10_000, 15);
    let comparison = of(&real, &simulated);
    let check = |id, expected: f64| {
        let found = value(&comparison, id);
        assert!((found - expected).abs() < 1e-9, "{id:?}: {found}, planted {expected}");
    };
    check(MeasureId::CountRatio, 1.5);
    check(MeasureId::PolarityDelta, 0.5 - 0.4);
    check(MeasureId::ActivePixelRatio, 1.0);
    check(MeasureId::SpatialEntropyRatio, 1.0);
    check(MeasureId::IntervalTv, 1.0);
    let moved = value(&comparison, MeasureId::SpatialEmd);
    assert!((moved - 24.0).abs() < 1e-6, "{moved} px, planted 24");
    let stretched = value(&comparison, MeasureId::IntervalEmd);
    assert!((stretched - 1.0).abs() < 1e-6, "{stretched} decades, planted 1");
    let exact = comparison.curves.intervals.distance_decades.value;
    assert!((exact - 1.0).abs() < 1e-9, "{exact} decades, planted 1");
    let wider = of(&trains(&square(2, 10), 5, 500, 5), &trains(&square(2, 20), 5, 500, 5));
    assert!((value(&wider, MeasureId::ActivePixelRatio) - 4.0).abs() < 1e-9);
    let entropies = 400_f64.ln() / 100_f64.ln();
    assert!((value(&wider, MeasureId::SpatialEntropyRatio) - entropies).abs() < 1e-9);
}

#[test]
fn planted_delays_and_images_come_out_as_planted() {
    // Every interval is 20 ms in one stream and 40 ms in a quarter of the pixels of the other.
    let pixels: Vec<(u16, u16)> = (0..400).map(|i| (i % 20, i / 20)).collect();
    let real = trains(&pixels, 50, 20_000, 25);
    let delayed: Events =
        real.as_slice().iter().map(|event| Event { t: event.t + 250_000, ..event }).collect();
    let comparison = of(&real, &delayed);
    let delay = value(&comparison, MeasureId::TemporalEmd);
    assert!((delay - 250.0).abs() < 1e-9, "{delay} ms, planted 250");
    assert!(value(&comparison, MeasureId::IntervalKs) < 1e-12);
    let mut mixed: Vec<Event> = trains(&pixels[100..], 50, 20_000, 25).as_slice().iter().collect();
    mixed.extend(trains(&pixels[..100], 50, 40_000, 25).as_slice().iter());
    let mut mixed: Events = mixed.into_iter().collect();
    mixed.sort_by_time();
    let ks = value(&of(&real, &mixed), MeasureId::IntervalKs);
    assert!((ks - 0.25).abs() < 1e-9, "{ks}, planted 0.25");

    // One event at every pixel of each image against none, and against the opposite polarity: mean
    // square differences 1 and 4 against a range of 4.
    let every: Vec<(u16, u16)> = (0..2304).map(|i| (i % 48, i / 48)).collect();
    let flash = |on: bool| -> Events {
        let flashes =
            (0..160_i64).flat_map(|k| every.iter().map(move |&p| (25_000 * k + 12_500, p)));
        flashes.map(|(t, (x, y))| Event { t, x, y, on }).collect()
    };
    let in_no_image: Events = [Event { t: 0, x: 0, y: 0, on: true }].into_iter().collect();
    for (other, square) in [(in_no_image, 1.0), (flash(false), 4.0)] {
        let found = value(&of(&flash(true), &other), MeasureId::EventImagePsnr);
        let planted = 10.0 * (16.0_f64 / square).log10();
        assert!((found - planted).abs() < 1e-9, "{found} dB, planted {planted}");
    }
}

#[test]
fn a_region_leaves_the_rest_out() {
    let real = trains(&[(3, 3), (40, 40)], 20, 1_000, 8);
    let simulated = trains(&[(3, 3)], 20, 1_000, 8);
    let mut region = vec![false; SIZE.n_pixels()];
    region[SIZE.index(3, 3)] = true;
    let within = Setup { region: Some(&region), ..setup(1) };
    let comparison = compare(real.as_slice(), simulated.as_slice(), &within).unwrap();
    assert_eq!((comparison.n_real, comparison.n_pixels), (20, 1));
    assert!((value(&comparison, MeasureId::CountRatio) - 1.0).abs() < 1e-12);
}

#[test]
fn a_signed_count_that_follows_the_change_correlates_and_noise_does_not() {
    // Pixel columns brighten from left to right; the real stream gives as many events.
    let change = |_: usize, out: &mut [f32]| {
        out.iter_mut().enumerate().for_each(|(p, c)| *c = (p % 48) as f32 - 20.0);
    };
    let frames = FrameChanges { times_us: &[0, 2_000_000, 3_999_999], change: &change };
    let mut real = Events::new();
    for (step, x, y) in
        (0..20).flat_map(|s| (0..40).flat_map(move |x| (0..40).map(move |y| (s, x, y))))
    {
        if (f64::from(x) - 20.0).abs() > f64::from(step) {
            for start in [0, 2_000_000] {
                real.push(Event { t: start + i64::from(step), x, y, on: x > 20 });
            }
        }
    }
    real.sort_by_time();
    let noise = scattered(50_000, 9);
    let with_frames = Setup { frames: Some(frames), ..setup(1) };
    let result = compare(real.as_slice(), noise.as_slice(), &with_frames).unwrap();
    let correlation = result.curves.contrast_correlation.unwrap();
    assert_eq!(correlation.per_interval.len(), 2);
    assert_eq!(correlation.per_interval[1].t_us, [2_000_000, 3_999_999]);
    assert!(correlation.real.value > 0.7, "{:?}", correlation.real);
    let noise = correlation.simulated;
    assert!(noise.value.abs() < 4.0 * noise.standard_error, "{noise:?}");
    assert!(noise.standard_error < 0.15, "{noise:?}");
}

#[test]
fn the_number_of_threads_changes_nothing() {
    let (real, simulated) = (scattered(20_000, 3), scattered(15_000, 4));
    let with = |n_threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().unwrap();
        serde_json::to_string(&pool.install(|| of(&real, &simulated))).unwrap()
    };
    assert_eq!(with(1), with(5));
}

#[test]
fn streams_without_events_give_unknown_measures_that_say_why() {
    let some = scattered(1_000, 3);
    let none = Events::new();
    let single: Events = [Event { t: 5, x: 1, y: 1, on: true }].into_iter().collect();
    for (real, simulated) in
        [(&none, &some), (&some, &none), (&none, &none), (&single, &some), (&single, &single)]
    {
        let comparison = of(real, simulated);
        for measure in &comparison.measures {
            let is_known = measure.estimate.value.is_finite();
            assert_eq!(is_known, measure.unknown_because.is_none(), "{measure:?}");
        }
        let json = serde_json::to_string(&comparison).unwrap();
        let back: Comparison = evrig_core::stats::read_back(&json).unwrap();
        let ids =
            |comparison: &Comparison| comparison.measures.iter().map(|m| m.id).collect::<Vec<_>>();
        assert_eq!(ids(&back), ids(&comparison));
        assert_eq!(back.measures[0].unknown_because, comparison.measures[0].unknown_because);
        assert!(back.measures[4].estimate.value.is_nan() != back.measures[4].estimate.is_known());
    }
    let ratio = of(&none, &some);
    let ratio = ratio.measure(MeasureId::CountRatio).unwrap();
    assert_eq!(ratio.unknown_because.as_deref(), Some("there are no real events"));
    assert_eq!((ratio.real, ratio.simulated), (Some(0.0), Some(1_000.0)));
}

#[test]
fn the_json_has_the_keys_that_consumers_rely_on() {
    let json = serde_json::to_value(of(&scattered(2_000, 3), &scattered(2_000, 4))).unwrap();
    assert_eq!(json["schema"], "evrig.comparison/1");
    let ids: Vec<&str> =
        json["measures"].as_array().unwrap().iter().map(|m| m["id"].as_str().unwrap()).collect();
    let expected = [
        "count_ratio",
        "polarity_delta",
        "active_pixel_ratio",
        "spatial_entropy_ratio",
        "spatial_emd",
        "interval_tv",
        "interval_emd",
        "interval_ks",
        "temporal_emd",
        "event_image_ssim",
        "event_image_psnr",
    ];
    assert_eq!(ids, expected);
    assert!(json["measures"][0]["estimate"]["ci90"][1].is_number());
    assert_eq!(json["measures"][5]["healthy"][1], 0.25);
    assert!(json.get("maps").is_none(), "maps are for npy");
    assert!(json["curves"]["intervals"]["real"]["fit"]["shape_us"]["value"].is_number());
    assert_eq!(json["curves"]["rate"]["real_on"]["hz"].as_array().unwrap().len(), 240);
}

#[test]
fn what_cannot_be_compared_is_refused_by_name() {
    let good = scattered(10, 3);
    let at = |t, x| Event { t, x, y: 0, on: true };
    let disordered: Events = [at(5, 0), at(9, 0), at(8, 0)].into_iter().collect();
    let outside: Events = [at(5, 0), at(6, 48)].into_iter().collect();
    let refuse = |real: &Events, simulated: &Events, setup: Setup<'_>| {
        compare(real.as_slice(), simulated.as_slice(), &setup).unwrap_err()
    };
    let error = refuse(&disordered, &good, setup(1));
    let (stream, index, t_us, previous_us) = (ComparedStream::Real, 2, 8, 9);
    assert_eq!(error, CompareError::TimeNotAscending { stream, index, t_us, previous_us });
    let error = refuse(&good, &outside, setup(1)).to_string();
    assert!(error.starts_with("simulated event 1 is at pixel (48, 0), outside"), "{error}");
    for window in [[5, 5], [9, 3], [i64::MIN, i64::MAX]] {
        let error = refuse(&good, &good, Setup { window, ..setup(1) });
        assert!(matches!(error, CompareError::BadWindow { .. }), "{error}");
    }
    let error = refuse(&good, &good, Setup { region: Some(&[true; 7]), ..setup(1) });
    assert!(matches!(error, CompareError::RegionSize { found: 7, expected: 2304, .. }));
    let nowhere = vec![false; SIZE.n_pixels()];
    let error = refuse(&good, &good, Setup { region: Some(&nowhere), ..setup(1) });
    assert_eq!(error, CompareError::NoPixels { size: SIZE });
    let change = |_: usize, _: &mut [f32]| {};
    let frames = Some(FrameChanges { times_us: &[5, 9, 9], change: &change });
    let error = refuse(&good, &good, Setup { frames, ..setup(1) });
    assert!(matches!(error, CompareError::FramesNotAscending { index: 2, .. }));
}

#[test]
fn a_window_shorter_than_its_bins_and_stamps_at_the_ends_of_time_are_fine() {
    let pair = |t: i64| -> Events {
        [t, t].into_iter().map(|t| Event { t, x: 2, y: 2, on: true }).collect()
    };
    for window in [[7, 8], [i64::MIN, i64::MIN + 9], [i64::MAX - 9, i64::MAX]] {
        let events = pair(window[0]);
        let short = Setup { window, ..setup(1) };
        let comparison = compare(events.as_slice(), events.as_slice(), &short).unwrap();
        assert_eq!(comparison.n_real, 2);
        assert_eq!(comparison.curves.intervals.real.n_zero, 1);
        assert!(comparison.curves.intervals.real.fit.is_none());
    }
}
