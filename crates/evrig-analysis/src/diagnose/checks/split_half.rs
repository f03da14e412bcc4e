//! Split-half check: the effects refitted on half of the pixels or of the time.

use crate::diagnose::fit::cell_scores::CellSet;
use crate::diagnose::fit::fitted::FittedModel;
use crate::diagnose::fit::gauss_newton::{fit, score_model};
use crate::diagnose::{Evidence, SplitHalfFit};
use std::collections::BTreeMap;

const MAX_STEPS: usize = 12;

/// The named effects refitted on each half, along the directions of the full fit's Laplace
/// approximation. Needs standard errors.
pub(crate) fn split_half_fits(
    evidence: &Evidence,
    baseline: &FittedModel,
    model: &FittedModel,
) -> Vec<SplitHalfFit> {
    let parts = [
        ("even tiles", evidence.with_tiles(|tile| tile.is_multiple_of(2))),
        ("odd tiles", evidence.with_tiles(|tile| !tile.is_multiple_of(2))),
        ("first half of the time", evidence.within_time(0.0, 0.5)),
        ("second half of the time", evidence.within_time(0.5, 1.0)),
    ];
    let of = |(name, part): (&str, Evidence)| {
        // Gradient steps stop short of the maximum: halves are comparable only there.
        let near = fit(&part, model.hypothesis.clone(), MAX_STEPS, 1e-4);
        let whole = model.errors.as_ref().map(|errors| &errors.laplace);
        let there = whole.and_then(|whole| whole.of_part(&part, &near));
        let own = match there {
            Some(mut there) => there.climb(&part, near).0,
            None => near,
        };
        let without = score_model(&part, baseline.hypothesis.clone());
        let (gain, gain_error) = own.cells.gain(&without.cells, CellSet::HeldOut);
        let parameters: BTreeMap<String, f64> = own
            .hypothesis
            .effects
            .iter()
            .enumerate()
            .flat_map(|(index, effect)| {
                let parameters = own.hypothesis.named_parameters(evidence, index);
                let key = |key: &str| format!("{}.{key}", effect.id);
                parameters.into_iter().map(|(k, v)| (key(k), v)).collect::<Vec<_>>()
            })
            .collect();
        SplitHalfFit {
            subset: name.to_owned(),
            n_events: part.n_events(),
            heldout_gain_nats_per_event: gain,
            heldout_gain_error: gain_error,
            parameters,
        }
    };
    parts.into_iter().map(of).collect()
}
