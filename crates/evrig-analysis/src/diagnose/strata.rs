//! Where a model is wrong: strata of the events by what they may depend on.
//!
//! The compensator of a silence is exponential under a true model, so `u = 1 - e^-spent` is
//! uniform. How far `u` is from uniform in a stratum, as Kullback and Leibler's divergence of a
//! histogram, is what a recalibration of the hazard in that stratum would buy, in nats an event.

use super::fit::Fitted;
use super::kinds::kinds_of_pixels;
use super::{Evidence, Kind, PixelEvidence, Where};
use crate::predict::{Residual, Silence, residuals};
use rayon::prelude::*;

/// Cells of the histogram of `u`.
pub(super) const N_CELLS: usize = 10;

/// Least events in a stratum.
const LEAST: usize = 60;

/// One event with where it lies.
pub(super) struct Placed {
    pub(super) residual: Residual,
    pub(super) cell: usize,
    pub(super) held_out: bool,
}

impl Placed {
    /// Uniform under a true model.
    pub(super) fn u(&self) -> f64 {
        1.0 - (-self.residual.spent).exp()
    }
}

/// What a stratum is by.
pub(super) struct Covariate {
    pub(super) key: &'static str,
    /// AscendingFrames edges between strata.
    pub(super) edges: Vec<f64>,
    pub(super) value: fn(&Placed) -> f64,
    /// Whether it is known before the event, so that a model may depend on it.
    pub(super) is_known_before: bool,
    says: fn([f64; 2], f64) -> String,
}

/// The residuals of every event under a model.
pub(super) fn placed(evidence: &Evidence, model: &Fitted) -> Vec<Placed> {
    let of_pixels = evidence.pixels.iter().zip(walked(evidence, model));
    of_pixels
        .flat_map(|(pixel, (events, _))| {
            events.into_iter().map(|residual| {
                let block = evidence.blocks.of(residual.t_us as f64);
                let held_out = evidence.is_held_out(pixel.tile, block);
                Placed { residual, cell: evidence.cell(pixel, block), held_out }
            })
        })
        .collect()
}

/// The residuals of each pixel's events under a model, and its counts in each block of time.
pub(super) fn walked(evidence: &Evidence, model: &Fitted) -> Vec<(Vec<Residual>, Vec<Silence>)> {
    let kinds = kinds_of_pixels(evidence, &model.hypothesis);
    let of_pixel = |(pixel, kind): (&PixelEvidence, Kind)| {
        let view = model.hypothesis.view(evidence, pixel, kind, Vec::new());
        let place = (pixel.x, pixel.y);
        residuals(&view.law, view.light(), place, &pixel.spikes, &evidence.blocks)
    };
    evidence.pixels.par_iter().zip(kinds).map(of_pixel).collect()
}

fn word(late: f64) -> &'static str {
    if late > 0.0 { "late" } else { "early" }
}

/// Edges that part the events into `n` equally many, where ties allow.
fn quantiles(events: &[Placed], value: fn(&Placed) -> f64, n: usize) -> Vec<f64> {
    let mut all: Vec<f64> = events.iter().map(value).filter(|v| v.is_finite()).collect();
    all.sort_by(f64::total_cmp);
    quantiles_of(&all, n)
}

/// Edges that part ascending values into `n` equally many, where ties allow.
pub(super) fn quantiles_of(sorted: &[f64], n: usize) -> Vec<f64> {
    let mut edges: Vec<f64> = (1..n)
        .map(|i| evrig_core::stats::quantile_sorted(sorted, i as f64 / n as f64))
        .filter(|edge| edge.is_finite())
        .collect();
    edges.dedup();
    edges
}

/// Quantities that events are parted by.
pub(super) fn covariates(events: &[Placed]) -> Vec<Covariate> {
    let mut all = of_the_light(events);
    all.extend(of_place_and_time(events));
    all.extend(of_the_polarity());
    all
}

/// What the light and the pixel's own past were.
fn of_the_light(events: &[Placed]) -> Vec<Covariate> {
    let interval = |p: &Placed| p.residual.previous.map_or(f64::NAN, |q| q.ago_s * 1e6);
    let level = |p: &Placed| p.residual.level;
    let slope = |p: &Placed| p.residual.slope_per_s;
    vec![
        Covariate {
            key: "interval_us",
            edges: quantiles(events, interval, 6),
            value: interval,
            is_known_before: false,
            says: |[a, b], r| {
                format!("events {a:.0} to {b:.0} us after the pixel's last one come {}", word(r))
            },
        },
        Covariate {
            key: "log_intensity",
            edges: quantiles(events, level, 6),
            value: level,
            is_known_before: true,
            says: |[a, b], r| {
                let percent = |v: f64| v.exp() * 100.0;
                format!(
                    "where the light is {:.0} to {:.0} % of white events come {}",
                    percent(a),
                    percent(b),
                    word(r)
                )
            },
        },
        Covariate {
            key: "contrast_rate_per_s",
            edges: quantiles(events, slope, 6),
            value: slope,
            is_known_before: false,
            says: |[a, b], r| {
                format!(
                    "where log intensity changes by {a:.1} to {b:.1} a second events come {}",
                    word(r)
                )
            },
        },
    ]
}

/// Where on the sensor and when.
fn of_place_and_time(events: &[Placed]) -> Vec<Covariate> {
    let row = |p: &Placed| f64::from(p.residual.y);
    let column = |p: &Placed| f64::from(p.residual.x);
    let time = |p: &Placed| p.residual.t_us as f64 * 1e-6;
    vec![
        Covariate {
            key: "row",
            edges: quantiles(events, row, 5),
            value: row,
            is_known_before: true,
            says: |[a, b], r| format!("in rows {a:.0} to {b:.0} events come {}", word(r)),
        },
        Covariate {
            key: "column",
            edges: quantiles(events, column, 5),
            value: column,
            is_known_before: true,
            says: |[a, b], r| format!("in columns {a:.0} to {b:.0} events come {}", word(r)),
        },
        Covariate {
            key: "time_s",
            edges: quantiles(events, time, 5),
            value: time,
            is_known_before: true,
            says: |[a, b], r| {
                format!("between {a:.2} and {b:.2} s of the recording events come {}", word(r))
            },
        },
    ]
}

/// Which way the light went.
fn of_the_polarity() -> Vec<Covariate> {
    let polarity = |p: &Placed| f64::from(u8::from(p.residual.on));
    let turned = |p: &Placed| {
        p.residual.previous.map_or(f64::NAN, |q| f64::from(u8::from(q.on != p.residual.on)))
    };
    vec![
        Covariate {
            key: "polarity_on",
            edges: vec![0.5],
            value: polarity,
            is_known_before: false,
            says: |[a, _], r| {
                let polarity = if a >= 0.5 { "On" } else { "Off" };
                format!("{polarity} events come {}", word(r))
            },
        },
        Covariate {
            key: "polarity_turned",
            edges: vec![0.5],
            value: turned,
            is_known_before: false,
            says: |[a, _], r| {
                let which = if a >= 0.5 { "opposite" } else { "equal" };
                format!("events of {which} polarity to the pixel's last one come {}", word(r))
            },
        },
    ]
}

/// The stratum a value lies in.
pub(super) fn stratum(edges: &[f64], value: f64) -> Option<usize> {
    value.is_finite().then(|| edges.partition_point(|edge| *edge <= value))
}

/// Divergence of a histogram from uniform, nats an event, less what chance alone makes of it.
fn divergence(counts: &[f64; N_CELLS]) -> f64 {
    let n: f64 = counts.iter().sum();
    let nats = |c: &f64| if *c > 0.0 { c / n * (c / n * N_CELLS as f64).ln() } else { 0.0 };
    counts.iter().map(nats).sum::<f64>() - (N_CELLS - 1) as f64 / (2.0 * n)
}

/// Strata of the held-out events in which the model is wrong by more than `least` nats an event of
/// all, the worst first.
pub(super) fn wrong_in(evidence: &Evidence, model: &Fitted, least: f64) -> Vec<Where> {
    let events = placed(evidence, model);
    let held_out: Vec<&Placed> = events.iter().filter(|p| p.held_out).collect();
    let n = held_out.len().max(1) as f64;
    let mut found = Vec::new();
    for covariate in covariates(&events) {
        let n_strata = covariate.edges.len() + 1;
        let mut counts = vec![[0.0; N_CELLS]; n_strata];
        let mut late = vec![(0.0, 0.0); n_strata];
        let mut ends = vec![[f64::INFINITY, f64::NEG_INFINITY]; n_strata];
        for event in &held_out {
            let value = (covariate.value)(event);
            let Some(s) = stratum(&covariate.edges, value) else { continue };
            counts[s][((event.u() * N_CELLS as f64) as usize).min(N_CELLS - 1)] += 1.0;
            ends[s] = [ends[s][0].min(value), ends[s][1].max(value)];
            if let Some(innovation) = event.residual.innovation {
                late[s].0 += innovation.clamp(-1.0, 1.0);
                late[s].1 += 1.0;
            }
        }
        for s in 0..n_strata {
            let here: f64 = counts[s].iter().sum();
            if (here as usize) < LEAST {
                continue;
            }
            let excess = divergence(&counts[s]) * here / n;
            if excess > least {
                let mean = late[s].0 / f64::max(late[s].1, 1.0);
                found.push(Where {
                    covariate: covariate.key.into(),
                    range: ends[s],
                    excess_nats_per_event: excess,
                    innovation_thresholds: Some(mean),
                    ratio: None,
                    n_events: here as u64,
                    says: (covariate.says)(ends[s], mean),
                });
            }
        }
    }
    found.sort_by(|a, b| b.excess_nats_per_event.total_cmp(&a.excess_nats_per_event));
    found.truncate(12);
    found
}
