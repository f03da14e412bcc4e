//! The logistic function and its integral from a table; a fit evaluates them hundreds of millions of
//! times.

use std::sync::LazyLock;

/// Table entries per unit.
const PER_UNIT: f64 = 32.0;

/// Beyond this the asymptotes are exact in double precision.
const FAR: f64 = 36.0;

/// Entries of the table.
const N_ENTRIES: usize = (FAR * PER_UNIT) as usize + 1;

/// The integral and the function at `0`, `-1 / PER_UNIT`, and so on to `-FAR`; of a length known to
/// the compiler and without a pointer to follow.
static TABLE: LazyLock<[[f64; 2]; N_ENTRIES]> = LazyLock::new(|| {
    std::array::from_fn(|i| {
        let power = (-(i as f64) / PER_UNIT).exp();
        [power.ln_1p(), power / (1.0 + power)]
    })
});

/// The table entry nearest to `-|z|` and the distance to it.
#[inline]
fn nearest(z: f64) -> ([f64; 2], f64) {
    let units = z.abs() * PER_UNIT;
    // A conversion to 32 bits takes fewer instructions.
    let index = (units + 0.5) as u32 as usize;
    (TABLE[index], (index as f64 - units) / PER_UNIT)
}

/// `ln(1 + e^z)` without overflow; relative error below 1e-11.
#[inline]
pub(crate) fn softplus(z: f64) -> f64 {
    if z.abs() >= FAR {
        return if z > 0.0 { z } else { z.exp() };
    }
    let ([value, s], d) = nearest(z);
    // The derivatives of the logistic function are polynomials in itself.
    let p = s * (1.0 - s);
    let fourth = p * (1.0 - 6.0 * p) / 24.0;
    let third = p * (1.0 - 2.0 * s) / 6.0;
    value + d * (s + d * (0.5 * p + d * (third + d * fourth))) + z.max(0.0)
}

/// `1 / (1 + e^-z)`; relative error below 1e-10.
#[inline]
pub(crate) fn logistic(z: f64) -> f64 {
    if z.abs() >= FAR {
        return if z > 0.0 { 1.0 } else { z.exp() };
    }
    let ([_, s], d) = nearest(z);
    let p = s * (1.0 - s);
    let turn = p * (1.0 - 2.0 * s);
    let fourth = turn * (1.0 - 12.0 * p) / 24.0;
    let third = p * (1.0 - 6.0 * p) / 6.0;
    let below = s + d * (p + d * (0.5 * turn + d * (third + d * fourth)));
    if z > 0.0 { 1.0 - below } else { below }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_agrees_with_the_functions() {
        for i in -80_000..=80_000 {
            let z = f64::from(i) * 5.003e-4;
            let exact = z.max(0.0) + (-z.abs()).exp().ln_1p();
            assert!((softplus(z) / exact - 1.0).abs() < 1e-11, "{z}: {} {exact}", softplus(z));
            let exact = 1.0 / (1.0 + (-z).exp());
            assert!((logistic(z) / exact - 1.0).abs() < 1e-10, "{z}: {} {exact}", logistic(z));
        }
    }

    #[test]
    fn infinities_have_limits_and_nan_stays_nan() {
        assert_eq!((softplus(f64::INFINITY), logistic(f64::INFINITY)), (f64::INFINITY, 1.0));
        assert_eq!((softplus(f64::NEG_INFINITY), logistic(f64::NEG_INFINITY)), (0.0, 0.0));
        assert!(softplus(f64::NAN).is_nan() && logistic(f64::NAN).is_nan());
    }
}
