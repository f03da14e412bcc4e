//! **polarity_delta** = |p_sim - p_real|, p the share of ON events.
//!
//! Sensitive to the ratio of ON and OFF thresholds. Source: the measures the authors of Raw2Event
//! report; healthy is at most 0.10. Error: time blocks; the signed difference is resampled, and
//! where its interval contains zero, that of the absolute value starts at zero.
//!
//! Insensitive to polarity errors that cancel between pixels.

use super::ProfilePair;
use super::measure::{Cluster, Measure, MeasureDefinition, MeasureId, RAW2EVENT_MEASURES};
use evrig_core::stats::{Estimate, dot};

const DEFINITION: MeasureDefinition = MeasureDefinition {
    id: MeasureId::PolarityDelta,
    name: "Difference of the ON share",
    formula: "|p_sim - p_real|, p = N_on / N",
    source: RAW2EVENT_MEASURES,
    unit: "1",
    clusters: Cluster::TimeBlock,
    healthy: Some([0.0, 0.10]),
};

pub(super) fn measure(pair: &ProfilePair<'_>) -> Measure {
    let (real, real_on) = pair.real.by_block();
    let (simulated, simulated_on) = pair.simulated.by_block();
    let share = |on: &[f64], all: &[f64]| on.iter().sum::<f64>() / all.iter().sum::<f64>();
    let of_each = |measure: Measure| {
        measure.of_each(share(&real_on, &real), share(&simulated_on, &simulated))
    };
    if let Some(because) = pair.missing_events() {
        return of_each(DEFINITION.unknown(because));
    }
    let n = pair.real.n + pair.simulated.n;
    let signed = pair.bootstrap.estimate(real.len(), n, |w| {
        dot(w, &simulated_on) / dot(w, &simulated) - dot(w, &real_on) / dot(w, &real)
    });
    of_each(DEFINITION.with(magnitude(signed)))
}

/// The estimate of the absolute value.
fn magnitude(signed: Estimate) -> Estimate {
    let [low, high] = signed.ci90;
    let far = low.abs().max(high.abs());
    let near = if low <= 0.0 && high >= 0.0 { 0.0 } else { low.abs().min(high.abs()) };
    let ci90 = if low.is_nan() { signed.ci90 } else { [near, far] };
    Estimate::with_interval(signed.value.abs(), signed.standard_error, ci90, signed.n)
}
