//! Upper bound on the log-likelihood by hazard recalibration.
//!
//! In each stratum of a covariate that is known before the event, the histogram of `u = 1 -
//! exp(-spent)` on training cells replaces the uniform density. Covariates follow each other, each
//! on the recalibrated `u`. A covariate is used if its training gain exceeds its degrees of
//! freedom.

use super::event_strata::{LocatedResidual, N_HISTOGRAM_BINS, covariates, stratum_of};
use crate::diagnose::Evidence;
use crate::predict::Residual;

/// Held-out gain of a recalibration.
#[derive(Debug, Clone, Copy)]
pub(crate) struct RecalibrationGain {
    /// Nats per event.
    pub(crate) gain: f64,
    /// Its standard error, from the scatter over cells.
    pub(crate) error: f64,
}

/// Pseudo-count per histogram bin.
const PRIOR_COUNT: f64 = 1.0;

pub(crate) fn recalibration_gain(
    evidence: &Evidence,
    events: &[LocatedResidual],
) -> RecalibrationGain {
    let mut u: Vec<f64> = events.iter().map(LocatedResidual::u).collect();
    let mut gains = vec![0.0; events.len()];
    for covariate in covariates(events).iter().filter(|c| c.is_known_before) {
        recalibrate(events, &mut u, &mut gains, &covariate.edges, covariate.value);
    }
    let previous = |p: &LocatedResidual| previous(&p.residual);
    recalibrate(events, &mut u, &mut gains, &[0.5, 1.5], previous);
    held_out(evidence, events, &gains)
}

fn held_out(evidence: &Evidence, events: &[LocatedResidual], gains: &[f64]) -> RecalibrationGain {
    let n_cells = evidence.n_tiles * evidence.blocks.n();
    let mut by_cell = vec![(0.0, 0.0); n_cells];
    for (event, gain) in events.iter().zip(gains).filter(|(event, _)| event.held_out) {
        by_cell[event.cell].0 += gain;
        by_cell[event.cell].1 += 1.0;
    }
    by_cell.retain(|cell| cell.1 > 0.0);
    let n: f64 = by_cell.iter().map(|c| c.1).sum::<f64>().max(1.0);
    let gain = by_cell.iter().map(|c| c.0).sum::<f64>() / n;
    let square: f64 = by_cell.iter().map(|c| (c.0 - gain * c.1).powi(2)).sum();
    RecalibrationGain { gain, error: square.sqrt() / n }
}

/// 0 after an OFF event, 1 after an ON event, 2 for the first event.
fn previous(residual: &Residual) -> f64 {
    residual.previous.map_or(2.0, |p| f64::from(u8::from(p.on)))
}

fn recalibrate(
    events: &[LocatedResidual],
    u: &mut [f64],
    gains: &mut [f64],
    edges: &[f64],
    value: impl Fn(&LocatedResidual) -> f64,
) {
    let cell_of = |u: f64| ((u * N_HISTOGRAM_BINS as f64) as usize).min(N_HISTOGRAM_BINS - 1);
    let mut counts = vec![[PRIOR_COUNT; N_HISTOGRAM_BINS]; edges.len() + 1];
    let strata: Vec<Option<usize>> = events.iter().map(|e| stratum_of(edges, value(e))).collect();
    for ((event, u), s) in events.iter().zip(u.iter()).zip(&strata) {
        if let (false, Some(s)) = (event.held_out, s) {
            counts[*s][cell_of(*u)] += 1.0;
        }
    }
    let mut gain = 0.0;
    for counts in &counts {
        let n: f64 = counts.iter().sum();
        gain += counts
            .iter()
            .map(|c| (c - PRIOR_COUNT) * (c / n * N_HISTOGRAM_BINS as f64).ln())
            .sum::<f64>();
    }
    if gain < ((N_HISTOGRAM_BINS - 1) * counts.len()) as f64 {
        return;
    }
    for ((u, gain), s) in u.iter_mut().zip(gains.iter_mut()).zip(&strata) {
        let Some(s) = s else { continue };
        let counts = &counts[*s];
        let n: f64 = counts.iter().sum();
        let cell = cell_of(*u);
        let below: f64 = counts[..cell].iter().sum();
        *gain += (counts[cell] / n * N_HISTOGRAM_BINS as f64).ln();
        let inside = (*u * N_HISTOGRAM_BINS as f64 - cell as f64).clamp(0.0, 1.0);
        *u = (below + counts[cell] * inside) / n;
    }
}
