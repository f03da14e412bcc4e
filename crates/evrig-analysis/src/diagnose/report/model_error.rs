//! Errors of a parameter that no scatter shows: of the law, the light and the clock.

use crate::diagnose::ConfidenceInterval;
use crate::diagnose::model::sampled_sine::interpolation_error;
use evrig_core::stats::Z90;
use std::collections::BTreeMap;
use std::f64::consts::TAU;

/// Standard error of the law and of the interpolated light, as a share of a value: refractory
/// periods, leaks and cutoffs of simulated recordings, our own and third-party, are off by 0.2 to
/// 0.4 % where the scatter is far smaller.
const MODEL_ERROR_SHARE: f64 = 2e-3;

/// Tolerance of a clock's crystal, which limits a frequency.
const CLOCK_ERROR_SHARE: f64 = 5e-5;

/// Widens the intervals of an effect's parameters by these errors, and by that of a sinusoid
/// interpolated between instants `step_us` apart. A ratio of one is absence of the effect.
pub(crate) fn widen_by_model_error(
    parameters: &mut BTreeMap<String, ConfidenceInterval>,
    step_us: f64,
) {
    let hz = parameters.get("frequency_hz").map_or(0.0, |frequency| frequency.value);
    let objection_to_all = MODEL_ERROR_SHARE.hypot(interpolation_error(TAU * hz * step_us * 1e-6));
    for (key, ConfidenceInterval { value, ci90 }) in parameters.iter_mut() {
        let none = if key == "on_off_ratio" { 1.0 } else { 0.0 };
        let share = if key == "frequency_hz" { CLOCK_ERROR_SHARE } else { objection_to_all };
        let more = Z90 * share * (*value - none).abs();
        let is_given = ci90[0] == ci90[1];
        for end in ci90.iter_mut().flatten().filter(|_| !is_given) {
            let own = *end - *value;
            let wider = *value + own.signum() * own.hypot(more);
            // An interval bounded by zero stays so.
            *end = if *end >= 0.0 { wider.max(0.0) } else { wider };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_interval_includes_the_model_error() {
        let widened = |key: &str, value: f64, ci90: [f64; 2]| {
            let mut all =
                [(key.to_owned(), ConfidenceInterval { value, ci90: ci90.map(Some) })].into();
            widen_by_model_error(&mut all, 1_000.0);
            all[key].ci90.map(Option::unwrap)
        };
        // 16.4 us of the model and 12.3 us of scatter: 20.6 us.
        let [low, high] = widened("refractory_us", 5_000.0, [4_987.7, 5_012.3]);
        assert!((low - 4_979.43).abs() < 0.1 && (high - 5_020.57).abs() < 0.1, "{low} {high}");
        let [low, high] = widened("frequency_hz", 100.0, [99.9999, 100.0001]);
        assert!((low - 99.9918).abs() < 1e-3 && (high - 100.0082).abs() < 1e-3, "{low} {high}");
        assert_eq!(widened("order", 1.0, [1.0, 1.0]), [1.0, 1.0]);
        assert_eq!(widened("rate_hz", 0.1, [0.0, 0.2])[0], 0.0);
        let [low, high] = widened("on_off_ratio", 1.1, [1.0999, 1.1001]);
        assert!(high - low < 1e-3 && high - low > 5e-4, "{low} {high}");
    }

    #[test]
    fn a_sinusoid_with_few_samples_has_an_interpolation_error() {
        let within = |hz: f64| {
            let depth = ConfidenceInterval { value: 0.05, ci90: [Some(0.05), Some(0.0500001)] };
            let frequency = ConfidenceInterval { value: hz, ci90: [Some(hz), Some(hz)] };
            let mut all = [("depth", depth), ("frequency_hz", frequency)]
                .map(|(key, interval)| (key.to_owned(), interval))
                .into();
            widen_by_model_error(&mut all, 1_000.0);
            (all["depth"].ci90[1].unwrap() / 0.05 - 1.0) / Z90
        };
        // Ten samples per period: a crest from 0.983 to 1.034.
        assert!((within(100.0) - 0.0147).abs() < 3e-4, "{}", within(100.0));
        assert!((within(5.0) - MODEL_ERROR_SHARE).abs() < 2e-5, "{}", within(5.0));
    }
}
