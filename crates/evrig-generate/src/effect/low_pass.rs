//! A low-pass on a light signal, exact for a signal that is straight from instant to instant.

/// Filters `values` in place by τ y' = x − y, with `tau_steps(x)` the time constant in steps of
/// the grid at a signal `x`. It begins settled, also behind a gap.
pub(super) fn low_pass(values: &mut [f32], tau_steps: impl Fn(f32) -> f64) {
    let (mut before, mut held) = (f64::NAN, f64::NAN);
    for value in values {
        let now = f64::from(*value);
        if before.is_finite() {
            let tau = tau_steps((0.5 * (before + now)) as f32);
            // The steady answer to a slope lags it by τ; the rest decays.
            let lag = (now - before) * tau;
            held = now - lag + (held - before + lag) * (-1.0 / tau).exp();
        } else {
            held = now;
        }
        before = now;
        *value = held as f32;
    }
}

/// The time constant of a pole, in steps.
pub(super) fn tau_steps(cutoff_hz: f64, step_s: f64) -> f64 {
    1.0 / (std::f64::consts::TAU * cutoff_hz * step_s)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_decays_and_a_slope_lags_by_the_time_constant_at_any_step_of_the_grid() {
        for step_s in [1e-4, 1e-3, 1e-2] {
            let tau = tau_steps(10.0, step_s);
            let tau_s = tau * step_s;
            assert!((tau_s - 0.015_915).abs() < 1e-5);
            let n = (0.2 / step_s) as usize;
            let mut slope: Vec<f32> = (0..n).map(|i| (i as f64 * step_s) as f32).collect();
            low_pass(&mut slope, |_| tau);
            let t = (n - 1) as f64 * step_s;
            let exact = t - tau_s * (1.0 - (-t / tau_s).exp());
            assert!((f64::from(slope[n - 1]) - exact).abs() < 1e-5, "{step_s}");
        }
    }

    #[test]
    fn a_gap_stays_a_gap_and_the_filter_settles_behind_it() {
        let mut values = [1.0, 1.0, f32::NAN, 5.0, 5.0];
        low_pass(&mut values, |_| 10.0);
        assert!(values[2].is_nan());
        assert!((values[3] - 5.0).abs() < 1e-6 && (values[4] - 5.0).abs() < 1e-6);
    }
}
