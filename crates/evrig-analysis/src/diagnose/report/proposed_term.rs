//! A term outside the library: the residual as a function of a covariate.

use crate::diagnose::checks::event_strata::{
    LocatedResidual, StratumCovariate, covariates, locate_residuals, stratum_of,
};
use crate::diagnose::checks::upper_bound::gain_of_one_covariate;
use crate::diagnose::fit::fitted::FittedModel;
use crate::diagnose::{Evidence, ProposedTerm};
use evrig_core::stats::{Moments, Z90};

const MIN_TERM_GAIN_NATS_PER_EVENT: f64 = 0.01;

const MIN_EVENTS_PER_POINT: u64 = 30;

/// The covariate with the largest recalibration gain, with the mean innovation as a curve.
pub(crate) fn propose_term(evidence: &Evidence, model: &FittedModel) -> Option<ProposedTerm> {
    let events = locate_residuals(evidence, model);
    let all = covariates(&events);
    let known = all.iter().filter(|c| c.is_known_before);
    let gains = known.map(|c| (c, gain_of_one_covariate(evidence, &events, &c.edges, c.value)));
    let (best, gain) = gains.max_by(|a, b| a.1.total_cmp(&b.1))?;
    if gain < MIN_TERM_GAIN_NATS_PER_EVENT {
        return None;
    }
    Some(ProposedTerm {
        enters: point_of_entry(&events).into(),
        depends_on: best.key.into(),
        curve: curve(&events, best),
        heldout_gain_nats_per_event: gain,
    })
}

/// Per stratum: covariate, mean innovation of the training events in thresholds, and its 90 %
/// band.
fn curve(events: &[LocatedResidual], covariate: &StratumCovariate) -> Vec<[f64; 4]> {
    let n = covariate.edges.len() + 1;
    let mut values = vec![Moments::default(); n];
    let mut innovations = vec![Moments::default(); n];
    for event in events.iter().filter(|event| !event.held_out) {
        let value = (covariate.value)(event);
        if let (Some(s), Some(r)) = (stratum_of(&covariate.edges, value), event.residual.innovation)
        {
            values[s].push(value);
            innovations[s].push(r.clamp(-1.0, 1.0));
        }
    }
    let points = values.iter().zip(&innovations).filter(|(_, r)| r.count() >= MIN_EVENTS_PER_POINT);
    points
        .map(|(value, r)| {
            let half = Z90 * r.standard_error();
            [value.mean(), r.mean(), r.mean() - half, r.mean() + half]
        })
        .collect()
}

/// Point of entry of a term: under a timing error the innovation grows with the contrast rate,
/// under a threshold error it does not.
fn point_of_entry(events: &[LocatedResidual]) -> &'static str {
    let pairs: Vec<(f64, f64)> = events
        .iter()
        .filter(|e| e.residual.slope_per_s > 0.0)
        .filter_map(|e| Some((e.residual.slope_per_s, e.residual.innovation?)))
        .filter(|(_, r)| r.abs() < 1.0)
        .collect();
    let early = events.iter().filter(|e| e.residual.innovation.is_some_and(|r| r < -0.7)).count();
    if early * 3 > events.len() {
        // A third of the events come without a change of the signal.
        return "hazard";
    }
    let slope: Moments = pairs.iter().map(|p| p.0).collect();
    let innovation: Moments = pairs.iter().map(|p| p.1).collect();
    let both: Moments =
        pairs.iter().map(|p| (p.0 - slope.mean()) * (p.1 - innovation.mean())).collect();
    let correlation =
        both.mean() / (slope.standard_deviation() * innovation.standard_deviation()).max(1e-12);
    if correlation.abs() > 0.2 { "time_stamp" } else { "threshold" }
}
