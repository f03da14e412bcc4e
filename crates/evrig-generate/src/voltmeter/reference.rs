//! The published program's shortcuts, for comparison with its output.
//!
//! `DVS-Voltmeter` and `Raw2Event` state the same law as [`super::passage`] and depart
//! from it in four places, reproduced here on purpose:
//!
//! 1. An event that does not come before the interval ends moves V along a straight line
//!    towards the drawn barrier and the drawn time; both are forgotten at the next frame. A
//!    pixel slower than the frame rate is therefore far too regular.
//! 2. The side is drawn with its right probability, but the time to it is that of a single
//!    barrier, as if the other did not exist.
//! 3. Against the drift the time comes from the wrong branch of Michael, Schucany and Haas'
//!    square: always the smaller root, so it never exceeds |distance/μ|.
//! 4. Without drift the Lévy time is half of what it should be (a factor √2 applied twice).
//!
//! Time, sorting and noise are evrig's own: the program's f32 clock, its i32 stamps and its
//! global random state are faults of the program, not of the model.

use super::coefficients::DriftDiffusion;
use super::passage::INSIDE;
use crate::random::CounterRng;

/// Moves `v` through an interval as the published program does; like [`super::passage::advance`].
pub(super) fn advance(
    mut v: f64,
    motion: DriftDiffusion,
    span_us: f64,
    draws: &mut CounterRng,
    fire: &mut dyn FnMut(f64, bool),
) -> f64 {
    let mut elapsed = 0.0;
    loop {
        let on = draws.uniform() < super::closed_form::probability_on(v, motion);
        let way = if on { 1.0 - v } else { -1.0 - v };
        let rest = span_us - elapsed;
        let after = time_to(way, motion, draws);
        if after > rest {
            // Never at all (no drift, no noise) moves V nowhere.
            return (v + way * rest / after).clamp(-INSIDE, INSIDE);
        }
        elapsed += after;
        fire(elapsed, on);
        v = 0.0;
    }
}

/// The program's time to a barrier at `way` (signed) with nothing on the other side, µs.
fn time_to(way: f64, motion: DriftDiffusion, draws: &mut CounterRng) -> f64 {
    let DriftDiffusion { drift_per_us: drift, sigma_per_sqrt_us: sigma } = motion;
    if sigma == 0.0 {
        return (way / drift).abs();
    }
    let shape = (way / sigma) * (way / sigma);
    if drift == 0.0 {
        let z = draws.normal();
        return shape / (2.0 * z * z);
    }
    let mean = (way / drift).abs();
    if (way > 0.0) == (drift > 0.0) {
        inverse_gaussian(mean, shape, draws)
    } else {
        against_drift(mean, shape, draws)
    }
}

/// Inverse Gaussian by Michael, Schucany and Haas, written without cancellation.
fn inverse_gaussian(mean: f64, shape: f64, draws: &mut CounterRng) -> f64 {
    let z = draws.normal();
    let r = 0.5 * z * z / shape;
    let delta = 1.0 / mean;
    let small = 1.0 / (delta + r + (r * (r + 2.0 * delta)).sqrt());
    if draws.uniform() * (1.0 + delta * small) <= 1.0 { small } else { mean * mean / small }
}

/// The smaller root for a normal draw truncated to where the square has a root at all.
fn against_drift(mean: f64, shape: f64, draws: &mut CounterRng) -> f64 {
    let square = {
        let x = normal_beyond(2.0 * (shape / mean).sqrt(), draws);
        x * x
    };
    // Roots of t² − t m(m x²/λ − 2) + m²: their product is m², the larger one does not cancel.
    let half_sum = 0.5 * mean * mean * square / shape - mean;
    let large = half_sum + ((half_sum - mean) * (half_sum + mean)).max(0.0).sqrt();
    mean * mean / large
}

/// A normal draw given that it exceeds `edge` >= 0 (Robert, Stat. Comput. 5, 1995).
fn normal_beyond(edge: f64, draws: &mut CounterRng) -> f64 {
    let rate = 0.5 * (edge + (edge * edge + 4.0).sqrt());
    loop {
        let x = edge - draws.uniform().ln() / rate;
        if draws.uniform().ln() <= -0.5 * (x - rate) * (x - rate) {
            return x;
        }
    }
}
