//! Effects that a session cannot test.

use crate::diagnose::effect::{LIBRARY, library_effect};
use crate::diagnose::statistics;
use crate::diagnose::{Evidence, UntestableEffect};
use evrig_core::effect_id::EffectId;

const SATURATED_READOUT: &str = "the readout determines the event times, so that no pixel law can \
     be inferred";

/// Effects that cannot be tested. Under a saturated readout these include all effects on single
/// pixels.
pub(crate) fn cannot_judge(evidence: &Evidence, is_saturated: bool) -> Vec<UntestableEffect> {
    let held_up = || is_saturated.then(|| SATURATED_READOUT.to_owned());
    let because = |id: EffectId| match library_effect(id) {
        _ if statistics::is_statistic(id) => statistics::testable(evidence, id).err(),
        Some(effect) => (effect.requires)(evidence).err().or_else(held_up),
        None if LIBRARY.iter().any(|effect| effect.inseparable.contains(&id)) => held_up(),
        None => Some("it is not in the library".to_owned()),
    };
    let all = EffectId::ALL.iter().copied();
    all.filter_map(|id| because(id).map(|because| UntestableEffect { id, because })).collect()
}
