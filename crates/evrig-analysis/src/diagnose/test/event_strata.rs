//! Strata of events in which the model misfits.
//!
//! Under a true model the compensator of an interval is exponential, so that `u = 1 - exp(-spent)`
//! is uniform (time rescaling). The Kullback-Leibler divergence of its histogram from uniform is
//! the log-likelihood gain of a recalibrated hazard in the stratum, in nats per event.

use crate::diagnose::MisfitStratum;
use crate::predict::Residual;

/// Bins of the histogram of `u`.
pub(crate) const N_HISTOGRAM_BINS: usize = 10;

const MIN_EVENTS_PER_STRATUM: usize = 60;

/// A residual with its cell.
#[derive(Debug, Clone)]
pub(crate) struct LocatedResidual {
    pub(crate) residual: Residual,
    pub(crate) cell: usize,
    pub(crate) held_out: bool,
}

impl LocatedResidual {
    /// Uniform under a true model.
    pub(crate) fn u(&self) -> f64 {
        1.0 - (-self.residual.compensator).exp()
    }
}

/// A covariate that defines strata.
pub(crate) struct StratumCovariate {
    pub(crate) key: &'static str,
    /// Ascending edges between strata.
    pub(crate) edges: Vec<f64>,
    pub(crate) value: fn(&LocatedResidual) -> f64,
    /// Whether it is known before the event, so that a hazard may depend on it.
    pub(crate) is_known_before: bool,
    describe: fn([f64; 2], f64) -> String,
}

fn lateness(late: f64) -> &'static str {
    if late > 0.0 { "late" } else { "early" }
}

/// Quantiles that divide the events into `n` equal parts, where ties allow.
fn quantiles(events: &[LocatedResidual], value: fn(&LocatedResidual) -> f64, n: usize) -> Vec<f64> {
    let mut all: Vec<f64> = events.iter().map(value).filter(|v| v.is_finite()).collect();
    all.sort_by(f64::total_cmp);
    quantiles_of(&all, n)
}

/// Quantiles of ascending values.
pub(crate) fn quantiles_of(sorted: &[f64], n: usize) -> Vec<f64> {
    let mut edges: Vec<f64> = (1..n)
        .map(|i| evrig_core::stats::quantile_sorted(sorted, i as f64 / n as f64))
        .filter(|edge| edge.is_finite())
        .collect();
    edges.dedup();
    edges
}

pub(crate) fn covariates(events: &[LocatedResidual]) -> Vec<StratumCovariate> {
    let mut all = light_covariates(events);
    all.extend(place_and_time_covariates(events));
    all.extend(polarity_covariates());
    all
}

fn light_covariates(events: &[LocatedResidual]) -> Vec<StratumCovariate> {
    let interval = |p: &LocatedResidual| p.residual.previous.map_or(f64::NAN, |q| q.ago_s * 1e6);
    let level = |p: &LocatedResidual| p.residual.level;
    let slope = |p: &LocatedResidual| p.residual.slope_per_s;
    vec![
        StratumCovariate {
            key: "interval_us",
            edges: quantiles(events, interval, 6),
            value: interval,
            is_known_before: false,
            describe: |[a, b], r| {
                format!(
                    "events {a:.0} to {b:.0} us after the pixel's last one come {}",
                    lateness(r)
                )
            },
        },
        StratumCovariate {
            key: "log_intensity",
            edges: quantiles(events, level, 6),
            value: level,
            is_known_before: true,
            describe: |[a, b], r| {
                let percent = |v: f64| v.exp() * 100.0;
                format!(
                    "where the signal is {:.0} to {:.0} % of white events come {}",
                    percent(a),
                    percent(b),
                    lateness(r)
                )
            },
        },
        StratumCovariate {
            key: "contrast_rate_per_s",
            edges: quantiles(events, slope, 6),
            value: slope,
            is_known_before: false,
            describe: |[a, b], r| {
                format!(
                    "where log intensity changes by {a:.1} to {b:.1} per second events come {}",
                    lateness(r)
                )
            },
        },
    ]
}

fn place_and_time_covariates(events: &[LocatedResidual]) -> Vec<StratumCovariate> {
    let row = |p: &LocatedResidual| f64::from(p.residual.y);
    let column = |p: &LocatedResidual| f64::from(p.residual.x);
    let time = |p: &LocatedResidual| p.residual.t_us as f64 * 1e-6;
    vec![
        StratumCovariate {
            key: "row",
            edges: quantiles(events, row, 5),
            value: row,
            is_known_before: true,
            describe: |[a, b], r| format!("in rows {a:.0} to {b:.0} events come {}", lateness(r)),
        },
        StratumCovariate {
            key: "column",
            edges: quantiles(events, column, 5),
            value: column,
            is_known_before: true,
            describe: |[a, b], r| {
                format!("in columns {a:.0} to {b:.0} events come {}", lateness(r))
            },
        },
        StratumCovariate {
            key: "time_s",
            edges: quantiles(events, time, 5),
            value: time,
            is_known_before: true,
            describe: |[a, b], r| {
                format!("between {a:.2} and {b:.2} s of the recording events come {}", lateness(r))
            },
        },
    ]
}

fn polarity_covariates() -> Vec<StratumCovariate> {
    let polarity = |p: &LocatedResidual| f64::from(u8::from(p.residual.on));
    let turned = |p: &LocatedResidual| {
        p.residual.previous.map_or(f64::NAN, |q| f64::from(u8::from(q.on != p.residual.on)))
    };
    vec![
        StratumCovariate {
            key: "polarity_on",
            edges: vec![0.5],
            value: polarity,
            is_known_before: false,
            describe: |[a, _], r| {
                let polarity = if a >= 0.5 { "ON" } else { "OFF" };
                format!("{polarity} events come {}", lateness(r))
            },
        },
        StratumCovariate {
            key: "polarity_turned",
            edges: vec![0.5],
            value: turned,
            is_known_before: false,
            describe: |[a, _], r| {
                let which = if a >= 0.5 { "opposite" } else { "equal" };
                format!("events of {which} polarity to the pixel's last one come {}", lateness(r))
            },
        },
    ]
}

pub(crate) fn stratum_of(edges: &[f64], value: f64) -> Option<usize> {
    value.is_finite().then(|| edges.partition_point(|edge| *edge <= value))
}

/// Divergence from uniform, nats per event, less its expectation under uniformity.
fn divergence(counts: &[f64; N_HISTOGRAM_BINS]) -> f64 {
    let n: f64 = counts.iter().sum();
    let nats =
        |c: &f64| if *c > 0.0 { c / n * (c / n * N_HISTOGRAM_BINS as f64).ln() } else { 0.0 };
    counts.iter().map(nats).sum::<f64>() - (N_HISTOGRAM_BINS - 1) as f64 / (2.0 * n)
}

/// Strata of held-out events with an excess above `least` nats per event of all, largest first.
pub(crate) fn misfit_strata(events: &[LocatedResidual], least: f64) -> Vec<MisfitStratum> {
    let held_out: Vec<&LocatedResidual> = events.iter().filter(|p| p.held_out).collect();
    let n = held_out.len().max(1) as f64;
    let mut found = Vec::new();
    for covariate in covariates(events) {
        let n_strata = covariate.edges.len() + 1;
        let mut counts = vec![[0.0; N_HISTOGRAM_BINS]; n_strata];
        let mut late = vec![(0.0, 0.0); n_strata];
        let mut ends = vec![[f64::INFINITY, f64::NEG_INFINITY]; n_strata];
        for event in &held_out {
            let value = (covariate.value)(event);
            let Some(s) = stratum_of(&covariate.edges, value) else { continue };
            counts[s]
                [((event.u() * N_HISTOGRAM_BINS as f64) as usize).min(N_HISTOGRAM_BINS - 1)] += 1.0;
            ends[s] = [ends[s][0].min(value), ends[s][1].max(value)];
            if let Some(innovation) = event.residual.innovation {
                late[s].0 += innovation.clamp(-1.0, 1.0);
                late[s].1 += 1.0;
            }
        }
        for s in 0..n_strata {
            let here: f64 = counts[s].iter().sum();
            if (here as usize) < MIN_EVENTS_PER_STRATUM {
                continue;
            }
            let excess = divergence(&counts[s]) * here / n;
            if excess > least {
                let mean = late[s].0 / f64::max(late[s].1, 1.0);
                found.push(MisfitStratum {
                    covariate: covariate.key.into(),
                    range: ends[s],
                    excess_nats_per_event: excess,
                    innovation_thresholds: Some(mean),
                    ratio: None,
                    n_events: here as u64,
                    description: (covariate.describe)(ends[s], mean),
                });
            }
        }
    }
    found.sort_by(|a, b| b.excess_nats_per_event.total_cmp(&a.excess_nats_per_event));
    found.truncate(12);
    found
}
