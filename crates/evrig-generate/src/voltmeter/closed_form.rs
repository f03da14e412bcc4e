//! Closed forms of the two-barrier first passage: what draws are tested against, and what
//! likelihoods are made of.
//!
//! V starts at v in −1..1 and moves with drift μ and diffusion σ until it hits +1 (On) or
//! −1 (Off). With b = μ/σ² all laws depend on b, σ²t and v only. Source: Borodin and
//! Salminen, Handbook of Brownian Motion, 2nd ed. 2002, part II, 2.3.0 and 2.1.8.

use super::coefficients::DriftDiffusion;
use std::f64::consts::{FRAC_1_SQRT_2, PI};

/// Probability that +1 is hit before −1 from `v`; without noise, the side of the drift, and
/// 1/2 when nothing moves at all.
#[must_use]
pub fn probability_on(v: f64, motion: DriftDiffusion) -> f64 {
    let DriftDiffusion { drift_per_us, sigma_per_sqrt_us } = motion;
    let (above, below) = (1.0 - v, 1.0 + v);
    if drift_per_us == 0.0 {
        return 0.5 * below;
    }
    let b = drift_per_us / (sigma_per_sqrt_us * sigma_per_sqrt_us);
    // (1 − e^{−2bB})/(1 − e^{−4b}), with the sign of b chosen so that exponents fall.
    if b > 0.0 {
        (-2.0 * b * below).exp_m1() / (-4.0 * b).exp_m1()
    } else {
        (2.0 * b * above).exp() * (2.0 * b * below).exp_m1() / (4.0 * b).exp_m1()
    }
}

/// Mean time from 0 to a barrier, µs.
#[must_use]
pub fn mean_interval_us(motion: DriftDiffusion) -> f64 {
    let (b, rate) = scaled(motion);
    let tanh_over_b = if b.abs() < 1e-4 { 1.0 - b * b / 3.0 } else { b.tanh() / b };
    tanh_over_b / rate
}

/// Standard deviation of the time from 0 to a barrier, µs.
#[must_use]
pub fn sd_interval_us(motion: DriftDiffusion) -> f64 {
    let (b, rate) = scaled(motion);
    let variance = if b.abs() < 0.05 {
        // Series of (tanh b − b sech² b)/b³; the next term, 496/2835 b⁶, is below 1e-8 of it.
        2.0 / 3.0 - 8.0 / 15.0 * b * b + 34.0 / 105.0 * b.powi(4)
    } else {
        let sech = 1.0 / b.abs().min(350.0).cosh();
        (b.tanh() - b * sech * sech) / b.powi(3)
    };
    variance.sqrt() / rate
}

/// b = μ/σ² and σ² (1/µs).
fn scaled(motion: DriftDiffusion) -> (f64, f64) {
    let rate = motion.sigma_per_sqrt_us * motion.sigma_per_sqrt_us;
    (motion.drift_per_us / rate, rate)
}

/// Probability that neither barrier was hit by `t_us` from `v`.
#[must_use]
pub fn survival(v: f64, motion: DriftDiffusion, t_us: f64) -> f64 {
    residual_mass(v, motion, t_us, 1.0)
}

/// Probability that neither barrier was hit by `t_us` from `v` and V is at most `z` then.
///
/// Without noise the path is a line and the mass is 0 or 1.
#[must_use]
pub fn residual_mass(v: f64, motion: DriftDiffusion, t_us: f64, z: f64) -> f64 {
    let (b, rate) = scaled(motion);
    let s = rate * t_us;
    let mass = if s < f64::MIN_POSITIVE {
        let end = v + motion.drift_per_us * t_us;
        f64::from(end.abs() < 1.0 && end <= z)
    } else if s < 1.0 {
        mass_by_images(v, b, s, z)
    } else {
        mass_by_modes(v, b, s, z)
    };
    mass.clamp(0.0, 1.0)
}

/// Sources mirrored at both barriers; converges fast for small s = σ²t.
fn mass_by_images(v: f64, b: f64, s: f64, z: f64) -> f64 {
    let sd = s.sqrt();
    // e^weight (Φ of the upper end − Φ of the lower end) of a source at `from`.
    let source = |from: f64, weight: f64| {
        let (low, high) = ((-1.0 - from - b * s) / sd, (z - from - b * s) / sd);
        // Both ends on one side of the source: the nearer tail loses no digits.
        if low > 0.0 {
            weighted_tail(weight, low) - weighted_tail(weight, high)
        } else {
            weighted_tail(weight, -high) - weighted_tail(weight, -low)
        }
    };
    let pair = |n: f64| {
        source(v - 4.0 * n, -4.0 * n * b) - source(2.0 - v - 4.0 * n, 2.0 * b * (1.0 - v - 2.0 * n))
    };
    (-4..=4).map(|n| pair(f64::from(n))).sum()
}

/// e^weight P(Z > x) for a normal Z, without overflow on the way.
fn weighted_tail(weight: f64, x: f64) -> f64 {
    const DEEP: f64 = 3.0;
    if x < DEEP {
        return weight.exp() * 0.5 * statrs::function::erf::erfc(x * FRAC_1_SQRT_2);
    }
    // Laplace's continued fraction of Mills' ratio; 60 terms give full precision from x = 3.
    let mills = (1..=60).rev().fold(x, |below, n| x + f64::from(n) / below);
    (weight - 0.5 * x * x).exp() / (mills * (2.0 * PI).sqrt())
}

/// Modes between the barriers; converges fast for large s = σ²t.
fn mass_by_modes(v: f64, b: f64, s: f64, z: f64) -> f64 {
    let mode = |n: u32| {
        let k = 0.5 * PI * f64::from(n);
        let decay = -0.5 * (b * b + k * k) * s - b * v;
        let (sin, cos) = (k * (z + 1.0)).sin_cos();
        let upper = (decay + b * z).exp() * (b * sin - k * cos);
        let lower = (decay - b).exp() * k;
        (k * (v + 1.0)).sin() * (upper + lower) / (b * b + k * k)
    };
    (1..=12).map(mode).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn motion(b: f64, rate: f64) -> DriftDiffusion {
        DriftDiffusion { drift_per_us: b * rate, sigma_per_sqrt_us: rate.sqrt() }
    }

    #[test]
    fn images_and_modes_agree_where_both_converge() {
        for b in [-6.0, -1.0, 0.0, 0.3, 3.0] {
            for v in [-0.9, 0.0, 0.5] {
                for (s, z) in [(0.6, 1.0), (1.0, 0.2), (1.6, -0.4)] {
                    let (images, modes) = (mass_by_images(v, b, s, z), mass_by_modes(v, b, s, z));
                    assert!((images - modes).abs() < 1e-10, "{b} {v} {s}: {images} {modes}");
                }
            }
        }
    }

    #[test]
    fn mean_and_spread_are_the_integrals_of_survival() {
        for b in [-3.0, 0.0, 0.04, 0.06, 1.0, 8.0] {
            let motion = motion(b, 1e-4);
            let mean = mean_interval_us(motion);
            // Midpoint rule: E[T] = ∫ S, E[T²] = 2 ∫ t S.
            let dt = 20.0;
            let (mut first, mut second) = (0.0, 0.0);
            for i in 0..8_000 {
                let t = (f64::from(i) + 0.5) * dt;
                let alive = survival(0.0, motion, t);
                first += alive * dt;
                second += 2.0 * t * alive * dt;
            }
            assert!((first / mean - 1.0).abs() < 1e-4, "b {b}: {first} {mean}");
            let sd = (second - first * first).sqrt();
            assert!((sd / sd_interval_us(motion) - 1.0).abs() < 1e-3, "b {b}");
        }
    }

    #[test]
    fn a_strong_drift_gives_the_single_barrier_law_without_overflow() {
        // With bs = A = 1: Φ(0) − e^{2b} Φ(−2√b), by Python's math and the same tail formula
        // in double precision: 0.4971791931085053.
        let (b, s) = (5_000.0, 1.0 / 5_000.0);
        let up = survival(0.0, motion(b, 1.0), s);
        let down = survival(0.0, motion(-b, 1.0), s);
        assert!((up - down).abs() < 1e-12);
        assert!((up - 0.497_179_193_108_505_3).abs() < 1e-12, "{up}");
        assert!(survival(0.0, motion(b, 1.0), 0.8 * s) > 1.0 - 1e-12);
        assert!(survival(0.0, motion(b, 1.0), 1.3 * s) < 1e-12);
    }

    #[test]
    fn the_side_has_its_limits_in_drift_and_noise() {
        let on = |v, drift_per_us, sigma_per_sqrt_us| {
            probability_on(v, DriftDiffusion { drift_per_us, sigma_per_sqrt_us })
        };
        assert!((on(0.5, 0.0, 1.0) - 0.75).abs() < 1e-15);
        assert!((on(0.5, 1e-12, 1.0) - 0.75).abs() < 1e-9);
        assert!((on(0.5, -1e-12, 1.0) - 0.75).abs() < 1e-9);
        assert!((on(0.0, 1.0, 1.0) - 1.0 / (1.0 + (-2.0_f64).exp())).abs() < 1e-15);
        assert!((on(0.0, -1.0, 1.0) - 1.0 / (1.0 + 2.0_f64.exp())).abs() < 1e-15);
        assert_eq!([on(0.3, 1.0, 0.0), on(0.3, -1.0, 0.0), on(0.0, 1e3, 1e-9)], [1.0, 0.0, 1.0]);
    }
}
