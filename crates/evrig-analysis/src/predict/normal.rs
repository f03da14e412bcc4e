//! Hazard, cumulative hazard and linear loss of the standard normal distribution, from tables.

use statrs::function::erf::erfc;
use std::f64::consts::{FRAC_1_SQRT_2, PI};
use std::sync::LazyLock;

/// Table entries per unit.
const PER_UNIT: f64 = 64.0;

/// The tables cover minus this to this; beyond, series are used.
const FAR: f64 = 12.0;

/// Cumulative hazard, hazard and slope of the hazard on the grid from `-FAR`.
static TABLE: LazyLock<Vec<[f64; 3]>> = LazyLock::new(|| {
    let n = (2.0 * FAR * PER_UNIT) as usize + 2;
    (0..n).map(|i| exact(i as f64 / PER_UNIT - FAR)).collect()
});

fn exact(z: f64) -> [f64; 3] {
    let survives = below(-z);
    let hazard = density(z) / survives;
    // Each form keeps its digits on its side.
    let integral = if z < 0.0 { -(-below(z)).ln_1p() } else { -survives.ln() };
    [integral, hazard, hazard * (hazard - z)]
}

/// Linear loss and its slope on the grid from `-FAR`.
static LINEAR_LOSS: LazyLock<Vec<[f64; 2]>> = LazyLock::new(|| {
    let n = (2.0 * FAR * PER_UNIT) as usize + 2;
    let exact = |z: f64| [z * below(z) + density(z), below(z)];
    (0..n).map(|i| exact(i as f64 / PER_UNIT - FAR)).collect()
});

fn below(z: f64) -> f64 {
    0.5 * erfc(-z * FRAC_1_SQRT_2)
}

/// Mean of `max(0, x + z)` for a standard normal `x`; error below 1e-7.
pub(super) fn linear_loss(z: f64) -> f64 {
    if z.abs() >= FAR {
        return z.max(0.0);
    }
    let at = (z + FAR) * PER_UNIT;
    let index = at as usize;
    let [a, b] = [LINEAR_LOSS[index], LINEAR_LOSS[index + 1]];
    cubic([a[0], b[0]], [a[1], b[1]], at - index as f64)
}

fn density(z: f64) -> f64 {
    (-0.5 * z * z).exp() / (2.0 * PI).sqrt()
}

/// The grid step about `z` and the position within it.
fn grid_step(z: f64) -> ([[f64; 3]; 2], f64) {
    let at = (z + FAR) * PER_UNIT;
    let index = at as usize;
    ([TABLE[index], TABLE[index + 1]], at - index as f64)
}

/// Cubic Hermite interpolation between two values with slopes per unit.
fn cubic(values: [f64; 2], slopes: [f64; 2], u: f64) -> f64 {
    let [a, b] = values;
    let [m, n] = slopes.map(|slope| slope / PER_UNIT);
    let rest = u * (1.0 - u);
    a + (b - a) * u + rest * ((a - b + m) * (1.0 - u) + (b - a - n) * u)
}

/// Minus the log-probability that a standard normal number is above `z`; relative error below 1e-5.
pub(super) fn cumulative_hazard(z: f64) -> f64 {
    if z < -FAR {
        return 0.0;
    }
    if z >= FAR {
        return 0.5 * z * z + (z * (2.0 * PI).sqrt()).ln() + 1.0 / (z * z);
    }
    let ([a, b], u) = grid_step(z);
    cubic([a[0], b[0]], [a[1], b[1]], u)
}

/// Hazard at `z`, the slope of [`cumulative_hazard`]; relative error below 1e-5.
pub(super) fn hazard(z: f64) -> f64 {
    if z < -FAR {
        return 0.0;
    }
    if z >= FAR {
        return z + 1.0 / z;
    }
    let ([a, b], u) = grid_step(z);
    cubic([a[1], b[1]], [a[2], b[2]], u)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_agrees_with_the_functions() {
        for i in -7_000..=7_000 {
            let z = f64::from(i) * 1.001e-3;
            let [integral, rate, _] = exact(z);
            assert!(
                (cumulative_hazard(z) / integral - 1.0).abs() < 1e-6,
                "{z}: {} {integral}",
                cumulative_hazard(z)
            );
            assert!((hazard(z) / rate - 1.0).abs() < 2e-6, "{z}: {} {rate}", hazard(z));
            assert!(
                (linear_loss(z) - z * below(z) - density(z)).abs() < 1e-7,
                "{z}: {}",
                linear_loss(z)
            );
        }
    }

    #[test]
    fn the_series_continue_the_table() {
        let (here, beyond) = (11.999, 12.001);
        assert!(
            (cumulative_hazard(beyond) - cumulative_hazard(here) - 0.002 * hazard(here)).abs()
                < 1e-3
        );
        assert!((hazard(beyond) / hazard(here) - 1.0).abs() < 1e-3);
        assert_eq!([cumulative_hazard(-40.0), hazard(-40.0), linear_loss(-40.0)], [0.0; 3]);
        assert_eq!(linear_loss(40.0), 40.0);
    }
}
