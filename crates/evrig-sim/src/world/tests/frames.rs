//! What the frame camera must show.

use crate::world::test_world::TestWorld;
use crate::world::{CameraName, PiTwin, SimulatedPiFrame};
use evrig_core::frame::Samples;
use evrig_core::time::Span;
use std::f64::consts::TAU;

const WIDTH: usize = 120;
const HEIGHT: usize = 80;

fn frames(stage: &TestWorld, n: usize) -> Vec<SimulatedPiFrame> {
    let mut twin = PiTwin::new(stage.world(), Span::ZERO);
    (0..n).map(|_| twin.next_frame()).collect()
}

fn raw(frame: &SimulatedPiFrame) -> Vec<f64> {
    let Some(Samples::U16(samples)) = frame.raw.as_ref().map(|raw| &raw.samples) else {
        panic!("a raw frame")
    };
    samples.iter().map(|sample| f64::from(*sample)).collect()
}

/// Green samples of even rows: the second pixel of each pair.
fn green_row(raw: &[f64], row: usize) -> Vec<f64> {
    raw[row * WIDTH..(row + 1) * WIDTH].iter().skip(1 - row % 2).step_by(2).copied().collect()
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// The target moved out of sight: paper alone.
const PAPER: (&str, &str) =
    ("centre_mm = [270.0, 0.0, -138.0]", "centre_mm = [370.0, 0.0, -138.0]");

fn paper() -> TestWorld {
    TestWorld { rig_changes: vec![PAPER], ..TestWorld::still("plain") }
}

/// Row time in microseconds, read off the bands that a flickering lamp draws on bare paper.
fn row_time_us(effects: &str) -> f64 {
    let mut stage =
        paper().with(&format!("flicker = {{ frequency_hz = 2000, depth = 0.5 }}\n{effects}"));
    stage.rig_changes.push(("exposure_us = 4000.0", "exposure_us = 60.0"));
    let raw = raw(&frames(&stage, 1)[0]);
    let rows: Vec<f64> = (0..HEIGHT).map(|row| mean(&green_row(&raw, row))).collect();
    let level = mean(&rows);
    let power = |row_us: f64| {
        let (sin, cos) = rows.iter().enumerate().fold((0.0, 0.0), |(sin, cos), (row, value)| {
            let turn = TAU * 2000.0 * row as f64 * row_us * 1e-6;
            (sin + (value - level) * turn.sin(), cos + (value - level) * turn.cos())
        });
        f64::hypot(sin, cos)
    };
    let candidates = (200..4_000).map(|hundredths| f64::from(hundredths) / 100.0);
    candidates.max_by(|a, b| power(*a).total_cmp(&power(*b))).unwrap()
}

#[test]
fn the_row_time_can_be_read_off_the_bands_of_a_flickering_lamp() {
    assert!((row_time_us("") - 9.21).abs() < 0.6, "{}", row_time_us(""));
    let slow = row_time_us("rolling_shutter = { row_us = 20 }");
    assert!((slow - 20.0).abs() < 0.6, "{slow}");
}

#[test]
fn noise_grows_with_the_signal_as_shot_noise_does() {
    let variance = |light: f64, effects: &str| {
        let frames = frames(&paper().light(0.0, light).with(effects), 12);
        let rows: Vec<Vec<f64>> = frames.iter().map(|frame| green_row(&raw(frame), 40)).collect();
        let n = rows.len() as f64;
        let of_pixel = |i: usize| {
            let values: Vec<f64> = rows.iter().map(|row| row[i]).collect();
            let level = mean(&values);
            values.iter().map(|v| (v - level).powi(2)).sum::<f64>() / (n - 1.0)
        };
        let variances: Vec<f64> = (0..WIDTH / 2).map(of_pixel).collect();
        mean(&variances)
    };
    // 0.8 DN of read noise, 6.3 electrons a DN, 1/12 DN^2 of rounding.
    let fixed = 0.64 + 1.0 / 12.0;
    for light in [0.05, 1.0] {
        let expected = fixed + 700.0 * light / 6.3;
        let got = variance(light, "");
        assert!((got / expected - 1.0).abs() < 0.2, "{light}: {got} against {expected}");
    }
    let noisier = variance(0.05, "frame_noise = { sigma_dn = 10 }");
    assert!((noisier - variance(0.05, "") - 100.0).abs() < 20.0, "{noisier}");
}

#[test]
fn the_pedestal_is_what_is_left_in_the_dark() {
    let dark = |effects: &str| mean(&raw(&frames(&paper().light(0.0, 0.0).with(effects), 1)[0]));
    assert!((dark("") - 64.0).abs() < 0.1);
    assert!((dark("black_level = { offset_dn = 12.5 }") - 76.5).abs() < 0.1);
}

#[test]
fn a_tone_curve_bends_and_does_not_move_black() {
    let level = |light: f64, effects: &str| {
        mean(&green_row(&raw(&frames(&paper().light(0.0, light).with(effects), 1)[0]), 10)) - 64.0
    };
    let bent = "tone_curve = { gamma = 0.5 }";
    for light in [0.1, 0.5] {
        let expected = 959.0 * (700.0 * light / 959.0_f64).sqrt();
        assert!((level(light, bent) / expected - 1.0).abs() < 0.02, "{}", level(light, bent));
        assert!((level(light, "") / (700.0 * light) - 1.0).abs() < 0.02);
    }
}

#[test]
fn a_longer_exposure_blurs_what_moves_and_is_no_brighter() {
    let stripes = |effects: &str| {
        let stage = TestWorld::moving("stripes-2-0", 60.0).with(effects);
        // Frames at 8.3 ms: the tool has gone 0.5 mm.
        let raw = raw(&frames(&stage, 2)[1]);
        let row = green_row(&raw, 40);
        let image = &row[8..30];
        let (low, high) =
            image.iter().fold((f64::MAX, 0.0_f64), |(l, h), v| (l.min(*v), h.max(*v)));
        ((high - low) / (high + low - 128.0), mean(&green_row(&raw, 2)))
    };
    let ((sharp, paper), (blurred, same_paper)) =
        (stripes(""), stripes("exposure_blur = { exposure_us = 8300 }"));
    // In 8.3 ms it goes 0.5 mm, a quarter of a period.
    assert!(blurred < 0.97 * sharp, "{blurred} of {sharp}");
    assert!((paper / same_paper - 1.0).abs() < 0.02);
}

#[test]
fn the_image_is_at_its_true_position() {
    let stage = TestWorld::still("plain");
    let world = stage.world();
    let [[left, top], ..] = world.tag_corners_mm();
    let raw = raw(&frames(&stage, 1)[0]);
    // A row through the upper border of the tag, which is black from its left edge on.
    let middle = world.pixel_of_place(CameraName::Pi, [left, top + 0.18], Span::ZERO).unwrap();
    let row = middle[1] as usize;
    let green = green_row(&raw, row);
    let half = 64.0 + 700.0 * 0.52;
    let column = |i: usize| (2 * i + 1 - row % 2) as f64 + 0.5;
    let edge = (20..green.len()).find(|i| green[*i] < half).unwrap();
    let part = (green[edge - 1] - half) / (green[edge - 1] - green[edge]);
    let found = column(edge - 1) + 2.0 * part;
    assert!((found - middle[0]).abs() < 0.35, "{found} against {}", middle[0]);
}

#[test]
fn white_paper_is_white_in_rgb() {
    let frame = &frames(&paper(), 1)[0];
    let Some(Samples::U8(bgr)) = frame.rgb.as_ref().map(|rgb| &rgb.samples) else { panic!("rgb") };
    let channel =
        |c: usize| mean(&bgr.chunks_exact(3).map(|pixel| f64::from(pixel[c])).collect::<Vec<_>>());
    let expected = 255.0 * 0.85_f64.powf(1.0 / 2.2);
    for c in 0..3 {
        assert!((channel(c) - expected).abs() < 1.5, "{c}: {} {expected}", channel(c));
    }
}

#[test]
fn the_camera_reports_what_the_rig_states_and_when_it_delivered() {
    let mut stage = TestWorld::still("plain");
    stage.description.pi.drop_fraction = 0.3;
    stage.description.clocks.pi_wall_steps = vec![[0.25, 5_000.0]];
    let world = stage.world();
    let frames = frames(&stage, 60);
    let numbers: Vec<u64> = frames.iter().map(|frame| frame.metadata.sequence).collect();
    assert!(numbers.windows(2).all(|pair| pair[0] < pair[1]) && numbers[59] > 70, "{numbers:?}");
    for frame in &frames {
        let message = frame.metadata;
        let true_end = Span::from_secs_f64(message.sequence as f64 / 120.0);
        assert!(
            (message.sensor_timestamp - world.clocks().pi_sensor(true_end)).as_nanos().abs()
                < 2_000
        );
        let step = if true_end.as_secs_f64() > 0.26 { 5_000 } else { 0 };
        let late = (message.real_time - world.clocks().unix(true_end)).as_micros();
        assert!(late > 7_000 && (true_end.as_secs_f64() < 0.23 || late - step > 7_000), "{late}");
        let timing = frame.raw.as_ref().unwrap().timing;
        let [begin, end] = timing.exposure.unwrap();
        assert_eq!((end - begin).as_micros(), 4_000);
        assert_eq!((end - timing.stamp).as_nanos(), 172 * 9_210);
    }
}
