//! Departures of the luminance and of the cameras' response to it.

use super::MIN_STANDARD_ERRORS;
use evrig_analysis::diagnose::Departure;
use evrig_core::effect_id::EffectId;
use evrig_reconstruct::scene::{MovingIllumination, Scene, ToneFit};
use evrig_session::rig::Rig;

/// Usual vignetting of a lens.
const MAX_ORDINARY_LOSS: f64 = 0.05;

/// Relative error of the stated read-noise variance.
const STATED_VARIANCE_ERROR: f64 = 0.2;

/// Variance of rounding to integers.
const ROUNDING_VARIANCE: f64 = 1.0 / 12.0;

/// A moving shadow.
pub(super) fn shadow(moving: &MovingIllumination) -> Departure {
    let [depth, error] = moving.depth;
    let MovingIllumination { speed_mm_per_s, direction_deg, .. } = moving;
    Departure {
        id: EffectId::MovingShadow,
        parameters: vec![("depth", moving.depth)],
        description: format!(
            "a shadow of {:.0} % moves over the target at {:.0} mm/s towards {:.0} deg",
            100.0 * depth,
            speed_mm_per_s.abs(),
            if *speed_mm_per_s < 0.0 { direction_deg + 180.0 } else { *direction_deg }
                .rem_euclid(360.0),
        ),
        z: depth / error.max(1e-9),
        without: None,
    }
}

/// Frames of the Pi that are not linear in light, unlike those of the event camera.
pub(super) fn curve(tone: &ToneFit) -> Option<Departure> {
    let z = tone.nonlinear_sigmas()?;
    let description = format!(
        "raw frames follow a power law of exponent {:.3}; the event camera's frames are linear",
        tone.gamma[0]
    );
    let parameters = vec![("gamma", tone.gamma)];
    Some(Departure { id: EffectId::ToneCurve, parameters, description, z, without: None })
}

/// Vignetting, by the camera with the larger loss.
pub(super) fn corners(scene: &Scene) -> Option<Departure> {
    let davis = scene.registration.tone.map(|tone| ("event camera", tone.corner_loss));
    let pi = scene.reconstruction.corner_loss.map(|loss| ("Pi", loss));
    let lossy = |(_, [loss, error]): &(&str, [f64; 2])| {
        *loss > MAX_ORDINARY_LOSS && loss / error > MIN_STANDARD_ERRORS
    };
    let both = [pi, davis].into_iter().flatten().filter(lossy);
    let (camera, corner_loss) = both.max_by(|a, b| a.1[0].total_cmp(&b.1[0]))?;
    let [loss, error] = corner_loss;
    Some(Departure {
        id: EffectId::Vignetting,
        parameters: vec![("corner_loss", corner_loss)],
        description: format!(
            "frames of the {camera} are {:.0} % darker in the corners",
            100.0 * loss
        ),
        z: loss / error.max(1e-9),
        without: None,
    })
}

/// Whether the frames determine their read noise, which takes linear frames.
pub(super) fn noise_is_known(scene: &Scene) -> bool {
    let is_curved = scene.registration.tone.is_some_and(|tone| tone.nonlinear_sigmas().is_some());
    scene.reconstruction.read_noise_dn.is_some() && !is_curved
}

/// Raw frames with more read noise than stated.
pub(super) fn noise(scene: &Scene, rig: &Rig) -> Option<Departure> {
    if !noise_is_known(scene) {
        return None;
    }
    more_noise(scene.reconstruction.read_noise_dn?, rig.pi.camera.read_noise_dn?)
}

/// The excess noise from the found noise (with its standard error), DN.
fn more_noise([found, error]: [f64; 2], stated: f64) -> Option<Departure> {
    let expected = stated.powi(2) + ROUNDING_VARIANCE;
    let beyond = found.powi(2) - expected;
    let of_beyond = (2.0 * found * error).hypot(STATED_VARIANCE_ERROR * expected);
    let (z, more) = (beyond / of_beyond.max(1e-9), beyond.max(0.0).sqrt());
    (z > MIN_STANDARD_ERRORS && beyond > expected).then(|| Departure {
        id: EffectId::FrameNoise,
        parameters: vec![("sigma_dn", [more, 0.5 * of_beyond / more])],
        description: format!(
            "raw frames have a read noise of {found:.1} DN, not the {stated:.1} DN stated"
        ),
        z,
        without: None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn excess_noise_is_measured_above_the_statement() {
        assert!(more_noise([0.86, 0.02], 0.8).is_none());
        assert!(more_noise([1.6, 0.5], 0.8).is_none(), "large, but not significant");
        let found = more_noise([3.0, 0.05], 0.8).unwrap();
        let [more, error] = found.parameters[0].1;
        assert!((more - (9.0 - 0.64 - 1.0 / 12.0_f64).sqrt()).abs() < 1e-9 && error < 0.1);
    }

    #[test]
    fn nearly_linear_frames_are_linear() {
        let tone = |gamma, error| ToneFit { gamma: [gamma, error], corner_loss: [0.0, 0.01] };
        assert!(curve(&tone(1.02, 0.002)).is_none());
        assert!(curve(&tone(0.9, 0.05)).is_none());
        assert!(curve(&tone(0.9, 0.01)).is_some_and(|found| found.z > 5.0));
    }
}
