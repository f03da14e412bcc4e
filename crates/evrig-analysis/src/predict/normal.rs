//! The hazard of a normal law, its integral and its loss, from tables.

use statrs::function::erf::erfc;
use std::f64::consts::{FRAC_1_SQRT_2, PI};
use std::sync::LazyLock;

/// Values for each unit.
const PER_UNIT: f64 = 64.0;

/// Between minus this and this the table has values; beyond, series have.
const FAR: f64 = 12.0;

/// The integral, the hazard, and the hazard's slope at `-FAR`, `-FAR + 1 / PER_UNIT`, and so on.
static TABLE: LazyLock<Vec<[f64; 3]>> = LazyLock::new(|| {
    let n = (2.0 * FAR * PER_UNIT) as usize + 2;
    (0..n).map(|i| exact(i as f64 / PER_UNIT - FAR)).collect()
});

fn exact(z: f64) -> [f64; 3] {
    let survives = below(-z);
    let hazard = density(z) / survives;
    // Each where it keeps its digits.
    let spent = if z < 0.0 { -(-below(z)).ln_1p() } else { -survives.ln() };
    [spent, hazard, hazard * (hazard - z)]
}

/// The loss at `-FAR`, and so on, with its slope.
static LOSS: LazyLock<Vec<[f64; 2]>> = LazyLock::new(|| {
    let n = (2.0 * FAR * PER_UNIT) as usize + 2;
    let exact = |z: f64| [z * below(z) + density(z), below(z)];
    (0..n).map(|i| exact(i as f64 / PER_UNIT - FAR)).collect()
});

/// Chance that a standard normal number is below `z`.
fn below(z: f64) -> f64 {
    0.5 * erfc(-z * FRAC_1_SQRT_2)
}

/// Mean by which a standard normal number plus `z` is above nothing; off by less than 1e-7.
pub(super) fn loss(z: f64) -> f64 {
    if z.abs() >= FAR {
        return z.max(0.0);
    }
    let at = (z + FAR) * PER_UNIT;
    let index = at as usize;
    let [a, b] = [LOSS[index], LOSS[index + 1]];
    cubic([a[0], b[0]], [a[1], b[1]], at - index as f64)
}

/// Density of a standard normal number.
fn density(z: f64) -> f64 {
    (-0.5 * z * z).exp() / (2.0 * PI).sqrt()
}

/// The two ends of the table's step about `z`, and the share of it up to `z`.
fn about(z: f64) -> ([[f64; 3]; 2], f64) {
    let at = (z + FAR) * PER_UNIT;
    let index = at as usize;
    ([TABLE[index], TABLE[index + 1]], at - index as f64)
}

/// Between two values with slopes a unit, by Hermite's cubic.
fn cubic(values: [f64; 2], slopes: [f64; 2], u: f64) -> f64 {
    let [a, b] = values;
    let [m, n] = slopes.map(|slope| slope / PER_UNIT);
    let rest = u * (1.0 - u);
    a + (b - a) * u + rest * ((a - b + m) * (1.0 - u) + (b - a - n) * u)
}

/// Minus the logarithm of the chance that a standard normal number is above `z`; off by less than 1e-5
/// of it.
pub(super) fn spent(z: f64) -> f64 {
    if z < -FAR {
        return 0.0;
    }
    if z >= FAR {
        return 0.5 * z * z + (z * (2.0 * PI).sqrt()).ln() + 1.0 / (z * z);
    }
    let ([a, b], u) = about(z);
    cubic([a[0], b[0]], [a[1], b[1]], u)
}

/// Hazard of a standard normal number at `z`, the slope of [`spent`]; off by less than 1e-5 of it.
pub(super) fn hazard(z: f64) -> f64 {
    if z < -FAR {
        return 0.0;
    }
    if z >= FAR {
        return z + 1.0 / z;
    }
    let ([a, b], u) = about(z);
    cubic([a[1], b[1]], [a[2], b[2]], u)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_is_as_good_as_the_functions() {
        for i in -7_000..=7_000 {
            let z = f64::from(i) * 1.001e-3;
            let [integral, rate, _] = exact(z);
            assert!((spent(z) / integral - 1.0).abs() < 1e-6, "{z}: {} {integral}", spent(z));
            assert!((hazard(z) / rate - 1.0).abs() < 2e-6, "{z}: {} {rate}", hazard(z));
            assert!((loss(z) - z * below(z) - density(z)).abs() < 1e-7, "{z}: {}", loss(z));
        }
    }

    #[test]
    fn series_go_on_where_the_table_ends() {
        let (here, beyond) = (11.999, 12.001);
        assert!((spent(beyond) - spent(here) - 0.002 * hazard(here)).abs() < 1e-3);
        assert!((hazard(beyond) / hazard(here) - 1.0).abs() < 1e-3);
        assert_eq!([spent(-40.0), hazard(-40.0), loss(-40.0)], [0.0; 3]);
        assert_eq!(loss(40.0), 40.0);
    }
}
