//! Sines of known frequency and fitted phase.

use crate::diagnose::ConfidenceInterval;

/// Amplitude of a sine and a cosine part.
pub(super) fn amplitude(
    sine: ConfidenceInterval,
    cosine: ConfidenceInterval,
) -> ConfidenceInterval {
    let value = sine.value.hypot(cosine.value);
    let half = |p: &ConfidenceInterval| p.ci90[1].map_or(f64::NAN, |high| high - p.value);
    let share = |p: &ConfidenceInterval| half(p) * p.value / value;
    let error = share(&sine).hypot(share(&cosine));
    let end = |end: f64| Some(end).filter(|v| v.is_finite());
    ConfidenceInterval { value, ci90: [end((value - error).max(0.0)), end(value + error)] }
}
