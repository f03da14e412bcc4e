//! A fitted model as a camera for event generation.

use crate::diagnose::model::camera_model::CameraModel;
use crate::diagnose::model::constants::CameraConstant;
use crate::diagnose::{Evidence, FittedCamera, FittedEffect, FittedRegistration, ImagePose};
use evrig_core::effect_id::EffectId;
use evrig_generate::effect::{AppliedEffect, Effect, EffectSet, SignalStage};
use evrig_generate::forward::{BandNoise, CameraConstants, ForwardParameters, ThresholdScatter};
use evrig_generate::voltmeter::Coefficients;

const SIGNAL_STEP_US: u32 = 1_000;

/// Bandwidths of noise that a signal sampled every millisecond carries over several seconds, Hz.
const MIN_NOISE_HZ: f64 = 20.0;
const MAX_NOISE_HZ: f64 = 1_000.0;

/// Effects that the camera's constants or its registration contain.
const IN_CONSTANTS: [EffectId; 7] = [
    EffectId::ThresholdAsymmetry,
    EffectId::JunctionLeak,
    EffectId::BackgroundActivity,
    EffectId::ClockOffset,
    EffectId::PixelLatency,
    EffectId::Defocus,
    EffectId::Misregistration,
];

/// The camera of a model with its named effects; `fitted` ones are part of the model, the others
/// come from frames and sensor-wide statistics. `None` where the generator cannot represent it.
pub(crate) fn fitted_camera(
    evidence: &Evidence,
    model: &CameraModel,
    named: &[FittedEffect],
    fitted: &[EffectId],
) -> Option<FittedCamera> {
    let law = model.law(evidence, [0.0; 2]);
    let theta = (law.theta[0] * law.theta[1]).sqrt();
    let leak_per_us = law.leak_per_s / law.theta[0] * 1e-6;
    let k = Coefficients::new([1.0 / theta, 1e-9, 0.0, leak_per_us, 0.0, 0.0]).ok()?;
    let (mut applied, mut left_out) = (Vec::new(), Vec::new());
    for effect in named.iter().filter(|effect| !IN_CONSTANTS.contains(&effect.id)) {
        // The generator has no shape of a period's end.
        let own =
            effect.parameters.iter().filter(|(k, _)| effect.id.parameters().contains(&k.as_str()));
        let values: Vec<(&str, f64)> = own.map(|(key, p)| (key.as_str(), p.value)).collect();
        match Effect::from_parameters(effect.id, &values) {
            // The signal contains what frames and optics do to it.
            Ok(own)
                if fitted.contains(&effect.id) || own.model().stage() >= SignalStage::Memory =>
            {
                applied.push(AppliedEffect { effect: own, region: None });
            }
            Ok(_) => {}
            Err(error) => left_out.push(format!("{}: {error}", effect.id)),
        }
    }
    let effects = EffectSet::new(applied).ok()?;
    let (noise, scatter) = noise(model, law.noise / theta, law.stored_share);
    let camera = CameraConstants {
        generator: ForwardParameters { k, effects, step_us: SIGNAL_STEP_US },
        on_over_nominal: (0.5 * model.constant(CameraConstant::LogRatio)).exp(),
        noise,
        scatter,
        background_hz: law.background_hz[0] + law.background_hz[1],
    };
    let named = named.iter().map(|effect| effect.id).collect();
    Some(FittedCamera { camera, registration: registration(evidence, model), named, left_out })
}

/// The part of the noise that enters the reference level as signal noise, the rest as threshold
/// noise.
fn noise(model: &CameraModel, scale: f64, stored: f64) -> (BandNoise, ThresholdScatter) {
    use crate::predict::law::LOGISTIC_SD;
    let hz = model.constant(CameraConstant::LogNoiseRate).exp();
    let light_exponent = model.constant(CameraConstant::NoiseExponent);
    let own_hz = hz / std::f64::consts::TAU;
    let bandwidth_hz = own_hz.clamp(MIN_NOISE_HZ, MAX_NOISE_HZ);
    // Slower noise causes no event by itself; faster noise of the signal would.
    let stored = if own_hz < MIN_NOISE_HZ { 0.0 } else { stored };
    // A change has the signal's noise twice.
    let rms = LOGISTIC_SD * scale * (0.5 * stored).sqrt();
    let scatter = ThresholdScatter {
        scale: scale * (1.0 - stored).sqrt(),
        light_exponent,
        // The law's hazard at rest is this rate times the share of the noise beyond the threshold.
        redrawn_hz: 0.5 * hz,
    };
    (BandNoise { rms, bandwidth_hz, light_exponent }, scatter)
}

fn registration(evidence: &Evidence, model: &CameraModel) -> FittedRegistration {
    use CameraConstant as C;
    let tied = evidence.facts.clock_tie;
    FittedRegistration {
        pose: ImagePose {
            shift_px: [model.constant(C::ShiftX), model.constant(C::ShiftY)],
            rotation_deg: model.constant(C::RotationDeg),
            scale_change: model.constant(C::Scale),
        },
        center_px: evidence.middle,
        blur_px2: model.constant(C::BlurPx2),
        event_to_light_us: tied.map_or(0.0, |t| t.offset_us[0]) - model.constant(C::OffsetUs),
        skew: tied.map_or(0.0, |t| t.skew_ppm[0] * 1e-6),
        reference_us: evidence.window_us[0] as f64 + evidence.start_us + 0.5e6 * evidence.seconds(),
    }
}
