use super::*;
use crate::grid::pixel_centre;
use crate::interpolate::between;
use crate::rows::RowTimes;
use crate::voltmeter::Coefficients;
use crate::{EsimParameters, GenerateParameters, Generator, ModelParameters, build};
use evrig_core::event::Events;
use evrig_core::frame::Luminance;
use evrig_core::geometry::{Homography, Size};

const SIZE: Size = Size { width: 96, height: 64 };

/// A print that circles through the image, and turns a little.
#[derive(Clone, Copy)]
struct Circle;

impl Circle {
    fn matrix(t_us: f64) -> [[f64; 3]; 3] {
        let phase = t_us * 1e-6 * 5.0;
        let (sin, cos) = (0.05 * phase.sin()).sin_cos();
        // 24 px about the middle at 5 rad/s: 120 px/s, 4 px from frame to frame at 30 a second.
        [
            [cos, -sin, 24.0 * phase.cos()],
            [sin, cos, 24.0 * phase.sin()],
            [1e-4 * phase.sin(), 0.0, 1.0],
        ]
    }
}

impl PlanePath for Circle {
    fn pixel_from_plane(&self, t_us: f64) -> Option<Homography> {
        Some(Homography::from(Self::matrix(t_us)))
    }
}

/// Light on the print, of several scales.
fn print([x, y]: [f64; 2]) -> f64 {
    let waves: [[f64; 4]; 5] = [
        [0.11, 0.05, 0.0, 30.0],
        [-0.07, 0.13, 1.0, 24.0],
        [0.41, -0.37, 2.0, 12.0],
        [0.02, 0.03, 4.0, 30.0],
        [0.62, 0.55, 5.0, 8.0],
    ];
    120.0 + waves.iter().map(|[u, v, phase, a]| a * (u * x + v * y + phase).sin()).sum::<f64>()
}

/// What the camera sees, each row at its own time.
fn shot(t_us: i64, rows: RowTimes) -> Luminance {
    let value = |i: usize| {
        let [u, v] = pixel_centre(SIZE, i);
        let at = t_us as f64 + rows.after_us(v - 0.5);
        let back = Homography::from(Circle::matrix(at)).inverse().unwrap();
        print(back.apply([u, v])) as f32
    };
    Luminance { t_us, size: SIZE, values: (0..SIZE.n_pixels()).map(value).collect() }
}

fn between_frames(frame_us: i64, n: i64, rows: RowTimes) -> Vec<Luminance> {
    let mut interpolator = PlaneInterpolator::new(500, Box::new(Circle)).unwrap();
    interpolator.set_rows(rows);
    let mut made = Vec::new();
    for i in 0..n {
        let take = |frame: &Luminance| -> Result<(), ()> {
            made.push(frame.clone());
            Ok(())
        };
        interpolator.push(shot(i * frame_us, rows), take).unwrap();
    }
    assert_eq!(interpolator.n_in_place(), 0);
    made
}

/// Root mean square difference within the image.
fn apart(a: &Luminance, b: &Luminance) -> f64 {
    let margin = 8;
    let is_inner = |i: &usize| {
        let (x, y) = (i % 96, i / 96);
        x >= margin && y >= margin && x < 96 - margin && y < 64 - margin
    };
    let inner: Vec<usize> = (0..SIZE.n_pixels()).filter(is_inner).collect();
    let sum: f64 = inner.iter().map(|&i| f64::from(a.values[i] - b.values[i]).powi(2)).sum();
    (sum / inner.len() as f64).sqrt()
}

#[test]
fn between_frames_the_target_is_where_it_was_and_as_sharp() {
    for rows in [RowTimes::default(), RowTimes::about_middle(60.0, SIZE)] {
        let made = between_frames(33_333, 6, rows);
        assert!(made.windows(2).all(|pair| pair[0].t_us < pair[1].t_us));
        assert!(made.len() > 5 * 15, "4 px a frame in steps of a quarter: {}", made.len());
        for frame in &made {
            let truth = shot(frame.t_us, RowTimes::default());
            // The print's own contrast is 30 DN rms, and 3 px of motion lie between frames.
            assert!(apart(frame, &truth) < 0.4, "{} {rows:?}", apart(frame, &truth));
        }
        let plain = shot(33_333, rows);
        let halfway = between(&plain, &shot(66_666, rows), 0.5, 50_000);
        let fading = apart(&halfway, &shot(50_000, RowTimes::default()));
        assert!(fading > 2.0, "{fading}");
    }
}

fn esim() -> Box<dyn Generator> {
    let parameters = EsimParameters {
        threshold_on: 0.1,
        threshold_off: 0.1,
        log_offset: 1e-9,
        ..EsimParameters::PUBLISHED
    };
    let model = ModelParameters::Esim(parameters);
    build(
        &GenerateParameters { model, ..GenerateParameters::from_k(Coefficients::DVS346, 1) },
        None,
    )
    .unwrap()
}

fn events(frames: impl IntoIterator<Item = Luminance>) -> Events {
    let (mut generator, mut events) = (esim(), Events::new());
    frames.into_iter().for_each(|frame| generator.push(&frame, &mut events).unwrap());
    events
}

/// Median distance in time from an event to the nearest true one of its pixel and side, and the
/// share that has none within 20 ms; µs.
fn misses(found: &Events, truth: &Events) -> (f64, f64) {
    let mut by_pixel = vec![Vec::new(); 2 * SIZE.n_pixels()];
    let slot = |e: &evrig_core::event::Event| 2 * SIZE.index(e.x, e.y) + usize::from(e.on);
    truth.as_slice().iter().for_each(|event| by_pixel[slot(&event)].push(event.t));
    let mut all: Vec<f64> = Vec::new();
    for event in
        found.as_slice().iter().filter(|e| (8..88).contains(&e.x) && (8..56).contains(&e.y))
    {
        let times = &by_pixel[slot(&event)];
        let after = times.partition_point(|&t| t < event.t);
        let near = [after.checked_sub(1), Some(after)].into_iter().flatten();
        let apart = near.filter_map(|i| times.get(i)).map(|t| (t - event.t).abs()).min();
        all.push(apart.unwrap_or(1_000_000) as f64);
    }
    all.sort_by(f64::total_cmp);
    let n_lost = all.iter().filter(|t| **t > 20_000.0).count();
    (all[all.len() / 2], n_lost as f64 / all.len() as f64)
}

#[test]
fn the_frames_rhythm_leaves_the_events() {
    let (frame_us, n) = (33_333, 16);
    let truth = events((0..=2 * 500).map(|i| shot(i * 500, RowTimes::default())));
    let plain = events((0..n).map(|i| shot(i * frame_us, RowTimes::default())));
    let along = events(between_frames(frame_us, n, RowTimes::default()));
    let rhythm = |events: &Events| {
        let mut rhythm = crate::PhaseLocking::default();
        let frames: Vec<i64> = (0..n).map(|i| i * frame_us).collect();
        rhythm.add_between(events.as_slice(), &frames);
        rhythm.strength()
    };
    let [beats, rest] = [&plain, &along].map(|events| misses(events, &truth));
    assert!(rest.0 < 0.05 * beats.0, "{rest:?} {beats:?}");
    assert!(rest.1 < 0.2 * beats.1.max(0.01), "{rest:?} {beats:?}");
    let [true_beat, plain_beat, along_beat] = [&truth, &plain, &along].map(rhythm);
    assert!(
        (along_beat - true_beat).abs() < 0.2 * (plain_beat - true_beat).abs(),
        "{true_beat} {plain_beat} {along_beat}"
    );
    let count = |events: &Events| events.len() as f64;
    assert!((count(&along) / count(&truth) - 1.0).abs() < 0.02);
}

/// A path that is lost for a while.
struct Lost;

impl PlanePath for Lost {
    fn pixel_from_plane(&self, t_us: f64) -> Option<Homography> {
        Circle.pixel_from_plane(t_us).filter(|_| t_us < 40_000.0)
    }
}

#[test]
fn where_the_way_is_lost_frames_are_filled_pixel_by_pixel_and_counted() {
    let mut interpolator = PlaneInterpolator::new(1_000, Box::new(Lost)).unwrap();
    let mut times = Vec::new();
    for i in 0..4 {
        let take = |frame: &Luminance| -> Result<(), ()> {
            times.push(frame.t_us);
            Ok(())
        };
        interpolator.push(shot(i * 33_333, RowTimes::default()), take).unwrap();
    }
    assert_eq!(interpolator.n_in_place(), 2);
    assert!(times.windows(2).all(|pair| pair[0] < pair[1]));
    assert!(PlaneInterpolator::new(3, Box::new(Lost)).is_err());
}
