use super::*;
use crate::event::Events;
use crate::frame::Luminance;
use crate::generate::voltmeter::Coefficients;
use crate::generate::{GenerateParameters, build};
use std::num::NonZeroUsize;

const SIZE: Size = Size::new(96, 64);

/// A texture of several scales that drifts along a circle, 8-bit units, 120 frames a second.
fn clip(n_frames: usize) -> Vec<Luminance> {
    let waves: [[f64; 4]; 6] = [
        [0.11, 0.05, 0.0, 30.0],
        [-0.07, 0.13, 1.0, 24.0],
        [0.21, -0.17, 2.0, 16.0],
        [0.02, 0.03, 4.0, 38.0],
        [0.31, 0.27, 5.0, 8.0],
        [-0.035, 0.018, 3.0, 26.0],
    ];
    let frame = |i: usize| {
        let t = i as f64 / 120.0;
        let (dx, dy) = (24.0 * (3.0 * t).cos(), 24.0 * (3.0 * t).sin());
        let value = |n: usize| {
            let (x, y) = ((n % 96) as f64 + dx, (n / 96) as f64 + dy);
            let sum: f64 =
                waves.iter().map(|[u, v, phase, a]| a * (u * x + v * y + phase).sin()).sum();
            (100.0 + 0.65 * sum).clamp(2.0, 250.0) as f32
        };
        let values = (0..SIZE.n_pixels()).map(value).collect();
        Luminance { t_us: (t * 1e6).round() as i64, size: SIZE, values }
    };
    (0..n_frames).map(frame).collect()
}

fn light(frames: &[Luminance]) -> Light {
    let mut builder = LightBuilder::new(SIZE, frames.len() as u64, 0);
    frames.iter().for_each(|frame| builder.push(frame).unwrap());
    builder.finish().unwrap()
}

fn events(frames: &[Luminance], k: Coefficients, seed: u64) -> Events {
    let parameters = GenerateParameters::from_k(k, seed);
    let mut generator = build(&parameters, NonZeroUsize::new(1)).unwrap();
    let mut events = Events::new();
    frames.iter().for_each(|frame| generator.push(frame, &mut events).unwrap());
    events
}

#[test]
fn print_both() {
    let frames = clip(240);
    let light = light(&frames);
    for k in [Coefficients::DVS346, Coefficients::new([3.0, 10.0, 2e-3, 5e-7, 1e-8, 2e-4]).unwrap()] {
        let events = events(&frames, k, 1);
        let paper = regress(&light, events.as_slice(), Part::Train, 0).unwrap();
        println!("events {} bins {} lines {} k1' {} agreement {}", events.len(), paper.points.len(), paper.lines.len(), paper.k1_prime.estimate.value, paper.agreement.estimate.value);
        let fit = fit(&light, events.as_slice(), Part::Train, paper.k.map(|k| k.estimate.value)).unwrap();
        println!("used {} open {} ratio {} far {}", fit.n_used, fit.n_open, fit.variance_ratio, fit.share_far);
        for i in 0..6 {
            println!("k{} true {:e} paper {:e} +- {:e} fit {:e} +- {:e} z {}", i + 1, k.k()[i], paper.k[i].estimate.value, paper.k[i].estimate.standard_error, fit.k[i].estimate.value, fit.k[i].estimate.standard_error, (fit.k[i].estimate.value - k.k()[i]) / fit.k[i].estimate.standard_error);
        }
    }
}
