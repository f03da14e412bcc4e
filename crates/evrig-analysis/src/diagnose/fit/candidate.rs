//! What a model can have beyond an ordinary camera: an effect, or constants outside their ordinary
//! range.

use crate::diagnose::Evidence;
use crate::diagnose::effect::{LIBRARY, ModelTerm, is_established_without_light, library_effect};
use crate::diagnose::fit::paired_gain::PairedGain;
use crate::diagnose::model::camera_model::CameraModel;
use crate::diagnose::model::constants::{CameraConstant, ConstantPrior};
use evrig_core::effect_id::EffectId;

/// A candidate of the selection.
#[derive(Debug, Clone, Copy)]
pub(crate) enum EffectCandidate {
    /// An effect that no constant represents.
    Structural(&'static ModelTerm),
    /// Constants that leave their ordinary ranges together.
    Freed(&'static [CameraConstant]),
}

/// Constants that stand for one effect.
static FREED: [&[CameraConstant]; 9] = [
    &[CameraConstant::LogRatio],
    &[CameraConstant::LeakHz],
    &[CameraConstant::PhotoLeakHz],
    &[CameraConstant::LogBackgroundOn, CameraConstant::LogBackgroundOff],
    &[CameraConstant::Pedestal],
    &[CameraConstant::OffsetUs],
    &[CameraConstant::LogStampError],
    &[CameraConstant::BlurPx2],
    &[
        CameraConstant::ShiftX,
        CameraConstant::ShiftY,
        CameraConstant::RotationDeg,
        CameraConstant::Scale,
    ],
];

impl EffectCandidate {
    /// An effect by its id, where it is a term of the model.
    pub(crate) fn structural(id: EffectId) -> Option<Self> {
        library_effect(id)?.term.map(Self::Structural)
    }

    /// All that a model does not have yet and the evidence can test.
    pub(crate) fn beyond(evidence: &Evidence, model: &CameraModel) -> Vec<Self> {
        let testable = LIBRARY.iter().filter(|effect| (effect.requires)(evidence).is_ok());
        let is_new = |term: &&ModelTerm| model.effects.iter().all(|own| own.id != term.id);
        let structural = testable.filter_map(|e| e.term).filter(is_new).map(Self::Structural);
        let is_limited = |group: &&&[CameraConstant]| model.is_limited(group[0]);
        let freed = FREED.iter().filter(is_limited).map(|group| Self::Freed(group));
        structural.chain(freed).collect()
    }

    /// The effect's name; that of a constant depends on its value.
    pub(crate) fn id(self, evidence: &Evidence, model: &CameraModel) -> EffectId {
        match self {
            Self::Structural(effect) => effect.id,
            Self::Freed(group) => {
                let id = group[0].effect(model.constant(group[0]));
                delayed(evidence, id.unwrap_or(EffectId::Misregistration))
            }
        }
    }

    /// The model with the candidate, at each of its starting values.
    pub(crate) fn starts(self, evidence: &Evidence, model: &CameraModel) -> Vec<CameraModel> {
        match self {
            Self::Structural(effect) => {
                (effect.starts)(evidence).iter().map(|start| model.with(effect, start)).collect()
            }
            Self::Freed(group) => {
                let mut freed = model.clone();
                freed.free(group);
                let start = |(constant, value): (CameraConstant, f64)| {
                    let mut start = freed.clone();
                    start.values[constant as usize] = value;
                    start
                };
                let fitted = group.iter().filter(|c| c.prior(&evidence.facts).sd > 0.0);
                let values = |c: &CameraConstant| {
                    let measured = evidence.facts.clock_tie.map(|tied| tied.offset_us[0]);
                    let measured = measured.filter(|_| *c == CameraConstant::OffsetUs);
                    starts_of(*c, c.prior(&evidence.facts), model.constant(*c))
                        .into_iter()
                        .chain(measured)
                        .map(|value| (*c, value))
                        .collect::<Vec<_>>()
                };
                fitted.flat_map(values).map(start).collect()
            }
        }
    }

    /// Indices of its values in a model that has it as the last effect.
    pub(crate) fn own(self, model: &CameraModel) -> Vec<usize> {
        match self {
            Self::Structural(_) => {
                let last = model.effects.len().saturating_sub(1);
                (model.offset_of(last)..model.values.len()).collect()
            }
            Self::Freed(group) => group.iter().map(|constant| *constant as usize).collect(),
        }
    }

    /// Whether the strength or scale of the last effect is ordinary or at the end of its range: it
    /// imitates something else.
    pub(crate) fn is_refused(self, evidence: &Evidence, model: &CameraModel) -> bool {
        let Self::Structural(effect) = self else { return false };
        let value = model.values[model.offset_of(model.effects.len() - 1)];
        let [low, high] = effect.parameters[0].fitted_range();
        let natural = effect.parameters[0].natural(value);
        let [least, most] = (effect.ordinary)(evidence);
        value <= low || value >= high || (least..=most).contains(&natural.abs())
    }

    /// Whether a held-out gain suffices for a name.
    pub(crate) fn is_significant(self, evidence: &Evidence, gain: PairedGain) -> bool {
        match self {
            Self::Structural(term) if is_established_without_light(term.id) => gain.mean > 0.0,
            // The ordinary range bounds its size, where no error of the signal between frames pulls
            // it out.
            Self::Freed(_) if evidence.facts.is_light_dense() => gain.is_sure(),
            _ => gain.is_significant(),
        }
    }

    /// Removes it from a model.
    pub(crate) fn remove(self, evidence: &Evidence, model: &mut CameraModel) {
        match self {
            Self::Structural(effect) => model.remove_effect(effect.id),
            Self::Freed(group) => model.limit(evidence, group),
        }
    }
}

/// Values beyond the ordinary range at which a fit of a freed constant starts.
fn starts_of(constant: CameraConstant, prior: ConstantPrior, now: f64) -> Vec<f64> {
    match constant {
        CameraConstant::OffsetUs => START_OFFSETS_US.to_vec(),
        CameraConstant::LogStampError => [0.7, 1.8].map(|more| prior.ordinary[1] + more).to_vec(),
        CameraConstant::LogBackgroundOn | CameraConstant::LogBackgroundOff => {
            vec![prior.ordinary[1] + 1.5]
        }
        _ => {
            let width = 0.5 * (prior.ordinary[1] - prior.ordinary[0]);
            [now - 2.0 * width, now + 2.0 * width].to_vec()
        }
    }
}

/// Clock offsets at which a fit starts, microseconds: the likelihood has several maxima where an
/// edge meets the events of its neighbour.
pub(crate) const START_OFFSETS_US: [f64; 8] = [2e3, -2e3, 5e3, -5e3, 10e3, -10e3, 20e3, -20e3];

/// A delay of the events alone is a pixel latency where the camera's own frames are on time.
fn delayed(evidence: &Evidence, id: EffectId) -> EffectId {
    match evidence.facts.clock_tie {
        Some(tie) if id == EffectId::ClockOffset && !tie.is_off() => EffectId::PixelLatency,
        _ => id,
    }
}
