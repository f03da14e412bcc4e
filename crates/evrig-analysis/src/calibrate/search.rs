//! Search over k by CMA-ES (Hansen and Ostermeier 2001) on the training tiles, in logarithms of the
//! constants. Every evaluation uses the same seed, so that the objective is deterministic.

use super::brightness::TileSubset;
use cmaes::{CMAESOptions, DVector};
use serde::{Deserialize, Serialize};

/// What a search minimises.
pub trait Objective: Sync {
    /// Its name on the command line and in files.
    fn name(&self) -> &'static str;

    /// Which constants it depends on; the others keep their values.
    fn depends_on(&self) -> [bool; 6];

    /// Start of the nuisance parameters, natural logarithms.
    fn nuisances(&self) -> Vec<f64> {
        Vec::new()
    }

    /// The objective on a part of the data, for a coarse search at less cost.
    fn thinned(&self) -> Option<&dyn Objective> {
        None
    }

    /// The value at `k` and `nuisances` on a subset of the tiles; less is better, infinite for
    /// none.
    fn value(&self, k: [f64; 6], nuisances: &[f64], part: TileSubset) -> f64;

    /// [`Self::value`] for many nuisance parameters at one `k`, whose share of the work is done
    /// once.
    fn at(&self, k: [f64; 6], part: TileSubset) -> HeldObjective<'_> {
        Box::new(move |nuisances| self.value(k, nuisances, part))
    }
}

/// An objective of the nuisance parameters alone.
pub type HeldObjective<'a> = Box<dyn Fn(&[f64]) -> f64 + Sync + 'a>;

/// Result of a search.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SearchResult {
    /// The constants.
    pub k: [f64; 6],
    /// The nuisance parameters.
    pub nuisances: Vec<f64>,
    /// The objective on the training tiles.
    pub train: f64,
    /// Evaluations spent.
    pub n_evaluations: usize,
}

/// Start of a constant whose start is zero or negative: a negligible value.
const MIN_START: [f64; 6] = [1e-2, 1e-3, 1e-8, 1e-10, 1e-12, 1e-8];
/// Initial step, natural logarithms.
const INITIAL_STEP: f64 = 0.25;
/// Represents "no value": `cmaes` takes finite numbers only.
pub(super) const NO_VALUE: f64 = 1e12;

/// Divisor of the number of evaluations for the search on all data after a thinned one.
const WHOLE_SHARE: usize = 4;
/// Initial step of that search.
const WHOLE_STEP: f64 = 0.06;

/// Searches from `start` with about `n_evaluations` evaluations; the result is not worse than the
/// start. A thinned objective takes that many evaluations, followed by a quarter as many on all
/// data.
#[must_use]
pub fn search(
    objective: &dyn Objective,
    start: [f64; 6],
    n_evaluations: usize,
    seed: u64,
) -> SearchResult {
    let nuisances = objective.nuisances();
    let Some(thinned) = objective.thinned() else {
        return descend(objective, start, &nuisances, INITIAL_STEP, n_evaluations, seed);
    };
    let rough = descend(thinned, start, &nuisances, INITIAL_STEP, n_evaluations, seed);
    let n_whole = n_evaluations / WHOLE_SHARE;
    let fine = descend(objective, rough.k, &rough.nuisances, WHOLE_STEP, n_whole, seed);
    let n_evaluations = rough.n_evaluations + fine.n_evaluations + 1;
    let first = objective.value(start, &nuisances, TileSubset::Train);
    if first < fine.train {
        return SearchResult { k: start, nuisances, train: first, n_evaluations };
    }
    SearchResult { n_evaluations, ..fine }
}

/// One run of CMA-ES.
fn descend(
    objective: &dyn Objective,
    start: [f64; 6],
    nuisances: &[f64],
    step: f64,
    n_evaluations: usize,
    seed: u64,
) -> SearchResult {
    let depends_on = objective.depends_on();
    let free: Vec<usize> = (0..6).filter(|&i| depends_on[i]).collect();
    let base: Vec<f64> = free.iter().map(|&i| start[i].max(MIN_START[i])).collect();
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
    let held = free.is_empty().then(|| objective.at(start, TileSubset::Train));
    let train = |k, nuisances: &[f64]| match &held {
        Some(held) => finite(held(nuisances)),
        None => finite(objective.value(k, nuisances, TileSubset::Train)),
    };
    let mut spent = 1;
    let first = train(start, nuisances);
    let mut best =
        SearchResult { k: start, nuisances: nuisances.to_vec(), train: first, n_evaluations: 0 };
    let evaluate = |point: &DVector<f64>| {
        let (k, extra) = unpack(point.as_slice());
        spent += 1;
        let value = train(k, &extra);
        if value < best.train {
            best = SearchResult { k, nuisances: extra, train: value, n_evaluations: 0 };
        }
        value
    };
    let origin = vec![0.0; free.len() + nuisances.len()];
    if origin.is_empty() {
        return SearchResult { n_evaluations: spent, ..best };
    }
    let options = CMAESOptions::new(origin, step)
        .max_function_evals(n_evaluations.saturating_sub(1).max(1))
        .seed(seed);
    // Building fails only without coordinates.
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
        fn depends_on(&self) -> [bool; 6] {
            [true, true, false, true, false, false]
        }
        fn nuisances(&self) -> Vec<f64> {
            vec![0.0]
        }
        fn value(&self, k: [f64; 6], nuisances: &[f64], _: TileSubset) -> f64 {
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
