//! Events lost on the way.

use super::{CandidateEffect, CandidateParameter, EffectId, PLAIN};

/// Smaller losses are confused with noise that does not change the reference level.
const MIN_FRACTION: f64 = 0.03;

pub(super) const CANDIDATE: CandidateEffect = CandidateEffect {
    id: EffectId::EventDrop,
    equation: "each event is lost with chance q after the pixel was reset",
    source: "inivation: DropDVSOnTransferStall",
    parameters: &[CandidateParameter::linear("fraction", [MIN_FRACTION, 0.9], 0.005)],
    starting_points: |_| vec![vec![0.05], vec![0.12], vec![0.35]],
    apply: |values, _, view| view.law.drop_fraction = values[0],
    competing: &[EffectId::RefractoryPeriod, EffectId::ReadoutSaturation],
    separating_recording: "a slower pass: losses on the bus grow with the event rate",
    describe: |values| {
        format!("{:.0} % of the events are lost behind the pixel", values[0] * 100.0)
    },
    ..PLAIN
};
