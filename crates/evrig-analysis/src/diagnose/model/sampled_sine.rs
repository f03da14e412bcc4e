//! Linear interpolation of a sampled sinusoid.

/// Half the phase step beyond which linear interpolation fails and is not compensated further.
const MAX_HALF_STEP_RAD: f64 = 0.35 * std::f64::consts::PI;

/// Amplification for which the linear interpolation of a sinusoid has unit amplitude:
/// interpolation multiplies it by a squared sinc, a loss of 3 % at ten samples per period. `turn`
/// is the phase step.
pub(crate) fn interpolation_gain(turn: f64) -> f64 {
    let half = half_of(turn);
    if half > 0.0 { (half / half.sin()).powi(2) } else { 1.0 }
}

/// Standard error of the interpolated crest, relative to the amplitude: the crest is that of the
/// nearest sample, at a uniformly distributed distance.
pub(crate) fn interpolation_error(turn: f64) -> f64 {
    let half = half_of(turn);
    interpolation_gain(turn) * (1.0 - half.cos()) / 12.0_f64.sqrt()
}

fn half_of(turn: f64) -> f64 {
    (0.5 * turn).min(MAX_HALF_STEP_RAD)
}
