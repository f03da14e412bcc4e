//! A hypothesis let run by itself: the generator beside the camera.
//!
//! A score is teacher-forced: every event is predicted from the events before it that really came.
//! Whether a model makes events like the camera's is another question. Here the generator
//! [`crate::generate::forward`] runs free over a patch of the sensor, from the same light, once as
//! the baseline and once with the named effects, each effect by the generator's own account of it,
//! which shares no code with the one that the fit used.

mod measures;

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
use measures::{counts, interval_shares, rmse, told, transport_px};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Side of the patch, pixels.
const PATCH_PX: u16 = 80;

/// Longest stretch of time that is run, microseconds.
const LONGEST_US: i64 = 6_000_000;

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
    let leak_per_us = law.leak_per_s / law.theta_on * 1e-6;
    let k = Coefficients::new([1.0 / theta, 1e-9, 0.0, leak_per_us, 0.0, 0.0]);
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
        // The law counts leaks in thresholds for On, the generator in nominal ones.
        pixel.leak_hz *= half;
        pixel.leak_hz_at_white *= half;
        pixel.leak_hz_per_s *= half;
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
