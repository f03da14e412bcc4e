//! Planted truths on streams made from first principles, and streams without any effect.

use super::*;
use evrig_core::stats::Estimate;

const SIZE: Size = Size::new(48, 64);

fn random(seed: u64) -> SplitMix {
    SplitMix::new(seed, 11)
}

/// Poisson events over the whole sensor, thinned to `share(t)` of a rate per second.
fn poisson(hz: f64, seconds: f64, seed: u64, share: impl Fn(f64) -> f64) -> Vec<Event> {
    let (mut random, mut t, mut events) = (random(seed), 0.0, Vec::new());
    loop {
        t += random.exponential() / hz;
        if t >= seconds {
            return events;
        }
        let (x, y) = (random.below(48) as u16, random.below(64) as u16);
        let on = random.uniform() < 0.5;
        if random.uniform() < share(t) {
            events.push(Event { t: (t * 1e6) as i64, x, y, on });
        }
    }
}

fn stream(events: Vec<Event>) -> Events {
    let mut events: Events = events.into_iter().collect();
    events.sort_by_time();
    events
}

fn frames(period_us: i64, n: i64) -> FrameStarts {
    FrameStarts::new((0..n).map(|i| i * period_us).collect(), FrameReference::ExposureStart)
}

/// Bursts: at each frame a share of the pixels fires after a delay linear in the row.
fn bursts(period_us: i64, n: i64, [delay, row]: [f64; 2], share: f64, on: bool) -> Vec<Event> {
    let mut random = random(99 + delay as u64);
    let mut events = Vec::new();
    for start in (0..n).map(|i| i * period_us) {
        for y in 0..64 {
            for x in 0..48 {
                if random.uniform() < share {
                    let us = delay + row * f64::from(y) + 8.0 * random.normal();
                    events.push(Event { t: start + us.round().max(0.0) as i64, x, y, on });
                }
            }
        }
    }
    events
}

/// A renewal process per pixel whose hazard is `hz` times `rise(lag in us)`.
fn renewal(hz: f64, seconds: f64, seed: u64, rise: impl Fn(f64) -> f64) -> Events {
    let mut random = random(seed);
    let mut events = Vec::new();
    for y in 0..64 {
        for x in 0..48 {
            let (mut t, mut last) = (1e6 * random.uniform() / hz, f64::NEG_INFINITY);
            while t < 1e6 * seconds {
                if random.uniform() < rise(t - last) {
                    let on = random.uniform() < 0.5;
                    events.push(Event { t: t as i64, x, y, on });
                    last = t;
                }
                t += 1e6 * random.exponential() / hz;
            }
        }
    }
    stream(events)
}

fn report(events: &Events, frames: Option<&FrameStarts>) -> CameraReport {
    camera_report(events.as_slice(), SIZE, frames).unwrap()
}

fn is_near(estimate: &Estimate, truth: f64) -> bool {
    (estimate.value - truth).abs() < 4.0 * estimate.standard_error
}

#[test]
fn a_poisson_stream_shows_nothing_beyond_the_stated_level() {
    let mut claims = [0; 6];
    for seed in 0..20 {
        let events = stream(poisson(12_000.0, 2.0, seed, |_| 1.0));
        let found = report(&events, Some(&frames(10_000, 200)));
        let pixels = found.pixels.known().unwrap();
        let has_onset = |onset: &SectionResult<RefractoryOnset>| {
            onset.known().is_some_and(|onset| onset.shape != OnsetShape::Absent)
        };
        let claimed = [
            !found.frame_coupling.known().unwrap().bursts.is_empty(),
            !pixels.hot.is_empty() || !pixels.silent.is_empty(),
            found.refractory.iter().any(has_onset),
            !found.rate_lines.known().unwrap().lines.is_empty(),
            found.readout.known().unwrap().ceiling_hz.is_some(),
            !found.rates.gaps.is_empty(),
        ];
        claims.iter_mut().zip(claimed).for_each(|(n, is_claimed)| *n += i32::from(is_claimed));
        assert!(!found.stamp_step.known().unwrap().is_coarse());
    }
    // At a level of 1 %, two claims of a kind in twenty streams have a probability of 1.7 %.
    assert!(claims.iter().all(|n| *n <= 1), "{claims:?}");
}

#[test]
fn bursts_that_sweep_over_the_rows_either_way_are_found_with_their_polarity() {
    let (period, n) = (10_000, 200);
    let mut events = poisson(12_000.0, 2.0, 1, |_| 1.0);
    events.extend(bursts(period, n, [3_000.0, -21.5], 0.002, true));
    events.extend(bursts(period, n, [6_200.0, 40.25], 0.001, false));
    let found = report(&stream(events), Some(&frames(period, n)));
    let coupling = found.frame_coupling.known().unwrap();
    let [on, off] = &coupling.bursts[..] else { panic!("{coupling:?}") };
    for (burst, polarity, [delay, row]) in
        [(on, PolarityName::On, [3_000.0, -21.5]), (off, PolarityName::Off, [6_200.0, 40.25])]
    {
        assert_eq!(burst.polarity, polarity);
        assert!(is_near(&burst.delay_us, delay), "{:?}", burst.delay_us);
        assert!(is_near(&burst.row_us, row), "{:?}", burst.row_us);
        assert!(burst.row_us.standard_error < 0.2 && burst.delay_us.standard_error < 8.0);
        assert!(burst.halves_z.iter().all(|z| *z > 3.0));
        assert!(burst.other_polarity_share.value.abs() < 0.01);
    }
    // A share of 0.002 of the pixels in 200 frames, of these and half of the Poisson events.
    let n_burst = 0.002 * 3_072.0 * 200.0;
    let truth = n_burst / (n_burst + 12_000.0);
    assert!((on.share.value - truth).abs() < 0.01, "{:?} {truth}", on.share);
}

#[test]
fn the_frame_period_is_found_where_the_file_holds_no_frames() {
    let (period, n) = (25_000, 120);
    let mut events = poisson(8_000.0, 3.0, 2, |_| 1.0);
    events.extend(bursts(period, n, [2_000.0, 90.0], 0.003, true));
    let found = report(&stream(events), None);
    let coupling = found.frame_coupling.known().unwrap();
    assert_eq!(coupling.reference, FrameReference::FoundPeriod);
    assert!((coupling.frame_period_us - 25_000.0).abs() < 2.0, "{}", coupling.frame_period_us);
    assert!(is_near(&coupling.bursts[0].row_us, 90.0), "{:?}", coupling.bursts[0].row_us);
}

#[test]
fn a_flash_in_few_frames_is_no_coupling() {
    let mut events = poisson(12_000.0, 2.0, 3, |_| 1.0);
    events.extend(bursts(100_000, 4, [3_000.0, 0.0], 0.1, true));
    let found = report(&stream(events), Some(&frames(10_000, 200)));
    let coupling = found.frame_coupling.known().unwrap();
    assert!(coupling.bursts.is_empty(), "{:?}", coupling.bursts);
    assert!(!coupling.rejected.is_empty());
}

#[test]
fn a_hard_refractory_period_is_told_from_a_soft_onset() {
    let hard = renewal(30.0, 2.0, 4, |us| f64::from(us >= 2_000.0));
    for onset in report(&hard, None).refractory.iter().map(|onset| onset.known().unwrap()) {
        assert_eq!(onset.shape, OnsetShape::Hard, "{onset:?}");
        assert!((onset.period_us.value - 2_000.0).abs() < 30.0, "{:?}", onset.period_us);
        assert!(onset.is_stable && onset.shortest_us[0] >= 2_000.0);
    }
    let soft = renewal(30.0, 2.0, 5, |us| (us / 3_000.0).powi(2).min(1.0));
    for onset in report(&soft, None).refractory.iter().map(|onset| onset.known().unwrap()) {
        assert_eq!(onset.shape, OnsetShape::Soft, "{onset:?}");
        // The hazard is half of its highest value at 3 ms / sqrt(2).
        assert!((onset.period_us.value - 2_121.0).abs() < 250.0, "{:?}", onset.period_us);
    }
}

#[test]
fn hot_and_dead_pixels_are_listed_and_no_others() {
    let mut events = poisson(60_000.0, 8.0, 6, |_| 1.0);
    events.retain(|event| (event.x, event.y) != (20, 30));
    let mut random = random(7);
    for (x, y) in [(5, 5), (40, 60), (0, 0)] {
        let n = 8 * 200;
        events.extend((0..n).map(|_| Event { t: random.below(8_000_000) as i64, x, y, on: true }));
    }
    let found = report(&stream(events), None);
    let pixels = found.pixels.known().unwrap();
    let mut hot: Vec<(u16, u16)> = pixels.hot.iter().map(|hot| (hot.x, hot.y)).collect();
    hot.sort_unstable();
    assert_eq!(hot, [(0, 0), (5, 5), (40, 60)]);
    assert_eq!(pixels.silent, [[20, 30]]);
    assert!((pixels.hot[0].rate_hz.value - 220.0).abs() < 20.0 && pixels.hot[0].on_share > 0.9);
}

#[test]
fn a_step_of_the_stamps_is_found_and_hides_nothing_else() {
    let mut events = poisson(12_000.0, 2.0, 8, |_| 1.0);
    events.iter_mut().for_each(|event| event.t = event.t / 500 * 500);
    let found = report(&stream(events), Some(&frames(10_000, 200)));
    let step = found.stamp_step.known().unwrap();
    assert!(step.is_exact && step.step_us == 500.0);
    assert!(found.rate_lines.known().unwrap().lines.is_empty(), "the step is no flicker");
    assert!(found.frame_coupling.known().is_none_or(|found| found.bursts.is_empty()));
}

#[test]
fn a_flickering_light_is_a_line_and_the_frame_rate_is_none() {
    let flicker = |t: f64| 0.5 + 0.2 * (std::f64::consts::TAU * 120.0 * t).sin();
    let mut events = poisson(40_000.0, 3.0, 9, flicker);
    events.extend(bursts(40_000, 75, [2_000.0, 10.0], 0.01, true));
    let found = report(&stream(events), Some(&frames(40_000, 75)));
    let lines = found.rate_lines.known().unwrap();
    let [line] = &lines.lines[..] else { panic!("{:?}", lines.lines) };
    assert!(is_near(&line.frequency_hz, 120.0), "{:?}", line.frequency_hz);
    assert!((line.amplitude.value - 0.4).abs() < 0.06, "{:?}", line.amplitude);
    assert!(line.tile.is_none());
}

#[test]
fn background_activity_is_that_of_the_noise() {
    // 12 000 events per second on 3072 pixels, half of each polarity.
    let found = report(&stream(poisson(12_000.0, 2.0, 10, |_| 1.0)), None);
    let background = found.background.known().unwrap();
    let truth = 12_000.0 / 3_072.0 / 2.0;
    assert!(is_near(&background.on_hz, truth) && is_near(&background.off_hz, truth));
}

#[test]
fn a_saturated_bus_has_a_service_time_and_a_silence_is_a_gap() {
    let mut free_at = 0;
    let mut events = poisson(30_000.0, 1.0, 11, |_| 1.0);
    for event in &mut events {
        free_at = (free_at + 50).max(event.t);
        event.t = free_at;
    }
    let readout = report(&stream(events), None).readout;
    let service = readout.known().unwrap().service_us.unwrap();
    assert!((service.value - 50.0).abs() < 1.0, "{service:?}");
    let mut events = poisson(30_000.0, 1.0, 12, |_| 1.0);
    events.iter_mut().filter(|e| e.t > 400_000).for_each(|e| e.t += 3_000);
    let gaps = report(&stream(events), None).rates.gaps;
    assert_eq!(gaps.len(), 1);
    assert!((gaps[0].length_us - 3_000).abs() < 500 && gaps[0].begin_us <= 400_000);
}

#[test]
fn the_ratio_of_thresholds_is_that_of_the_counts_of_busy_pixels() {
    let mut events = poisson(100_000.0, 2.0, 13, |_| 1.0);
    let mut random = random(14);
    events.retain(|event| event.on || random.uniform() < 0.8);
    let ratio = report(&stream(events), None).threshold_ratio;
    assert!(is_near(&ratio.known().unwrap().on_over_off, 0.8), "{ratio:?}");
}

#[test]
fn few_events_give_reasons_and_impossible_ones_an_error() {
    let event = |t, on| Event { t, x: 1, y: 1, on };
    for n in [1, 2, 30, 400] {
        for on in [true, false] {
            let events = stream((0..n).map(|i| event(i * 700, on)).collect());
            let found = report(&events, Some(&frames(10_000, 1)));
            assert!(found.frame_coupling.known().is_none());
            assert!(found.threshold_ratio.known().is_none());
            let json = serde_json::to_value(&found).unwrap();
            let reason = json["threshold_ratio"]["not_measured"].as_str().unwrap();
            assert!(reason.contains("needed"), "{reason}");
        }
    }
    let empty = camera_report(Events::new().as_slice(), SIZE, None);
    assert_eq!(empty.unwrap_err(), CameraReportError::NoEvents);
    let disorder: Events = [event(5, true), event(3, true)].into_iter().collect();
    let error = camera_report(disorder.as_slice(), SIZE, None).unwrap_err();
    assert_eq!(error, CameraReportError::Disorder { index: 1 });
    let one = Size::new(1, 1);
    let outside = stream(vec![event(5, true)]);
    let error = camera_report(outside.as_slice(), one, None).unwrap_err();
    assert_eq!(error, CameraReportError::Outside { index: 0, size: one });
}
