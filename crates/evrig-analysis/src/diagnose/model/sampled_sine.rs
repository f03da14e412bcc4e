//! A sine between instants, where straight lines follow it.

/// Half the phase step beyond which linear interpolation fails and is not compensated further.
const MAX_HALF_STEP_RAD: f64 = 0.35 * std::f64::consts::PI;

/// How much higher than it is a swing has to be at instants for straight lines between these to swing as high
/// as it does: they lose the square of a sinc, 3 % at ten instants a swing. `turn` is its phase from one to the
/// next.
pub(crate) fn interpolation_gain(turn: f64) -> f64 {
    let half = half_of(turn);
    if half > 0.0 { (half / half.sin()).powi(2) } else { 1.0 }
}

/// What such lines are wrong by about the crest of a swing, as a share of it: a standard error. Their own crest is as
/// high as the instant that is next to the swing's, which is a chance, the same all along where a swing takes a whole
/// number of instants.
pub(crate) fn interpolation_error(turn: f64) -> f64 {
    let half = half_of(turn);
    interpolation_gain(turn) * (1.0 - half.cos()) / 12.0_f64.sqrt()
}

fn half_of(turn: f64) -> f64 {
    (0.5 * turn).min(MAX_HALF_STEP_RAD)
}
