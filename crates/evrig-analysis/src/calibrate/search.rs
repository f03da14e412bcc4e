//! Black-box search over k: CMA-ES (Hansen and Ostermeier 2001) on the training tiles.
//!
//! Coordinates are logarithms, as the constants span decades and none is negative in the
//! published search either. Every evaluation draws with the same seed, so that the objective is
//! a function.

use super::light::Part;
use cmaes::{CMAESOptions, DVector};
use serde::{Deserialize, Serialize};

/// What a search makes small.
pub trait Objective: Sync {
    /// Its name on the command line and in files.
    fn name(&self) -> &'static str;

    /// Which constants it sees; the others stay as they are.
    fn sees(&self) -> [bool; 6];

    /// Start of what it fits beside k: logarithms of positive numbers.
    fn nuisances(&self) -> Vec<f64> {
        Vec::new()
    }

    /// The same objective on a part of the data, to come close to the answer at less cost; none where
    /// it is cheap as it is.
    fn thinned(&self) -> Option<&dyn Objective> {
        None
    }

    /// Its value at `k` and `nuisances` on one part of the tiles; less is better, infinite when
    /// it has none.
    fn value(&self, k: [f64; 6], nuisances: &[f64], part: Part) -> f64;
}

/// What a search found.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Found {
    /// The constants.
    pub k: [f64; 6],
    /// What was fitted beside them.
    pub nuisances: Vec<f64>,
    /// The objective on the training tiles.
    pub train: f64,
    /// Evaluations spent.
    pub n_evaluations: usize,
}

/// Where a constant that starts at or below zero starts instead: without effect in seconds.
const LEAST: [f64; 6] = [1e-2, 1e-3, 1e-8, 1e-10, 1e-12, 1e-8];
/// First step, in natural logarithms.
const STEP: f64 = 0.25;
/// Stands for "no value": the crate takes finite numbers only.
pub(super) const NO_VALUE: f64 = 1e12;

/// Of the evaluations of a search whose objective can be thinned: how many are of the whole.
const WHOLE_SHARE: usize = 4;
/// First step on the whole, close to the answer already.
const FINE_STEP: f64 = 0.06;

/// Searches from `start` with about `n_evaluations` evaluations. Never worse than the start.
///
/// Where the objective can be thinned, that many evaluations are of the thinned one, and a quarter as
/// many on the whole go on from where it led.
#[must_use]
pub fn search(
    objective: &dyn Objective,
    start: [f64; 6],
    n_evaluations: usize,
    seed: u64,
) -> Found {
    let nuisances = objective.nuisances();
    let Some(thinned) = objective.thinned() else {
        return descend(objective, start, &nuisances, STEP, n_evaluations, seed);
    };
    let rough = descend(thinned, start, &nuisances, STEP, n_evaluations, seed);
    let n_whole = n_evaluations / WHOLE_SHARE;
    let fine = descend(objective, rough.k, &rough.nuisances, FINE_STEP, n_whole, seed);
    let n_evaluations = rough.n_evaluations + fine.n_evaluations + 1;
    // The thinned data may have led astray.
    let first = objective.value(start, &nuisances, Part::Train);
    if first < fine.train {
        return Found { k: start, nuisances, train: first, n_evaluations };
    }
    Found { n_evaluations, ..fine }
}

/// One run of CMA-ES.
fn descend(
    objective: &dyn Objective,
    start: [f64; 6],
    nuisances: &[f64],
    step: f64,
    n_evaluations: usize,
    seed: u64,
) -> Found {
    let sees = objective.sees();
    let free: Vec<usize> = (0..6).filter(|&i| sees[i]).collect();
    let base: Vec<f64> = free.iter().map(|&i| start[i].max(LEAST[i])).collect();
    let unpack = |point: &[f64]| {
        let mut k = start;
        for ((&i, base), u) in free.iter().zip(&base).zip(point) {
            k[i] = base * u.clamp(-20.0, 20.0).exp();
        }
        let steps = point.get(free.len()..).unwrap_or_default();
        let extra: Vec<f64> = nuisances.iter().zip(steps).map(|(n, u)| n + u).collect();
        (k, extra)
    };
    let finite = |value: f64| if value.is_finite() { value } else { NO_VALUE };
    let mut spent = 1;
    let first = finite(objective.value(start, nuisances, Part::Train));
    let mut best =
        Found { k: start, nuisances: nuisances.to_vec(), train: first, n_evaluations: 0 };
    let evaluate = |point: &DVector<f64>| {
        let (k, extra) = unpack(point.as_slice());
        spent += 1;
        let value = finite(objective.value(k, &extra, Part::Train));
        if value < best.train {
            best = Found { k, nuisances: extra, train: value, n_evaluations: 0 };
        }
        value
    };
    let origin = vec![0.0; free.len() + nuisances.len()];
    if origin.is_empty() {
        return Found { n_evaluations: spent, ..best };
    }
    let options = CMAESOptions::new(origin, step)
        .max_function_evals(n_evaluations.saturating_sub(1).max(1))
        .seed(seed);
    // Options are wrong only for no coordinates at all; then the start is the answer.
    if let Ok(mut state) = options.build(evaluate) {
        state.run();
    }
    best.n_evaluations = spent;
    best
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Bowl;

    impl Objective for Bowl {
        fn name(&self) -> &'static str {
            "bowl"
        }
        fn sees(&self) -> [bool; 6] {
            [true, true, false, true, false, false]
        }
        fn nuisances(&self) -> Vec<f64> {
            vec![0.0]
        }
        fn value(&self, k: [f64; 6], nuisances: &[f64], _: Part) -> f64 {
            let [u, v, w] = [k[0] / 3.0, k[1] / 7.0, k[3] / 2e-7].map(f64::ln);
            u * u + 3.0 * (v - u) * (v - u) + w * w + (nuisances[0] - 1.0).powi(2)
        }
    }

    #[test]
    fn a_search_finds_the_bottom_and_leaves_alone_what_the_objective_does_not_see() {
        let found = search(&Bowl, [5.0, 20.0, 1.0, 1e-7, 4.0, 9.0], 800, 1);
        assert!(found.train < 1e-4, "{found:?}");
        assert!((found.k[0] - 3.0).abs() < 0.05 && (found.k[3] / 2e-7 - 1.0).abs() < 0.05);
        assert_eq!([found.k[2], found.k[4], found.k[5]], [1.0, 4.0, 9.0]);
        assert_eq!(found, search(&Bowl, [5.0, 20.0, 1.0, 1e-7, 4.0, 9.0], 800, 1));
    }
}
