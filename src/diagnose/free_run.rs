//! A hypothesis let run by itself: the generator beside the camera.
//!
//! A score is teacher-forced: every event is predicted from the events before it that really came.
//! Whether a model makes events like the camera's is another question. Here the generator
//! [`crate::generate::forward`] runs free over a patch of the sensor, from the same light, once as
//! the baseline and once with the named effects, each effect by the generator's own account of it,
//! which shares no code with the one that the fit used.

use super::around::Around;
use super::boost::{Examples, FOLDS, told_apart};
use super::tuned::Tuned;
use super::{Evidence, Hypothesis, Nuisance};
use crate::compare::{Comparison, MeasureId, Setup, compare};
use crate::drive::Drive;
use crate::effect_id::EffectId;
use crate::event::{Event, EventSlice, Events};
use crate::generate::effect::{self, Applied, Effect, Effects, Surroundings};
use crate::generate::forward::{BandNoise, Forward, ForwardParameters, PixelModel, Scatter};
use crate::generate::voltmeter::Coefficients;
use crate::geometry::Size;
use crate::predict::ByPixel;
use crate::stats::SplitMix;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Side of the patch, pixels.
const PATCH_PX: u16 = 80;

/// Longest stretch of time that is run, microseconds.
const LONGEST_US: i64 = 6_000_000;

/// Most events of a sample that are told apart.
const MOST: usize = 20_000;

/// Directions along which clouds of events are held together.
const DIRECTIONS: usize = 24;

/// As far apart in a cloud as one pixel, microseconds.
const PX_US: f64 = 5_000.0;

/// A measure of baseline and final model against the camera.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct BeforeAfter {
    /// Of the nuisances alone; `null` where it is not known.
    pub baseline: Option<f64>,
    /// With the named effects.
    pub r#final: Option<f64>,
}

/// The free run: what was run, its measures, and maps of counts to look at.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FreeRun {
    /// First column and row of the patch, and its width and height.
    pub patch_px: [u16; 4],
    /// Start and end, microseconds of the events' clock.
    pub window_us: [i64; 2],
    /// Measures by name.
    pub measures: BTreeMap<String, BeforeAfter>,
    /// Events a pixel, row by row: of the camera, the baseline, the final model.
    pub counts: [Vec<u32>; 3],
    /// Edges of intervals in decades of microseconds, and the share in each of the three.
    pub interval_edges_log10_us: Vec<f64>,
    /// Shares of intervals: camera, baseline, final.
    pub interval_shares: [Vec<f64>; 3],
    /// What the generator could not be told.
    pub left_out: Vec<String>,
}

/// What a free run takes of the camera's events: those of its patch and its time.
#[must_use]
pub fn beside_free_run(evidence: &Evidence, size: Size, real: EventSlice<'_>) -> Events {
    let ([from, to], patch) = (window(evidence), patch(evidence, size));
    real.between(from, to).iter().filter(|e| is_inside(patch, e)).collect()
}

/// Lets baseline and model run. `None` where the generator refuses or nothing fires on the patch.
#[must_use]
pub fn free_run(
    evidence: &Evidence,
    drive: &dyn Drive,
    real: EventSlice<'_>,
    [baseline, model]: [&Hypothesis; 2],
    seed: u64,
) -> Option<FreeRun> {
    let window_us = window(evidence);
    let patch = patch(evidence, drive.size());
    let real = beside_free_run(evidence, drive.size(), real);
    let mut left_out = Vec::new();
    let mut run = |hypothesis: &Hypothesis| {
        generated(evidence, drive, hypothesis, patch, window_us, seed, &mut left_out)
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
        let pair = BeforeAfter { baseline: known(baseline), r#final: known(r#final) };
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
    let told = |i: usize| told(&local[0], &local[i], size, window_us);
    put("c2st_accuracy", told(1), told(2));
    let interval_edges_log10_us: Vec<f64> = (0..=40).map(|i| 1.5 + f64::from(i) * 0.125).collect();
    let shares = |i: usize| interval_shares(&local[i], size, window_us, &interval_edges_log10_us);
    let interval_shares = [shares(0), shares(1), shares(2)];
    Some(FreeRun {
        patch_px: patch,
        window_us,
        measures,
        counts,
        interval_edges_log10_us,
        interval_shares,
        left_out,
    })
}

/// The middle of the light, as long as is allowed.
fn window(evidence: &Evidence) -> [i64; 2] {
    let start = evidence.window_us[0] + evidence.start_us as i64;
    let length = (evidence.seconds() * 1e6) as i64;
    let taken = length.min(LONGEST_US);
    let from = start + (length - taken) / 2;
    [from, from + taken]
}

/// The square in which the pixels looked at are densest: there the light is known and changes.
fn patch(evidence: &Evidence, size: Size) -> [u16; 4] {
    let (w, h) = (PATCH_PX.min(size.width), PATCH_PX.min(size.height));
    let mut best = ([0, 0, w, h], 0);
    for y in (0..=size.height - h).step_by(10) {
        for x in (0..=size.width - w).step_by(10) {
            let within =
                |p: &&super::PixelEvidence| (x..x + w).contains(&p.x) && (y..y + h).contains(&p.y);
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

/// An effect's parameters, those of a nuisance that it frees in a region against what the nuisance is
/// elsewhere.
fn beyond_ordinary(
    evidence: &Evidence,
    hypothesis: &Hypothesis,
    index: usize,
) -> Vec<(&'static str, f64)> {
    let effect = hypothesis.effects[index];
    let mut told = hypothesis.told(evidence, index);
    if effect.frees.is_empty() {
        return told;
    }
    let elsewhere = (effect.report)(&hypothesis.values);
    let first = told.iter_mut().zip(&elsewhere).take(1);
    first.for_each(|((_, there), elsewhere)| match effect.id {
        EffectId::ThresholdAsymmetry => *there /= elsewhere,
        EffectId::Defocus => {
            *there = (there.powi(2) - elsewhere.powi(2)).max(0.0).sqrt();
        }
        _ => *there -= elsewhere,
    });
    told
}

/// Events of the generator on the patch.
fn generated(
    evidence: &Evidence,
    drive: &dyn Drive,
    hypothesis: &Hypothesis,
    [x0, y0, w, h]: [u16; 4],
    window_us: [i64; 2],
    seed: u64,
    left_out: &mut Vec<String>,
) -> Option<Events> {
    let law = hypothesis.law();
    let theta = (law.theta_on * law.theta_off).sqrt();
    let k = Coefficients::new([1.0 / theta, 1e-9, 0.0, law.leak_per_s / theta * 1e-6, 0.0, 0.0]);
    let mut applied = Vec::new();
    for (index, effect) in hypothesis.effects.iter().enumerate() {
        // A nuisance that an effect let out of its range is in the law and the light already; in a
        // region they have what is ordinary elsewhere.
        if !effect.frees.is_empty() && hypothesis.regions[index].is_none() {
            continue;
        }
        let parameters = beyond_ordinary(evidence, hypothesis, index);
        match Effect::from_parameters(effect.id, &parameters) {
            Ok(effect) => {
                let side = |[low, high]: [u16; 2]| Some([f64::from(low), f64::from(high)]);
                let region = hypothesis.regions[index]
                    .map(|r| effect::Region { x_px: side(r.x_px), y_px: side(r.y_px) });
                applied.push(Applied { effect, region });
            }
            Err(error) => left_out.push(format!("{}: {error}", effect.id)),
        }
    }
    let parameters =
        ForwardParameters { k: k.ok()?, effects: Effects::new(applied).ok()?, step_us: 1_000 };
    let surroundings = Surroundings {
        aps_starts_us: evidence.facts.aps_us.clone(),
        frame_times_us: evidence.facts.aps_us.clone(),
    };
    let forward = match Forward::new(parameters, surroundings) {
        Ok(forward) => forward,
        Err(error) => {
            left_out.push(error.to_string());
            return None;
        }
    };
    let half = (0.5 * hypothesis.nuisance(Nuisance::LogRatio)).exp();
    let (band, scatter) = noise(hypothesis, theta);
    let background = law.background_on_hz + law.background_off_hz;
    let adjust = |_: u16, _: u16, pixel: &mut PixelModel| {
        pixel.threshold_on *= half;
        pixel.threshold_off /= half;
        match &mut pixel.band {
            // Shot noise that was named; it grows towards the dark as the law's noise does.
            Some(named) => named.light_exponent = law.noise_exponent,
            none => (*none, pixel.scatter) = (Some(band), Some(scatter)),
        }
        pixel.spontaneous_hz += background;
    };
    let pixels: Vec<(u16, u16)> =
        (y0..y0 + h).flat_map(|y| (x0..x0 + w).map(move |x| (x, y))).collect();
    let tuned = Tuned::new(drive, evidence, hypothesis);
    match forward.run_with(&tuned, &pixels, window_us, seed, &adjust) {
        Ok(run) => Some(run.events),
        Err(error) => {
            left_out.push(error.to_string());
            None
        }
    }
}

/// The law's noise: the part that the pixel memorises with the light as a signal's, the other as that of its
/// thresholds.
fn noise(hypothesis: &Hypothesis, theta: f64) -> (BandNoise, Scatter) {
    let law = hypothesis.law();
    let hz = hypothesis.nuisance(Nuisance::LogNoiseHz).exp();
    let (scale, light_exponent) = (law.noise_at_white / theta, law.noise_exponent);
    // A logistic law's standard deviation; a change has the signal's noise twice.
    let rms = 1.813_8 * scale * (0.5 * law.noise_memorised).sqrt();
    let bandwidth_hz = (hz / std::f64::consts::TAU).clamp(20.0, 1_000.0);
    let scatter = Scatter {
        scale: scale * (1.0 - law.noise_memorised).sqrt(),
        light_exponent,
        // At rest the law's hazard is this rate times the share of the noise beyond the threshold.
        redrawn_hz: 0.5 * hz,
    };
    (BandNoise { rms, bandwidth_hz, light_exponent }, scatter)
}

fn counts(events: &Events, size: Size) -> Vec<u32> {
    let mut counts = vec![0; size.n_pixels()];
    events.as_slice().iter().for_each(|e| counts[size.index(e.x, e.y)] += 1);
    counts
}

/// Root mean square difference of counts a pixel, over the mean count of the camera.
fn rmse(real: &[u32], simulated: &[u32]) -> Option<f64> {
    let n = real.len() as f64;
    let mean = real.iter().map(|c| f64::from(*c)).sum::<f64>() / n;
    let square: f64 =
        real.iter().zip(simulated).map(|(a, b)| (f64::from(*a) - f64::from(*b)).powi(2)).sum();
    (mean > 0.0).then(|| (square / n).sqrt() / mean)
}

/// How far two clouds of events lie apart, pixels: the mean over directions in space and time of
/// the distance of their projections (Bonneel et al., J. Math. Imaging Vis. 51, 2015), On and Off
/// each by itself, in proportion to the camera's.
fn transport_px(real: &Events, simulated: &Events, start_us: i64, seed: u64) -> Option<f64> {
    let cloud = |events: &Events, on: bool| -> Vec<[f64; 3]> {
        let own = events.as_slice().iter().filter(move |e| e.on == on);
        own.map(|e| [f64::from(e.x), f64::from(e.y), (e.t - start_us) as f64 / PX_US]).collect()
    };
    let (mut sum, mut weight) = (0.0, 0.0);
    for on in [true, false] {
        let (a, b) = (cloud(real, on), cloud(simulated, on));
        if a.len() < 20 || b.len() < 20 {
            continue;
        }
        let mut random = SplitMix::new(seed, 0x736c_6963);
        let mut distance = 0.0;
        for _ in 0..DIRECTIONS {
            let d: [f64; 3] = std::array::from_fn(|_| random.normal());
            let length = d.iter().map(|v| v * v).sum::<f64>().sqrt();
            let along = |cloud: &[[f64; 3]]| {
                let project = |p: &[f64; 3]| (p[0] * d[0] + p[1] * d[1] + p[2] * d[2]) / length;
                let mut all: Vec<f64> = cloud.iter().map(project).collect();
                all.sort_by(f64::total_cmp);
                all
            };
            let (p, q) = (along(&a), along(&b));
            let quantile = |all: &[f64], i: usize| {
                crate::stats::quantile_sorted(all, (i as f64 + 0.5) / 200.0)
            };
            distance +=
                (0..200).map(|i| (quantile(&p, i) - quantile(&q, i)).abs()).sum::<f64>() / 200.0;
        }
        sum += distance / DIRECTIONS as f64 * a.len() as f64;
        weight += a.len() as f64;
    }
    (weight > 0.0).then_some(sum / weight)
}

/// Accuracy with which trees that have not seen them tell the camera's events from the model's; a
/// half where they cannot (Lopez-Paz and Oquab, ICLR 2017).
fn told(real: &Events, simulated: &Events, size: Size, window_us: [i64; 2]) -> Option<f64> {
    const FEATURES: usize = 10;
    let mut examples = Examples { n_features: FEATURES, ..Examples::default() };
    for (events, is_real) in [(real, true), (simulated, false)] {
        let by_pixel = ByPixel::new(events.as_slice(), size, window_us);
        let around = Around::new(by_pixel.clone(), &[]);
        let every = events.len().div_ceil(MOST).max(1);
        let mut number = 0;
        for y in 0..size.height {
            for x in 0..size.width {
                let spikes = by_pixel.of(x, y);
                for (i, spike) in spikes.iter().enumerate() {
                    number += 1;
                    if number % every != 0 {
                        continue;
                    }
                    let before = i.checked_sub(1).map(|j| spikes[j]);
                    let second = i.checked_sub(2).map(|j| spikes[j]);
                    let since = |s: Option<crate::predict::Spike>| {
                        s.map_or(f32::NAN, |s| (spike.t_us - s.t_us) as f32)
                    };
                    let turned = before.map_or(f32::NAN, |s| f32::from(u8::from(s.on != spike.on)));
                    let (near_us, n_near) = around.neighbours(x, y, spike.t_us, 5_000);
                    let block = (spike.t_us / 200_000) as u32;
                    let tile = u32::from(x / 16) + 64 * u32::from(y / 16);
                    examples.features.extend([
                        since(before),
                        since(second),
                        f32::from(u8::from(spike.on)),
                        turned,
                        near_us as f32,
                        n_near as f32,
                        around.row_us(x, y, spike.t_us) as f32,
                        f32::from(x),
                        f32::from(y),
                        spike.t_us as f32 * 1e-6,
                    ]);
                    examples.is_real.push(is_real);
                    examples.cell.push(tile);
                    examples.fold.push(((tile + block) % u32::from(FOLDS)) as u8);
                }
            }
        }
    }
    told_apart(&examples).map(|told| told.accuracy)
}

/// Share of a pixel's intervals in each bin.
fn interval_shares(events: &Events, size: Size, window_us: [i64; 2], edges: &[f64]) -> Vec<f64> {
    let by_pixel = ByPixel::new(events.as_slice(), size, window_us);
    let mut counts = vec![0.0; edges.len().saturating_sub(1)];
    let mut n = 0.0_f64;
    for y in 0..size.height {
        for x in 0..size.width {
            for pair in by_pixel.of(x, y).windows(2) {
                let decades = ((pair[1].t_us - pair[0].t_us).max(1) as f64).log10();
                let bin = edges.partition_point(|edge| *edge <= decades);
                if let Some(count) = bin.checked_sub(1).and_then(|bin| counts.get_mut(bin)) {
                    *count += 1.0;
                }
                n += 1.0;
            }
        }
    }
    counts.iter_mut().for_each(|count| *count /= n.max(1.0));
    counts
}
