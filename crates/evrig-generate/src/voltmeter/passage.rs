//! Exact two-barrier first passage of drifting Brownian motion, one pixel at a time.
//!
//! V moves as dV = μ dt + σ dW between the barriers −1 and +1; at a barrier it fires and
//! starts again at 0 with fresh noise (strong Markov property). The interval is cut into
//! steps so short that only one barrier can be reached within a step; then the end of the
//! step is Gaussian, whether the barrier was crossed before is the crossing of a Brownian
//! bridge, and when it was crossed is an inverse Gaussian in the bridge's own time
//! (Borodin and Salminen, Handbook of Brownian Motion, 2002). Not crossed, the end
//! of the step is V's exact conditional law, and that is what the next frame starts from.

use super::coefficients::DriftDiffusion;
use crate::random::CounterRng;

/// A barrier farther than this many standard deviations of a step (beyond its drift) counts
/// as out of reach: the neglected mass is below 2 exp(-32) = 2.5e-14 a step.
pub(super) const REACH: f64 = 8.0;

/// V stays inside the barriers, also after rounding.
pub(super) const INSIDE: f64 = 1.0 - f64::EPSILON;

/// Moves `v` (in −1..1) through an interval of `span_us` and returns where it ends; calls
/// `fire` with the time after the start (µs, ascending, in 0..=span) and the side (On: +1).
pub(super) fn advance(
    mut v: f64,
    motion: DriftDiffusion,
    span_us: f64,
    draws: &mut CounterRng,
    fire: &mut dyn FnMut(f64, bool),
) -> f64 {
    let mut elapsed = 0.0;
    loop {
        let step = PassageStep::within(v, motion, span_us - elapsed);
        match step.take(draws) {
            StepEnd::Fired { after_us, on } => {
                elapsed += after_us;
                fire(elapsed, on);
                v = 0.0;
            }
            StepEnd::Moved { by } => {
                elapsed += step.span_us;
                v = (v + by).clamp(-INSIDE, INSIDE);
            }
        }
        if elapsed >= span_us {
            return v;
        }
    }
}

/// A stretch of time in which at most one barrier can be reached.
#[derive(Debug, Clone, Copy)]
struct PassageStep {
    span_us: f64,
    /// Mean and standard deviation of the move.
    mean: f64,
    sd: f64,
    within_reach: BarriersInReach,
}

#[derive(Debug, Clone, Copy)]
enum BarriersInReach {
    Neither,
    /// Distance to the barrier and its side.
    One(f64, bool),
}

enum StepEnd {
    Fired { after_us: f64, on: bool },
    Moved { by: f64 },
}

impl PassageStep {
    /// The longest step of `rest_us`, a half of it, a quarter, ... that reaches one barrier at
    /// most.
    fn within(v: f64, motion: DriftDiffusion, rest_us: f64) -> Self {
        let (above, below) = (1.0 - v, 1.0 + v);
        let mut span_us = rest_us;
        loop {
            let mean = motion.drift_per_us * span_us;
            let sd = motion.sigma_per_sqrt_us * span_us.sqrt();
            let up = above <= REACH * sd + mean.max(0.0);
            let down = below <= REACH * sd + (-mean).max(0.0);
            let within_reach = match (up, down) {
                (false, false) => BarriersInReach::Neither,
                (true, false) => BarriersInReach::One(above, true),
                (false, true) => BarriersInReach::One(below, false),
                (true, true) => {
                    span_us *= 0.5;
                    continue;
                }
            };
            return Self { span_us, mean, sd, within_reach };
        }
    }

    fn take(&self, draws: &mut CounterRng) -> StepEnd {
        let move_freely = self.mean + self.sd * draws.normal();
        let BarriersInReach::One(distance, on) = self.within_reach else {
            return StepEnd::Moved { by: move_freely };
        };
        let towards = if on { move_freely } else { -move_freely };
        if towards >= distance || bridge_crosses(distance, towards, self.sd, draws) {
            let share = crossing_share(distance, towards, self.sd, draws);
            return StepEnd::Fired { after_us: share * self.span_us, on };
        }
        StepEnd::Moved { by: move_freely }
    }
}

/// Whether a Brownian bridge that ends at `towards` < `distance` was at `distance` before.
#[inline]
pub(crate) fn bridge_crosses(distance: f64, towards: f64, sd: f64, draws: &mut CounterRng) -> bool {
    let exponent = 2.0 * distance * (distance - towards) / (sd * sd);
    // Below the smallest uniform draw the answer is known without one.
    exponent < 40.0 && draws.uniform() < (-exponent).exp()
}

/// When a bridge over unit time that crosses `distance` and ends at `towards` crosses first.
///
/// With u = t/(1 − t) the bridge becomes a Brownian motion with drift, so u is inverse
/// Gaussian of mean distance/|towards − distance| and shape (distance/sd)². It is drawn as
/// Michael, Schucany and Haas (Am. Stat. 30, 1976) do, with the roots written without
/// cancellation and as reciprocals, so that sd = 0 and towards = distance need no case.
#[inline]
pub(crate) fn crossing_share(distance: f64, towards: f64, sd: f64, draws: &mut CounterRng) -> f64 {
    let delta = (towards - distance).abs() / distance;
    let scaled = sd * draws.normal() / distance;
    let r = 0.5 * scaled * scaled;
    // 1/u for the smaller root u.
    let w = delta + r + (r * (r + 2.0 * delta)).sqrt();
    if draws.uniform() * (w + delta) <= w { 1.0 / (1.0 + w) } else { w / (delta * delta + w) }
}
