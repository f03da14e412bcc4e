//! The reference level that a pixel stores at an event.

use super::leaky_signal::LeakySignal;
use super::pixel_law::PixelLaw;
use super::reference_state::ReferenceState;

/// Residuals beyond this many scales have a probability below 0.001: the reference level is then
/// assumed to be wrong.
const MAX_RESIDUAL_SCALES: f64 = 7.0;

/// An event, as far as it changes the reference level.
#[derive(Debug, Clone, Copy)]
pub(super) struct FiredEvent {
    pub(super) t_us: f64,
    pub(super) on: bool,
    /// Probability that it was a background event.
    pub(super) background_share: f64,
}

/// The state of a pixel after a reset; `change` is the signal's change at the event, where known.
pub(super) fn reset(
    signal: &LeakySignal<'_>,
    event: FiredEvent,
    change: Option<f64>,
    end_us: f64,
) -> ReferenceState {
    let law = signal.law;
    let position = signal.position((event.t_us + law.refractory_s * 1e6).min(end_us));
    let value = signal.value(position);
    let mut reference = value;
    let mut scatter = signal.stamp_scatter(position);
    if let Some(change) = change.filter(|_| law.noise_carry > 0.0 || law.corrects_stamps) {
        // What the signal lacked to the threshold was noise, of which a share is stored with it, or
        // a stamp off the event, where the pixel stored what the signal was at the event.
        let noise = law.noise(signal.level(position));
        let (missing, all) = (missing_change(law, event, change), scatter.hypot(noise));
        // After a refractory period no threshold constrains the stored level.
        let is_informative = law.corrects_stamps
            && law.refractory_s <= 0.0
            && missing.abs() <= MAX_RESIDUAL_SCALES * all;
        let stamp_share = if is_informative { (scatter / all.max(1e-300)).powi(2) } else { 0.0 };
        let other = 1.0 - law.noise_carry;
        reference += missing * (law.noise_carry + other * stamp_share);
        scatter *= other * (1.0 - stamp_share).sqrt();
    }
    // The pixel has not fired between the stored level and the present value.
    let extremes = [(value - reference).max(0.0), (reference - value).max(0.0)];
    let noise = signal.noise_after_reset(position, scatter);
    ReferenceState::new(signal, reference, noise).restarted_at(extremes)
}

/// Expected change, upwards, that the signal lacked to the threshold at an event.
fn missing_change(law: &PixelLaw, event: FiredEvent, change: f64) -> f64 {
    let theta = law.theta(event.on);
    // Lost events leave multiples of the threshold; a scattered stamp can be off by more than one.
    let is_single = law.shot_at_white > 0.0 || (law.corrects_stamps && law.drop_fraction <= 0.0);
    let n = if is_single { 1.0 } else { (change / theta).round().max(1.0) };
    let sign = if event.on { 1.0 } else { -1.0 };
    // Share of signal events among those that reset the reference level.
    let resetting = 1.0 - event.background_share * (1.0 - law.background_reset);
    let signal_share = (1.0 - event.background_share) / resetting.max(1e-12);
    sign * signal_share * (theta * n - change).min(theta)
}

/// States after a reset that stored signal noise of unknown size: `plain` without it, with noise in
/// standard deviations and its probability.
pub(super) fn with_stored_noise(
    law: &PixelLaw,
    event: FiredEvent,
    plain: ReferenceState,
    noise: &[[f64; 2]],
) -> impl Iterator<Item = ReferenceState> {
    let sign = if event.on { 1.0 } else { -1.0 };
    let size = law.shot(plain.noise);
    noise.iter().map(move |[noise, weight]| ReferenceState {
        reference: plain.reference + sign * noise * size,
        weight: plain.weight * weight,
        ..plain
    })
}
