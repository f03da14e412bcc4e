//! Closed forms of the two-barrier first passage: what draws are tested against, and what
//! likelihoods are made of.
//!
//! V starts at v in −1..1 and moves with drift μ and diffusion σ until it hits +1 (On) or
//! −1 (Off). With b = μ/σ² all laws depend on b, σ²t and v only. Source: Borodin and
//! Salminen, Handbook of Brownian Motion, 2nd ed. 2002, part II, 2.3.0 and 2.1.8.

use super::Motion;

/// Probability that +1 is hit before −1 from `v`; without noise, the side of the drift, and
/// 1/2 when nothing moves at all.
#[must_use]
pub fn probability_on(v: f64, motion: Motion) -> f64 {
    let Motion { drift_per_us, sigma_per_sqrt_us } = motion;
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
pub fn mean_interval_us(motion: Motion) -> f64 {
    let (b, rate) = scaled(motion);
    let tanh_over_b = if b.abs() < 1e-4 { 1.0 - b * b / 3.0 } else { b.tanh() / b };
    tanh_over_b / rate
}

/// Standard deviation of the time from 0 to a barrier, µs.
#[must_use]
pub fn sd_interval_us(motion: Motion) -> f64 {
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
fn scaled(motion: Motion) -> (f64, f64) {
    let rate = motion.sigma_per_sqrt_us * motion.sigma_per_sqrt_us;
    (motion.drift_per_us / rate, rate)
}
