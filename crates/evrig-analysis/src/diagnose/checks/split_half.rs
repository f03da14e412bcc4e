//! Does a half of the pixels, or a half of the time, say the same?

use crate::diagnose::fit::cell_scores::Part;
use crate::diagnose::fit::fitted::Fitted;
use crate::diagnose::fit::gauss_newton::{as_it_is, fit};
use crate::diagnose::{Evidence, Half};
use std::collections::BTreeMap;

/// Steps of a half's fit towards where it is told to be.
const STEPS: usize = 12;

/// The named effects refitted on either half of the pixels and of the time, each along the directions of
/// the whole's summit; the model comes with its errors.
pub(crate) fn halves(evidence: &Evidence, baseline: &Fitted, model: &Fitted) -> Vec<Half> {
    let parts = [
        ("even tiles", evidence.with_tiles(|tile| tile.is_multiple_of(2))),
        ("odd tiles", evidence.with_tiles(|tile| !tile.is_multiple_of(2))),
        ("first half of the time", evidence.between(0.0, 0.5)),
        ("second half of the time", evidence.between(0.5, 1.0)),
    ];
    let of = |(name, part): (&str, Evidence)| {
        // Slopes lead far, and end on the flank: only from the top do two halves compare.
        let near = fit(&part, model.hypothesis.clone(), STEPS, 1e-4);
        let whole = model.errors.as_ref().map(|errors| &errors.summit);
        let there = whole.and_then(|whole| whole.of_part(&part, &near));
        let own = match there {
            Some(mut there) => there.climb(&part, near).0,
            None => near,
        };
        let without = as_it_is(&part, baseline.hypothesis.clone());
        let (gain, gain_error) = own.cells.gain(&without.cells, Part::HeldOut);
        let parameters: BTreeMap<String, f64> = own
            .hypothesis
            .effects
            .iter()
            .enumerate()
            .flat_map(|(index, effect)| {
                let told = own.hypothesis.told(evidence, index);
                let key = |key: &str| format!("{}.{key}", effect.id);
                told.into_iter().map(|(k, v)| (key(k), v)).collect::<Vec<_>>()
            })
            .collect();
        Half {
            of: name.to_owned(),
            n_events: part.n_events(),
            heldout_gain_nats_per_event: gain,
            heldout_gain_error: gain_error,
            parameters,
        }
    };
    parts.into_iter().map(of).collect()
}
