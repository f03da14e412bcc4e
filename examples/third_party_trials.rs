//! Sealed sessions from a third-party simulator, for `evrig prove --sessions OUT`.
//!
//! `cargo run --release --example third_party_trials -- OUT SEED SINGLE CLEAN ALIEN`
//!
//! The events are made by the crate `eventcv-core`, a port of v2e's pixel model that shares no line
//! with this project: its thresholds, photoreceptor, leak, noise and refractory period, its
//! thinning, jitter and support filter. Only the moving image and the mapping of parameters are
//! this example's. Where its model differs from the effect of that name, the trial keeps the
//! difference: its low-pass is updated once a frame, its noise falls with intensity.

#![allow(clippy::print_stdout)]

use eventcv_core::EventStream;
use eventcv_core::simulate::{Simulator, SimulatorConfig, Upsample};
use evrig::format::npy::{ArrayWriter, NpzWriter};
use evrig::prove::{ConcealedEffect, SealedTruth, seal};
use evrig::session::StreamName;
use evrig::session::import::{
    EventTableOptions, FrameTimes, ImportFrames, RawFrameOptions, import_frames,
};
use evrig::stats::SplitMix;
use std::error::Error;
use std::f64::consts::TAU;
use std::path::Path;

const USAGE: &str = "usage: third_party_trials OUT SEED SINGLE CLEAN ALIEN";

const WIDTH: usize = 128;
const HEIGHT: usize = 96;
const DURATION_US: i64 = 4_000_000;
/// Frame interval of the simulator, which interpolates to a quarter of it. The session keeps every
/// frame: a lower rate would be an effect of its own, in every session.
const STEP_US: i64 = 1_000;
/// Side of the image, which is periodic.
const SIDE: usize = 256;

/// The simulator's noise at white over that in the dark (v2e's law).
const NOISE_AT_WHITE: f64 = 0.25;

/// What can be hidden: id, and the changing parameter with its value at strength one.
const KNOWN: &[(&str, &str, f64)] = &[
    // The image's steepest edges take a pixel some 10 ms from event to event: a shorter refractory
    // period does nothing.
    ("refractory_period", "refractory_us", 10_000.0),
    ("photoreceptor_bandwidth", "cutoff_hz_at_white", 60.0),
    ("threshold_mismatch", "sigma_relative", 0.06),
    ("threshold_asymmetry", "on_off_ratio", 0.08),
    ("junction_leak", "rate_hz", 0.4),
    ("background_activity", "rate_hz", 0.5),
    ("event_drop", "fraction", 0.06),
    ("stamp_jitter", "sigma_us", 700.0),
];

/// What no library knows.
const ALIEN: &[(&str, &str, f64)] =
    &[("support_filter", "window_us", 20_000.0), ("spatial_jitter", "sigma_px", 0.3)];

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [out, seed, single, clean, alien] = arguments.as_slice() else { return Err(USAGE.into()) };
    let (out, seed) = (Path::new(out), seed.parse::<u64>()?);
    let mut order = SplitMix::new(seed, u64::MAX);
    let [known_from, alien_from] = [order.below(KNOWN.len()), order.below(ALIEN.len())];
    let mut kinds: Vec<Option<(&str, &str, f64)>> = Vec::new();
    kinds.extend((0..single.parse()?).map(|i: usize| Some(KNOWN[(known_from + i) % KNOWN.len()])));
    kinds.extend((0..clean.parse()?).map(|_: usize| None));
    kinds.extend((0..alien.parse()?).map(|i: usize| Some(ALIEN[(alien_from + i) % ALIEN.len()])));
    for i in (1..kinds.len()).rev() {
        kinds.swap(i, order.below(i + 1));
    }
    for (number, kind) in kinds.into_iter().enumerate() {
        let mut random = SplitMix::new(seed, number as u64);
        let truth = truth(kind, &mut random);
        let name = format!("eventcv-{number:03}");
        let n_events = make(&out.join("sessions").join(&name), &truth, &mut random)?;
        let seal_path = out.join("sessions").join(&name).join("seal.json");
        seal(&truth, &out.join("truth").join(format!("{name}.json")), &seal_path)?;
        println!("{name}: {n_events} events");
    }
    Ok(())
}

/// A strength even in the logarithm from one to four, and the parameters it gives.
fn truth(kind: Option<(&str, &str, f64)>, random: &mut SplitMix) -> SealedTruth {
    let strength = 4.0_f64.powf(random.uniform());
    let effects = kind.into_iter().map(|(id, key, at_one)| {
        let value = match key {
            "cutoff_hz_at_white" | "window_us" => at_one / strength,
            "on_off_ratio" => 1.0 + at_one * strength,
            _ => at_one * strength,
        };
        let mut parameters = std::collections::BTreeMap::from([(key.to_owned(), value)]);
        if key == "cutoff_hz_at_white" {
            parameters.insert("order".into(), 1.0);
        }
        ConcealedEffect { id: id.into(), parameters, strength }
    });
    let effects = effects.collect();
    let nonce = format!("{:016x}{:016x}", random.bits(), random.bits());
    SealedTruth { effects, nonce, ..SealedTruth::nothing() }
}

fn parameter(truth: &SealedTruth, id: &str) -> Option<f64> {
    let concealed = truth.effects.iter().find(|concealed| concealed.id == id)?;
    concealed.parameters.iter().find(|(key, _)| *key != "order").map(|(_, &value)| value)
}

/// Makes one session; gives the number of its events.
fn make(root: &Path, truth: &SealedTruth, random: &mut SplitMix) -> Result<usize, Box<dyn Error>> {
    let folder = tempfile::tempdir()?;
    let (frames_path, times_path, events_path) = (
        folder.path().join("frames.npy"),
        folder.path().join("times.npy"),
        folder.path().join("events.npz"),
    );
    let image = image(random);
    let seed = random.bits();
    let n_steps = DURATION_US / STEP_US;
    let mut frames =
        ArrayWriter::<u16>::create(&frames_path, &[n_steps as u64, HEIGHT as u64, WIDTH as u64])?;
    let mut times = ArrayWriter::<i64>::create(&times_path, &[n_steps as u64])?;
    let mut simulator = Simulator::new(WIDTH, HEIGHT, config(truth, seed, &image));
    let mut all = eventcv_core::EventStreamBuilder::new(WIDTH, HEIGHT, 1e-3);
    for step in 0..n_steps {
        let t_us = step * STEP_US;
        let frame = view(&image, t_us as f64 * 1e-6);
        all.extend_from_stream(&simulator.push_frame(&frame, t_us));
        let values: Vec<u16> = frame.iter().map(|v| (v * 65_535.0).round() as u16).collect();
        frames.extend(&values)?;
        times.extend(&[t_us])?;
    }
    frames.finish()?;
    times.finish()?;
    let events = afterwards(all.build(), truth, seed);
    write(&events, &events_path)?;
    import_frames(
        &ImportFrames {
            frames: &frames_path,
            times: FrameTimes::File(times_path),
            frame_time_unit: None,
            raw: RawFrameOptions::default(),
            events: Some(&events_path),
            events_name: StreamName::new("real")?,
            options: EventTableOptions::default(),
        },
        root,
    )?;
    Ok(events.len())
}

/// The simulator's own settings for what is hidden; without any, its ideal pixel.
fn config(truth: &SealedTruth, seed: u64, image: &[f64]) -> SimulatorConfig {
    let of = |id: &str| parameter(truth, id);
    // The stated noise rate holds in the dark only: the truth is the mean over all pixels.
    let light = image.iter().sum::<f64>() / image.len() as f64;
    let lit = 1.0 - (1.0 - NOISE_AT_WHITE) * light;
    let ideal = SimulatorConfig::ideal();
    let ratio = of("threshold_asymmetry").unwrap_or(1.0).sqrt() as f32;
    SimulatorConfig {
        pos_thres: ideal.pos_thres * ratio,
        neg_thres: ideal.neg_thres / ratio,
        sigma_thres: ideal.pos_thres * of("threshold_mismatch").unwrap_or(0.0) as f32,
        refractory_us: of("refractory_period").unwrap_or(0.0) as i64,
        cutoff_hz: of("photoreceptor_bandwidth").unwrap_or(0.0) as f32,
        leak_rate_hz: of("junction_leak").unwrap_or(0.0) as f32,
        shot_noise_rate_hz: (of("background_activity").unwrap_or(0.0) / lit) as f32,
        seed,
        upsample: Upsample::Fixed(4),
        ..ideal
    }
}

/// What it does to events once they are made.
fn afterwards(events: EventStream, truth: &SealedTruth, seed: u64) -> EventStream {
    let of = |id: &str| parameter(truth, id);
    if let Some(fraction) = of("event_drop") {
        return events.event_drop(fraction, seed);
    }
    if let Some(sigma_us) = of("stamp_jitter") {
        return events.time_jitter(sigma_us, seed);
    }
    if let Some(sigma_px) = of("spatial_jitter") {
        return events.spatial_jitter(sigma_px, seed);
    }
    if let Some(window_us) = of("support_filter") {
        return events.background_activity_filter(window_us as i64);
    }
    events
}

/// An image that repeats itself: blurred noise, in logarithms, from about a tenth of white up.
fn image(random: &mut SplitMix) -> Vec<f64> {
    let mut layer: Vec<f64> = (0..SIDE * SIDE).map(|_| random.normal()).collect();
    // Three passes of a box are close to a Gaussian; its deviation is two pixels.
    for _ in 0..3 {
        layer = boxed(&layer, 1, SIDE);
        layer = boxed(&layer, SIDE, 1);
    }
    let scale = (layer.iter().map(|v| v * v).sum::<f64>() / layer.len() as f64).sqrt();
    layer.iter().map(|v| (-1.1 + 0.5 * v / scale).clamp(-2.3, 0.0).exp()).collect()
}

/// A running mean over five samples, along rows or columns.
fn boxed(layer: &[f64], stride: usize, across: usize) -> Vec<f64> {
    let mut out = vec![0.0; layer.len()];
    for line in 0..SIDE {
        for i in 0..SIDE {
            let at = |k: usize| layer[line * across + (i + k + SIDE - 2) % SIDE * stride];
            out[line * across + i * stride] = (0..5).map(at).sum::<f64>() / 5.0;
        }
    }
    out
}

/// What the sensor sees at a time: the image on a figure of eight, 19 to 84 pixels a second.
fn view(image: &[f64], t_s: f64) -> Vec<f32> {
    let phase = TAU * t_s / 2.6;
    let (dx, dy) = (20.0 * phase.sin() + 64.0, 10.0 * (2.0 * phase).sin() + 64.0);
    let (left, top) = (dx.floor(), dy.floor());
    let (fx, fy) = (dx - left, dy - top);
    let (left, top) = (left as usize, top as usize);
    let value = |x: usize, y: usize| image[(y % SIDE) * SIDE + x % SIDE];
    let mut frame = Vec::with_capacity(WIDTH * HEIGHT);
    for y in 0..HEIGHT {
        for x in 0..WIDTH {
            let (x, y) = (x + left, y + top);
            let above = value(x, y) * (1.0 - fx) + value(x + 1, y) * fx;
            let below = value(x, y + 1) * (1.0 - fx) + value(x + 1, y + 1) * fx;
            frame.push((above * (1.0 - fy) + below * fy) as f32);
        }
    }
    frame
}

fn write(events: &EventStream, path: &Path) -> Result<(), Box<dyn Error>> {
    let n = [events.len() as u64];
    let on: Vec<u8> = events.ps().iter().map(|&on| u8::from(on)).collect();
    let mut file = NpzWriter::create(path)?;
    file.add("t", &n, events.ts().iter().copied())?;
    file.add("x", &n, events.xs().iter().copied())?;
    file.add("y", &n, events.ys().iter().copied())?;
    file.add("p", &n, on)?;
    file.finish()?;
    Ok(())
}
