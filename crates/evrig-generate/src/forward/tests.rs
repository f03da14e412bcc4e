use super::*;
use crate::effect::EffectSet;
use crate::effect::RecordingContext;
use crate::ks;
use crate::voltmeter::Coefficients;
use evrig_core::drive::{Drive, TimeGrid};
use evrig_core::event::Events;
use evrig_core::geometry::Size;

const SIZE: Size = Size { width: 40, height: 30 };

/// Log intensity over white as a function of column, row and seconds.
struct SyntheticDrive<F>(F);

fn synthetic<F: Fn(f64, f64, f64) -> f64 + Send + Sync>(f: F) -> SyntheticDrive<F> {
    SyntheticDrive(f)
}

impl<F: Fn(f64, f64, f64) -> f64 + Send + Sync> Drive for SyntheticDrive<F> {
    fn size(&self) -> Size {
        SIZE
    }

    fn span_us(&self) -> [i64; 2] {
        [0, i64::MAX]
    }

    fn white_dn(&self) -> f64 {
        100.0
    }

    fn sample(&self, place: [f64; 2], grid: TimeGrid, out: &mut [f32]) -> bool {
        for (i, out) in out.iter_mut().enumerate() {
            *out = (self.0)(place[0], place[1], grid.at(i) as f64 * 1e-6) as f32;
        }
        out.iter().any(|x| x.is_finite())
    }

    fn error(&self, _place: [f64; 2]) -> f32 {
        f32::NAN
    }
}

fn forward(k: [f64; 6], words: &[&str], step_us: u32) -> ForwardSimulator {
    let k = Coefficients::new(k).unwrap();
    let effects = EffectSet::from_words(words).unwrap();
    ForwardSimulator::new(ForwardParameters { k, effects, step_us }, RecordingContext::default())
        .unwrap()
}

fn all_pixels() -> Vec<(u16, u16)> {
    (0..SIZE.height).flat_map(|y| (0..SIZE.width).map(move |x| (x, y))).collect()
}

fn wave() -> SyntheticDrive<impl Fn(f64, f64, f64) -> f64 + Send + Sync> {
    synthetic(|x, y, t| 0.6 * (0.5 * x + 0.2 * y - 30.0 * t).sin() - 1.0)
}

/// Times between events of one pixel, µs, and sides.
fn intervals(events: &Events) -> Vec<(f64, bool)> {
    let mut last = vec![None; SIZE.n_pixels()];
    let mut found = Vec::new();
    for event in events.as_slice().iter() {
        if let Some(before) = last[SIZE.index(event.x, event.y)].replace(event.t) {
            found.push(((event.t - before) as f64, event.on));
        }
    }
    found
}

const NOISY: &[&str] = &[
    "shot_noise:rms_thresholds=0.3,bandwidth_hz=200",
    "threshold_mismatch:sigma_relative=0.1",
    "background_activity:rate_hz=1",
    "event_drop:fraction=0.1",
];

#[test]
fn a_pixels_events_do_not_depend_on_threads_or_on_which_other_pixels_run() {
    let forward = forward([5.0, 1.0, 1e-4, 1e-7, 1e-9, 1e-5], NOISY, 1_000);
    let pool = |n| rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap();
    let run = |pixels: &[(u16, u16)]| forward.run(&wave(), pixels, [0, 1_000_000], 5).unwrap();
    let pixels = all_pixels();
    let whole = pool(1).install(|| run(&pixels));
    assert_eq!(whole, pool(3).install(|| run(&pixels)));
    assert_eq!(whole.n_with_signal, SIZE.n_pixels());
    let some = [(7, 3), (39, 29), (0, 0)];
    let part = run(&some);
    let expected: Events =
        whole.events.as_slice().iter().filter(|e| some.contains(&(e.x, e.y))).collect();
    assert!(part.events == expected && expected.len() > 100);
    assert_ne!(whole.events, forward.run(&wave(), &pixels, [0, 1_000_000], 6).unwrap().events);
}

/// Exact mean and coefficient of variation of the time between events for drift `mu` a second
/// and noise `sigma` a root second, from 0 between barriers at ±1, b = mu/sigma²:
/// E T = tanh(b)/mu, Var T = (tanh b − b sech² b)/(sigma⁴ b³).
fn law(mu: f64, sigma: f64) -> (f64, f64) {
    let b = mu / (sigma * sigma);
    let sech = 1.0 / b.cosh();
    let mean = b.tanh() / mu;
    let variance = (b.tanh() - b * sech * sech) / (sigma.powi(4) * b.powi(3));
    (mean, variance.sqrt() / mean)
}

#[test]
fn white_noise_gives_the_exact_intervals_at_any_step_of_the_grid() {
    for (mu, sigma) in [(2.0, 0.3), (1.0, 1.0), (0.3, 2.0)] {
        for step_us in [2_000, 20_000] {
            let k = [1.0, 1e-9, 0.0, mu * 1e-6, 0.0, sigma * 1e-3];
            let seconds = 40.0;
            let run = forward(k, &[], step_us).run(
                &synthetic(|_, _, _| -1.0),
                &all_pixels(),
                [0, (seconds * 1e6) as i64],
                9,
            );
            let found = intervals(&run.unwrap().events);
            let (mean, cv) = law(mu, sigma);
            let n = found.len() as f64;
            let found_mean = found.iter().map(|(t, _)| t * 1e-6).sum::<f64>() / n;
            let square = found.iter().map(|(t, _)| (t * 1e-6 - found_mean).powi(2)).sum::<f64>();
            let found_cv = (square / n).sqrt() / found_mean;
            // Long intervals are cut by the window's end: a bias of about a share mean/window.
            assert!((found_mean / mean - 1.0).abs() < 0.03, "{found_mean} {mean} at {step_us}");
            assert!((found_cv / cv - 1.0).abs() < 0.05, "{found_cv} {cv} at {step_us}");
            let b = mu / (sigma * sigma);
            let on = found.iter().filter(|(_, on)| *on).count();
            ks::assert_share(on, found.len(), 1.0 / (1.0 + (-2.0 * b).exp()));
        }
    }
}

#[test]
fn noise_that_is_put_off_has_the_law_of_noise_that_is_drawn() {
    // The lazy path is taken while nothing can be reached; a large step is always drawn.
    let slope = |step_us| {
        let k = [1.0, 1e-9, 0.0, 0.0, 0.0, 1e-4];
        let drive = synthetic(|x: f64, y: f64, t: f64| 3.0 * t + 0.01 * x + 0.0031 * y);
        let run = forward(k, &[], step_us).run(&drive, &all_pixels(), [0, 4_000_000], 3);
        intervals(&run.unwrap().events).into_iter().map(|(t, _)| t).collect::<Vec<f64>>()
    };
    let (fine, coarse) = (slope(1_000), slope(100_000));
    ks::assert_same_law(&fine, &coarse);
}

#[test]
fn band_limited_noise_scatters_the_events_of_a_slope_and_leaves_their_number() {
    let drive = synthetic(|x, _, t: f64| 4.0 * t + 0.01 * x);
    let run = |words: &[&str]| {
        let found = forward([5.0, 1e-9, 0.0, 0.0, 0.0, 0.0], words, 1_000)
            .run(&drive, &all_pixels(), [0, 3_000_000], 4)
            .unwrap();
        let gaps: Vec<f64> = intervals(&found.events).iter().map(|(t, _)| *t).collect();
        let mean = gaps.iter().sum::<f64>() / gaps.len() as f64;
        let square = gaps.iter().map(|gap| (gap - mean).powi(2)).sum::<f64>();
        (found.events.len() as f64, (square / gaps.len() as f64).sqrt())
    };
    let (plain, even) = run(&[]);
    let (noisy, scattered) = run(&["shot_noise:rms_thresholds=0.1,bandwidth_hz=100"]);
    assert!((noisy / plain - 1.0).abs() < 0.01, "{noisy} {plain}");
    // A threshold takes 50 ms; the noise at both ends is 0.14 of it, less what crosses first.
    assert!(even < 2.0 && (3_000.0..9_000.0).contains(&scattered), "{even} {scattered}");
}

#[test]
fn scattered_thresholds_spread_a_slopes_events_and_fire_by_themselves_when_drawn_anew() {
    let pixels = all_pixels();
    let run = |drive: &dyn Drive, scatter: ThresholdScatter| {
        let plain = forward([5.0, 1e-9, 0.0, 0.0, 0.0, 0.0], &[], 1_000);
        let adjust = |_: u16, _: u16, pixel: &mut PixelModel| pixel.scatter = Some(scatter);
        plain.run_with(drive, &pixels, [0, 3_000_000], 4, &adjust).unwrap().events
    };
    // Five thresholds a second and unit of the logarithm: twenty events a second.
    let slope = synthetic(|x, _, t: f64| 4.0 * t + 0.01 * x);
    let drawn = run(&slope, ThresholdScatter { scale: 0.1, light_exponent: 0.0, redrawn_hz: 0.0 });
    let found: Vec<f64> = intervals(&drawn).iter().map(|(us, _)| us * 20e-6).collect();
    let n = found.len() as f64;
    let mean = found.iter().sum::<f64>() / n;
    let sd = (found.iter().map(|theta| (theta - mean).powi(2)).sum::<f64>() / n).sqrt();
    assert!((mean - 1.0).abs() < 0.01 && (sd / 0.181_4 - 1.0).abs() < 0.03, "{mean} {sd}");
    // At rest each draw passes either threshold by chance; the law is broader in the dark.
    let rest = synthetic(|_, _, _| -1.0);
    let scatter = ThresholdScatter { scale: 0.2, light_exponent: 0.5, redrawn_hz: 20.0 };
    let by_itself = run(&rest, scatter).len() as f64 / (3.0 * SIZE.n_pixels() as f64);
    let chance = 1.0 / (1.0 + (1.0 / (0.2 * 0.5_f64.exp())).exp());
    assert!((by_itself / (2.0 * 20.0 * chance) - 1.0).abs() < 0.08, "{by_itself} {chance}");
}

#[test]
fn light_behind_the_end_of_the_drive_gives_no_event_and_no_panic() {
    let drive = synthetic(|x, _, t| if t > 0.5 || x < 20.0 { f64::NAN } else { 10.0 * t });
    let run = forward([5.0, 1.0, 1e-4, 1e-7, 1e-9, 1e-5], NOISY, 1_000).run(
        &drive,
        &all_pixels(),
        [0, 1_000_000],
        1,
    );
    let run = run.unwrap();
    assert_eq!(run.n_with_signal, SIZE.n_pixels() / 2);
    let background = run.events.as_slice().iter().filter(|e| e.t > 501_000).count();
    assert!(background < SIZE.n_pixels(), "only what comes without light");
}

#[test]
fn what_cannot_be_run_is_refused_with_the_reason() {
    let forward = forward([5.0, 1e-9, 0.0, 0.0, 0.0, 0.0], &[], 1_000);
    let error = |pixels: &[(u16, u16)], window| {
        forward.run(&wave(), pixels, window, 0).unwrap_err().to_string()
    };
    assert!(error(&[(40, 0)], [0, 1000]).contains("(40, 0)"));
    assert!(error(&[(0, 0)], [1000, 1000]).contains("window"));
    assert!(error(&[(0, 0)], [i64::MIN, i64::MAX]).contains("steps"));
    let hot = Coefficients::new([1e4, 1e-9, 0.0, 0.0, 0.0, 1.0]).unwrap();
    let parameters = ForwardParameters { k: hot, effects: EffectSet::none(), step_us: 1_000 };
    let hot = ForwardSimulator::new(parameters.clone(), RecordingContext::default()).unwrap();
    let error = hot.run(&wave(), &[(1, 2)], [0, 1_000_000], 0).unwrap_err();
    assert!(error.to_string().contains("(1, 2)"), "{error}");
    let fine = ForwardSimulator::new(
        ForwardParameters { step_us: 1, ..parameters.clone() },
        RecordingContext::default(),
    );
    assert!(fine.unwrap_err().to_string().contains("1 us"));
    let effects = EffectSet::from_words(&["aps_coupling:events_fraction=0.1,delay_us=0,row_us=0"]);
    let parameters = ForwardParameters { effects: effects.unwrap(), ..parameters };
    let error = ForwardSimulator::new(parameters, RecordingContext::default()).unwrap_err();
    assert!(error.to_string().contains("starts of exposure"), "{error}");
}

/// A camera without noise of its own.
fn camera(on_over_nominal: f64) -> CameraConstants {
    let k = Coefficients::new([5.0, 1.0, 0.0, 1e-7, 0.0, 0.0]).unwrap();
    let effects = EffectSet::from_words(&["refractory_period:refractory_us=900"]).unwrap();
    CameraConstants {
        generator: ForwardParameters { k, effects, step_us: 1_000 },
        on_over_nominal,
        noise: BandNoise { rms: 0.0, bandwidth_hz: 200.0, light_exponent: 0.0 },
        scatter: ThresholdScatter { scale: 0.0, light_exponent: 0.0, redrawn_hz: 100.0 },
        background_hz: 0.0,
    }
}

fn seen_by(camera: &CameraConstants) -> Events {
    let around = RecordingContext::default();
    camera.events(&wave(), &all_pixels(), [0, 1_000_000], around, 5).unwrap().events
}

#[test]
fn a_camera_makes_the_events_of_its_generator_with_its_own_thresholds() {
    let even = camera(1.0);
    let forward =
        ForwardSimulator::new(even.generator.clone(), RecordingContext::default()).unwrap();
    let plain = forward.run(&wave(), &all_pixels(), [0, 1_000_000], 5).unwrap().events;
    assert!(plain.len() > 10_000);
    assert_eq!(seen_by(&even), plain);
    // A swing of 1.2 holds six thresholds of 0.2, four of 0.3 and nine of 0.133.
    let (uneven, n_on) = (seen_by(&camera(1.5)), plain.as_slice().count_on());
    assert!(uneven.as_slice().count_on() < n_on * 8 / 10);
    assert!(uneven.len() - uneven.as_slice().count_on() > (plain.len() - n_on) * 12 / 10);
    let quiet = CameraConstants { background_hz: 3.0, ..camera(1.0) };
    let more = seen_by(&quiet).len() as f64 - plain.len() as f64;
    // Events without a crossing delay those with one, by a few percent.
    let expected = 3.0 * SIZE.n_pixels() as f64;
    assert!((more / expected - 1.0).abs() < 0.2, "{more} for {expected}");
}

#[test]
fn a_camera_is_read_as_it_was_written_and_refused_where_no_pixel_can_work() {
    let camera = camera(1.2);
    let text = serde_json::to_string(&camera).unwrap();
    assert_eq!(serde_json::from_str::<CameraConstants>(&text).unwrap(), camera);
    for (key, value) in [("on_over_nominal", "0.0"), ("background_hz", "-1.0")] {
        let mut broken = serde_json::to_value(&camera).unwrap();
        broken[key] = value.parse::<f64>().unwrap().into();
        let broken: CameraConstants = serde_json::from_value(broken).unwrap();
        let around = RecordingContext::default();
        let refused = broken.events(&wave(), &[(0, 0)], [0, 1_000], around, 0).unwrap_err();
        assert!(refused.to_string().starts_with(key), "{refused}");
    }
}
