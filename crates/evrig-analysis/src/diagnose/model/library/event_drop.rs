//! Events lost on the way.

use super::{Candidate, EffectId, PLAIN, Parameter};

/// A smaller share of lost events is taken for whatever makes a few events impossible: noise that a pixel
/// does not memorise fits as well.
const LEAST: f64 = 0.03;

pub(super) const CANDIDATE: Candidate = Candidate {
    id: EffectId::EventDrop,
    equation: "each event is lost with chance q after the pixel was reset",
    source: "inivation: DropDVSOnTransferStall",
    parameters: &[Parameter::linear("fraction", [LEAST, 0.9], 0.005)],
    starts: |_| vec![vec![0.05], vec![0.12], vec![0.35]],
    act: |values, _, view| view.law.drop_fraction = values[0],
    rivals: &[EffectId::RefractoryPeriod, EffectId::ReadoutSaturation],
    splitter: "a slower pass: losses on the bus grow with the rate of all pixels",
    says: |values| {
        format!("{:.0} % of the events are lost after the pixel has fired", values[0] * 100.0)
    },
    ..PLAIN
};
