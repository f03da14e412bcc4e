//! Lenses, rows and path found by the scene, against the statement of the rig.

mod luminance;

use evrig_analysis::diagnose::{Departure, Evidence};
use evrig_core::effect_id::EffectId;
use evrig_reconstruct::scene::{HeadVibration, PointSpread, Scene};
use evrig_session::rig::{CameraDescription, Rig};

/// Relative tolerance of the row time, which the scene shares.
const ROW_TIME_TOLERANCE: f64 = 0.15;

/// Excess blur variance of a lens in focus, square pixels.
const MAX_EXCESS_BLUR_PX2: f64 = 0.2;

/// Relative error of the stated blur variance.
const STATED_VARIANCE_ERROR: f64 = 0.1;

/// Amplitude below which events show no vibration, pixels.
const MIN_AMPLITUDE_PX: f64 = 0.02;

/// Significance level of a departure, standard errors.
const MIN_STANDARD_ERRORS: f64 = 5.0;

/// The departures, each with the signal without it and without those after it.
pub(super) fn departures(scene: &Scene, rig: &Rig, evidence: &Evidence) -> Vec<Departure> {
    let mut bare = scene.clone();
    let mut all = Vec::new();
    let mut add = |bare: &Scene, found: Departure| {
        let without = Some(evidence.with_light_of(&bare.drive()));
        all.push(Departure { without, ..found });
    };
    let shake = scene.reconstruction.path.vibration();
    let least_mm = MIN_AMPLITUDE_PX * scene.registration.pixel_mm;
    if let Some(shake) = shake.filter(|shake| shake.amplitude_mm[0] > least_mm) {
        bare.reconstruction.path = bare.reconstruction.path.without_vibration(&shake);
        add(&bare, vibration(&shake));
    }
    if let Some((found, spread)) = blur(scene, rig) {
        bare.registration.spread = spread;
        add(&bare, found);
    }
    if let Some(moving) = bare.reconstruction.moving_illumination.take() {
        add(&bare, luminance::shadow(&moving));
    }
    if let Some((tone, found)) =
        bare.registration.tone.and_then(|t| Some((t, luminance::curve(&t)?)))
    {
        bare.reconstruction = bare.reconstruction.with_power(1.0 / tone.power());
        add(&bare, found);
    }
    // These do not change the signal.
    let row_us = scene.reconstruction.row_s.map(|s| s * 1e6);
    let stated_us = rig.pi.camera.row_time.as_secs_f64() * 1e6;
    all.extend(luminance::noise(scene, rig));
    all.extend(luminance::corners(scene));
    all.extend(rows(row_us, stated_us));
    all.reverse();
    all
}

/// Effects that the frames of a session can show.
pub(super) fn testable_from_frames(scene: &Scene, rig: Option<&Rig>) -> Vec<EffectId> {
    let tone = scene.registration.tone;
    let corners = scene.reconstruction.corner_loss.is_some() || tone.is_some();
    let noise = rig.is_some_and(|rig| rig.pi.camera.read_noise_dn.is_some())
        && luminance::noise_is_known(scene);
    [
        (EffectId::MovingShadow, true),
        (EffectId::ToneCurve, tone.is_some()),
        (EffectId::Vignetting, corners),
        (EffectId::FrameNoise, noise),
    ]
    .into_iter()
    .filter_map(|(id, is_shown)| is_shown.then_some(id))
    .collect()
}

/// Delay of the Pi's cropped rows against the statement, since the rows above take longer,
/// microseconds.
pub(super) fn row_delay_us(scene: &Scene, rig: &Rig) -> f64 {
    let found_us = scene.reconstruction.row_s.map(|s| s * 1e6);
    let stated_us = rig.pi.camera.row_time.as_secs_f64() * 1e6;
    let above = f64::from(rig.pi.crop_origin_px[1]);
    rows(found_us, stated_us).map_or(0.0, |_| above * (found_us[0] - stated_us))
}

/// A departure of the Pi's row time (with its standard error) from the stated one, microseconds.
fn rows([found, error]: [f64; 2], stated: f64) -> Option<Departure> {
    let z = (found - stated).abs() / error.max(1e-9);
    let is_off = z > MIN_STANDARD_ERRORS && (found - stated).abs() > ROW_TIME_TOLERANCE * stated;
    is_off.then(|| Departure {
        id: EffectId::RollingShutter,
        parameters: vec![("row_us", [found, error])],
        description: format!(
            "the row time of the Pi's frames is {found:.2} us, not the {stated:.2} us stated"
        ),
        z,
        without: None,
    })
}

/// The event camera's blur beyond the statement, and the stated spread.
fn blur(scene: &Scene, rig: &Rig) -> Option<(Departure, PointSpread)> {
    let angle =
        |camera: &CameraDescription| camera.pixel_pitch.value() / camera.focal_length.value();
    let (davis, pi) = (&rig.davis.camera, &rig.pi.camera);
    let stated = [davis.psf_sigma_px?, pi.psf_sigma_px? * angle(pi) / angle(davis)];
    let fitted = scene.registration.spread;
    let found = [fitted.sigma_px, scene.registration.sigma_error_px];
    let (departure, sigma_px) = out_of_focus(found, stated)?;
    Some((departure, PointSpread { sigma_px, ..fitted }))
}

/// A departure of the fitted blur (standard deviation and error) from the stated ones of event
/// camera and Pi, in event pixels; with the stated blur.
fn out_of_focus([sigma, error]: [f64; 2], [davis, pi]: [f64; 2]) -> Option<(Departure, f64)> {
    // The map includes the blur of the Pi's lens.
    let stated = (davis.powi(2) - pi.powi(2)).max(0.0);
    let beyond = sigma.powi(2) - stated;
    let error = (2.0 * sigma * error).hypot(STATED_VARIANCE_ERROR * stated);
    let (z, more) = (beyond / error.max(1e-9), beyond.max(0.0).sqrt());
    let departure = || Departure {
        id: EffectId::Defocus,
        parameters: vec![("sigma_px", [more, 0.5 * error / more])],
        description: format!(
            "the event camera's image is blurred by {more:.2} px more than stated"
        ),
        z,
        without: None,
    };
    (z > MIN_STANDARD_ERRORS && beyond > MAX_EXCESS_BLUR_PX2).then(|| (departure(), stated.sqrt()))
}

/// A vibration of the head.
fn vibration(shake: &HeadVibration) -> Departure {
    let ([hz, _], [mm, _]) = (shake.frequency_hz, shake.amplitude_mm);
    Departure {
        id: EffectId::Vibration,
        parameters: vec![
            ("frequency_hz", shake.frequency_hz),
            ("amplitude_mm", shake.amplitude_mm),
        ],
        description: format!(
            "the head vibrates along its path at {hz:.1} Hz with an amplitude of {mm:.3} mm"
        ),
        z: shake.peak_ratio,
        without: None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lens_in_focus_and_stated_rows_are_no_departure() {
        // A fit to the simulated rig: 0.4637, where the lenses give 0.476.
        assert!(out_of_focus([0.4637, 0.0007], [0.5, 0.153]).is_none());
        assert!(rows([9.40, 0.24], 9.21).is_none());
        // Large, but not significant.
        assert!(rows([14.0, 2.0], 9.21).is_none());
    }

    #[test]
    fn a_departure_is_measured_from_the_statement() {
        let (found, left) = out_of_focus([0.9, 0.001], [0.5, 0.153]).unwrap();
        let expected = (0.9_f64.powi(2) - 0.5_f64.powi(2) + 0.153_f64.powi(2)).sqrt();
        assert!((found.parameters[0].1[0] - expected).abs() < 1e-12);
        assert!((left.hypot(0.153) - 0.5).abs() < 1e-12);
        let found = rows([18.0, 0.3], 9.21).unwrap();
        assert_eq!(found.parameters, [("row_us", [18.0, 0.3])]);
        assert!(found.description.contains("not the 9.21 us"), "{}", found.description);
    }
}
