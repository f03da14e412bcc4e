//! Selection of the pixels of a diagnosis.

use crate::diagnose::DiagnosisOptions;
use crate::predict::EventsByPixel;
use evrig_core::drive::{Drive, TimeGrid};
use evrig_core::geometry::Size;
use evrig_core::stats::SplitMix;
use rayon::prelude::*;

/// Pixels that are kept however many events they have.
const MIN_PIXELS: usize = 60;

/// Sampling step for the variation of the signal.
const MIN_COARSE_STEP_US: u32 = 40_000;
const MAX_COARSE_INSTANTS: usize = 500;

/// Changes below this many standard deviations of the signal's noise do not count.
const NOISE_STANDARD_DEVIATIONS: f32 = 5.0;

/// Candidates per wanted pixel; more where the signal varies at few of them.
const CANDIDATES_PER_PIXEL: usize = 8;
const MAX_CANDIDATES_PER_PIXEL: usize = 48;

/// Pixels with a varying signal, as many as wanted and with no more events than wanted.
pub(crate) fn select_pixels(
    recording: &EventsByPixel,
    drive: &dyn Drive,
    grid: TimeGrid,
    options: &DiagnosisOptions,
) -> Vec<(u16, u16)> {
    let mut chosen = select_enough(recording, drive, grid, options);
    thin(&mut chosen, recording, options.n_events);
    chosen
}

fn n_events_of(recording: &EventsByPixel, pixels: &[(u16, u16)]) -> usize {
    pixels.iter().map(|&(x, y)| recording.of(x, y).len()).sum()
}

/// More pixels where these have few events.
fn select_enough(
    recording: &EventsByPixel,
    drive: &dyn Drive,
    grid: TimeGrid,
    options: &DiagnosisOptions,
) -> Vec<(u16, u16)> {
    let most = (options.n_instants / grid.n).max(16);
    let mut n_pixels = options.n_pixels.clamp(16, most);
    loop {
        let chosen = choose(recording, drive, grid, n_pixels, options.seed);
        if n_events_of(recording, &chosen) >= options.few_events || n_pixels == most {
            return chosen;
        }
        n_pixels = (2 * n_pixels).min(most);
    }
}

/// Pixels by the variation of their signal, not by their events: three quarters among the most
/// varying, the rest from anywhere.
fn choose(
    recording: &EventsByPixel,
    drive: &dyn Drive,
    grid: TimeGrid,
    n_pixels: usize,
    seed: u64,
) -> Vec<(u16, u16)> {
    let wanted = n_pixels * 3 / 4;
    let among = |n: usize, noisy: f32| {
        let all = by_light_variation(
            drive,
            grid,
            &candidates(recording.size(), n * n_pixels, seed),
            noisy,
        );
        let n_restless = all.partition_point(|(moves, _)| *moves > 0.0);
        (all, n_restless)
    };
    let (mut all, mut n_restless) = among(CANDIDATES_PER_PIXEL, NOISE_STANDARD_DEVIATIONS);
    if n_restless < wanted {
        (all, n_restless) = among(MAX_CANDIDATES_PER_PIXEL, NOISE_STANDARD_DEVIATIONS);
    }
    if n_restless < wanted / 4 {
        // With variation everywhere the noise estimate is inflated: ignore it.
        (all, n_restless) = among(CANDIDATES_PER_PIXEL, 0.0);
    }
    let n_best = wanted.min(n_restless);
    // Evenly spaced ranks of the upper half, so that the pixels cover the sensor.
    let half = (n_restless / 2).max(n_best).max(1);
    let mut chosen: Vec<(u16, u16)> =
        (0..n_best).map(|i| all[i * half / n_best.max(1)].1).collect();
    let calm = &all[half.min(all.len())..];
    let n_rest = (n_pixels - n_best).min(calm.len());
    chosen.extend((0..n_rest).map(|i| calm[i * calm.len() / n_rest].1));
    chosen.sort_by_key(|&(x, y)| (y, x));
    chosen.dedup();
    chosen
}

/// A jittered regular grid of `n` pixels.
fn candidates(size: Size, n: usize, seed: u64) -> Vec<(u16, u16)> {
    let stride = (size.n_pixels() / n.max(1)).max(1);
    let mut random = SplitMix::new(seed, 0x7069_7865);
    (0..size.n_pixels() / stride)
        .map(|i| {
            let pixel = i * stride + random.below(stride);
            let width = usize::from(size.width);
            ((pixel % width) as u16, (pixel / width) as u16)
        })
        .collect()
}

/// Pixels with a known signal and its total variation beyond the noise, largest first.
fn by_light_variation(
    drive: &dyn Drive,
    grid: TimeGrid,
    candidates: &[(u16, u16)],
    noisy: f32,
) -> Vec<(f32, (u16, u16))> {
    let every =
        (MIN_COARSE_STEP_US / grid.step_us).max(grid.n.div_ceil(MAX_COARSE_INSTANTS) as u32).max(1);
    let coarse =
        TimeGrid { step_us: grid.step_us * every, n: grid.n.div_ceil(every as usize), ..grid };
    let mut all: Vec<(f32, (u16, u16))> = candidates
        .par_iter()
        .filter_map(|&(x, y)| {
            let mut out = vec![f32::NAN; coarse.n];
            let place = [f64::from(x) + 0.5, f64::from(y) + 0.5];
            drive.sample(place, coarse, &mut out).then_some(())?;
            let noise = noisy * drive.noise(place);
            let moves = out.windows(2).map(|pair| (pair[1] - pair[0]).abs() - noise);
            Some((moves.filter(|m| *m > 0.0).sum::<f32>(), (x, y)))
        })
        .collect();
    all.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    all
}

/// Keeps every so many-th pixel, down to about `n_events` events.
fn thin(chosen: &mut Vec<(u16, u16)>, recording: &EventsByPixel, n_events: usize) {
    let all = n_events_of(recording, chosen).max(1);
    let n_kept = (chosen.len() * n_events / all).max(MIN_PIXELS);
    if n_kept < chosen.len() {
        *chosen = (0..n_kept).map(|i| chosen[i * chosen.len() / n_kept]).collect();
    }
}
