//! Forward simulation of the fitted camera against the recording.
//!
//! The likelihood predicts each event from the recorded past. A forward simulation generates all
//! events from the signal alone: here [`evrig_generate::forward`] on a patch of the sensor, once
//! with the baseline and once with the named effects. The generator's effects share no code with
//! those of the fit.

mod sample_distance;

use super::fitted_camera::{FittedCamera, surroundings};
use crate::compare::{Comparison, MeasureId, Setup, compare};
use crate::diagnose::Evidence;
use crate::diagnose::model::registration::RegisteredDrive;
use evrig_core::drive::Drive;
use evrig_core::event::{Event, EventSlice, Events};
use evrig_core::geometry::Size;
use sample_distance::{c2st_accuracy, counts, interval_shares, rmse, transport_px};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

const PATCH_SIDE_PX: u16 = 80;

const MAX_DURATION_US: i64 = 6_000_000;

/// A measure of baseline and final model against the recording.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ModelComparison {
    /// Nuisances alone; `null` where unknown.
    pub baseline: Option<f64>,
    /// With the named effects.
    pub r#final: Option<f64>,
}

/// The forward simulation with its measures and histograms.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ForwardSimulation {
    /// First column and row of the patch, its width and height.
    pub patch_px: [u16; 4],
    /// Start and end, microseconds of the events' clock.
    pub window_us: [i64; 2],
    /// Measures by name.
    pub measures: BTreeMap<String, ModelComparison>,
    /// Events per pixel in row-major order: recording, baseline, final model.
    pub counts: [Vec<u32>; 3],
    /// Bin edges of the intervals, log10 of microseconds.
    pub interval_edges_log10_us: Vec<f64>,
    /// Shares of intervals per bin: recording, baseline, final model.
    pub interval_shares: [Vec<f64>; 3],
    /// What the generator cannot represent.
    pub left_out: Vec<String>,
}

/// Recorded events within patch and window of the simulation.
#[must_use]
pub fn events_on_patch(evidence: &Evidence, size: Size, real: EventSlice<'_>) -> Events {
    let ([from, to], patch) = (window(evidence), patch(evidence, size));
    real.between(from, to).iter().filter(|e| is_inside(patch, e)).collect()
}

/// Simulates baseline and final model. `None` where the generator refuses or the patch has no
/// events.
#[must_use]
pub fn simulate_forward(
    evidence: &Evidence,
    drive: &dyn Drive,
    real: EventSlice<'_>,
    [baseline, model]: [&FittedCamera; 2],
    seed: u64,
) -> Option<ForwardSimulation> {
    let window_us = window(evidence);
    let patch = patch(evidence, drive.size());
    let real = events_on_patch(evidence, drive.size(), real);
    let mut left_out = Vec::new();
    let mut run = |fitted: &FittedCamera| {
        generated(evidence, drive, fitted, patch, window_us, seed, &mut left_out)
    };
    let before = run(baseline)?;
    let after = run(model)?;
    left_out.dedup();
    let all = [&real, &before, &after];
    let size = Size::new(patch[2], patch[3]);
    let local: [Events; 3] = all.map(|events| {
        let moved = |e: Event| Event { x: e.x - patch[0], y: e.y - patch[1], ..e };
        events.as_slice().iter().map(moved).collect()
    });
    let setup = Setup { size, window: window_us, region: None, seed, n_bootstrap: 0, frames: None };
    let against =
        |simulated: &Events| compare(local[0].as_slice(), simulated.as_slice(), &setup).ok();
    let (first, second) = (against(&local[1])?, against(&local[2])?);
    let mut measures = BTreeMap::new();
    let mut put = |key: &str, baseline: Option<f64>, r#final: Option<f64>| {
        let known = |v: Option<f64>| v.filter(|v| v.is_finite());
        let pair = ModelComparison { baseline: known(baseline), r#final: known(r#final) };
        measures.insert(key.to_owned(), pair);
    };
    for (key, id) in [
        ("count_ratio", MeasureId::CountRatio),
        ("polarity_delta", MeasureId::PolarityDelta),
        ("interval_tv", MeasureId::IntervalTv),
        ("spatial_emd", MeasureId::SpatialEmd),
    ] {
        let of = |comparison: &Comparison| comparison.measure(id).map(|m| m.estimate.value);
        put(key, of(&first), of(&second));
    }
    let counts: [Vec<u32>; 3] = std::array::from_fn(|i| counts(&local[i], size));
    put("rate_map_rmse", rmse(&counts[0], &counts[1]), rmse(&counts[0], &counts[2]));
    let cloud = |i: usize| transport_px(&local[0], &local[i], window_us[0], seed);
    put("transport_px", cloud(1), cloud(2));
    let accuracy = |i: usize| c2st_accuracy(&local[0], &local[i], size, window_us);
    put("c2st_accuracy", accuracy(1), accuracy(2));
    let interval_edges_log10_us: Vec<f64> = (0..=40).map(|i| 1.5 + f64::from(i) * 0.125).collect();
    let shares = |i: usize| interval_shares(&local[i], size, window_us, &interval_edges_log10_us);
    let interval_shares = [shares(0), shares(1), shares(2)];
    Some(ForwardSimulation {
        patch_px: patch,
        window_us,
        measures,
        counts,
        interval_edges_log10_us,
        interval_shares,
        left_out,
    })
}

/// The middle of the signal, up to the maximum duration.
fn window(evidence: &Evidence) -> [i64; 2] {
    let start = evidence.window_us[0] + evidence.start_us as i64;
    let length = (evidence.seconds() * 1e6) as i64;
    let taken = length.min(MAX_DURATION_US);
    let from = start + (length - taken) / 2;
    [from, from + taken]
}

/// The square with the most events of selected pixels.
fn patch(evidence: &Evidence, size: Size) -> [u16; 4] {
    let (w, h) = (PATCH_SIDE_PX.min(size.width), PATCH_SIDE_PX.min(size.height));
    let mut best = ([0, 0, w, h], 0);
    for y in (0..=size.height - h).step_by(10) {
        for x in (0..=size.width - w).step_by(10) {
            let within = |p: &&crate::diagnose::PixelEvidence| {
                (x..x + w).contains(&p.x) && (y..y + h).contains(&p.y)
            };
            let n: usize =
                evidence.pixels.iter().filter(within).map(|pixel| pixel.spikes.len()).sum();
            if n > best.1 {
                best = ([x, y, w, h], n);
            }
        }
    }
    best.0
}

fn is_inside([x, y, w, h]: [u16; 4], event: &Event) -> bool {
    (x..x + w).contains(&event.x) && (y..y + h).contains(&event.y)
}

/// Simulated events on the patch.
fn generated(
    evidence: &Evidence,
    drive: &dyn Drive,
    fitted: &FittedCamera,
    [x0, y0, w, h]: [u16; 4],
    window_us: [i64; 2],
    seed: u64,
    left_out: &mut Vec<String>,
) -> Option<Events> {
    left_out.extend(fitted.left_out.iter().cloned());
    let pixels: Vec<(u16, u16)> =
        (y0..y0 + h).flat_map(|y| (x0..x0 + w).map(move |x| (x, y))).collect();
    let tuned = RegisteredDrive::new(drive, fitted.registration.clone());
    let surroundings = surroundings(&evidence.facts);
    match fitted.camera.events(&tuned, &pixels, window_us, surroundings, seed) {
        Ok(run) => Some(run.events),
        Err(error) => {
            left_out.push(error.to_string());
            None
        }
    }
}
