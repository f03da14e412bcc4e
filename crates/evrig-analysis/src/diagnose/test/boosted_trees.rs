//! Classifier for two samples: boosted trees of depth two over binned features.
//!
//! Two samples have the same distribution if and only if no classifier is better than chance
//! (Lopez-Paz and Oquab, ICLR 2017). Trees are grown by Newton steps on the logistic loss
//! (Friedman, Ann. Stat. 29, 2001). The held-out log-loss gain over chance is a lower bound on the
//! Jensen-Shannon divergence, in nats per example.

/// Bins per feature; one more holds unknown values.
const N_BINS: usize = 32;

/// Quantiles between bins, finer towards both ends.
const BIN_QUANTILES: [f64; N_BINS - 1] = [
    0.001, 0.002, 0.005, 0.01, 0.02, 0.035, 0.055, 0.08, 0.11, 0.15, 0.19, 0.235, 0.285, 0.335,
    0.385, 0.5, 0.615, 0.665, 0.715, 0.765, 0.81, 0.85, 0.89, 0.92, 0.945, 0.965, 0.98, 0.99,
    0.995, 0.998, 0.999,
];

const N_TREES: usize = 70;

const LEARNING_RATE: f64 = 0.15;

/// L2 penalty of a leaf, added to its curvature.
const LEAF_REGULARIZATION: f64 = 6.0;

const MIN_EXAMPLES_PER_LEAF: f64 = 25.0;

/// Examples with features, labels and cross-validation folds.
#[derive(Debug, Clone, Default)]
pub(crate) struct LabelledEvents {
    pub(crate) n_features: usize,
    /// Row-major, `n_features` per example; NaN where unknown.
    pub(crate) features: Vec<f32>,
    pub(crate) is_real: Vec<bool>,
    pub(crate) fold: Vec<u8>,
    /// Cluster of the example: its cell of pixels and time.
    pub(crate) cell: Vec<u32>,
}

/// Cross-validated result.
#[derive(Debug, Clone)]
pub(crate) struct ClassifierResult {
    /// Log-loss gain over chance, nats per example, classes balanced.
    pub(crate) nats: f64,
    /// Its standard error, from the scatter over cells.
    pub(crate) error: f64,
    /// Balanced accuracy.
    pub(crate) accuracy: f64,
    /// Per cell: gain and total weight.
    pub(crate) cells: Vec<(f64, f64)>,
    /// Share of each feature in the training gain.
    pub(crate) share: Vec<f64>,
}

/// Cross-validation folds.
pub(crate) const N_FOLDS: u8 = 3;

#[derive(Debug, Clone, Copy, Default)]
struct GradientSum {
    gradient: f64,
    curvature: f64,
    n: f64,
}

impl GradientSum {
    fn add(&mut self, gradient: f64, curvature: f64) {
        self.gradient += gradient;
        self.curvature += curvature;
        self.n += 1.0;
    }
    fn less(self, other: Self) -> Self {
        Self {
            gradient: self.gradient - other.gradient,
            curvature: self.curvature - other.curvature,
            n: self.n - other.n,
        }
    }
    fn split_score(self) -> f64 {
        self.gradient * self.gradient / (self.curvature + LEAF_REGULARIZATION)
    }
    fn step(self) -> f64 {
        LEARNING_RATE * self.gradient / (self.curvature + LEAF_REGULARIZATION)
    }
}

/// A feature and the last bin of the left side.
type TreeSplit = (usize, u8);

struct BoostedTree {
    root: TreeSplit,
    /// The split of each side, if any, with the steps of its leaves.
    sides: [(Option<TreeSplit>, [f64; 2]); 2],
}

impl BoostedTree {
    fn step(&self, bins: &[u8]) -> f64 {
        let side = usize::from(bins[self.root.0] > self.root.1);
        let (split, steps) = &self.sides[side];
        match split {
            Some((feature, bin)) => steps[usize::from(bins[*feature] > *bin)],
            None => steps[0],
        }
    }
}

/// Bin edges of a feature's known values.
fn edges(values: impl Iterator<Item = f32>) -> Vec<f32> {
    let mut all: Vec<f32> = values.filter(|v| v.is_finite()).collect();
    all.sort_by(f32::total_cmp);
    let mut edges: Vec<f32> = BIN_QUANTILES
        .iter()
        .filter_map(|cut| all.get((cut * all.len() as f64) as usize).copied())
        .collect();
    edges.dedup();
    edges
}

fn binned(examples: &LabelledEvents) -> Vec<u8> {
    let f = examples.n_features;
    let mut bins = vec![0; examples.features.len()];
    for feature in 0..f {
        let column = || examples.features.iter().skip(feature).step_by(f).copied();
        let edges = edges(column());
        for (bin, value) in bins.iter_mut().skip(feature).step_by(f).zip(column()) {
            *bin = if value.is_finite() {
                edges.partition_point(|edge| *edge <= value) as u8
            } else {
                N_BINS as u8
            };
        }
    }
    bins
}

/// The best split of the examples that `of` sends to each side.
fn splits(
    bins: &[u8],
    f: usize,
    slopes: &[(f64, f64)],
    chosen: &[usize],
    of: impl Fn(&[u8]) -> usize,
) -> [(GradientSum, Option<(TreeSplit, f64)>); 2] {
    let mut sums = vec![GradientSum::default(); 2 * f * (N_BINS + 1)];
    let mut all = [GradientSum::default(); 2];
    for &i in chosen {
        let own = &bins[i * f..(i + 1) * f];
        let side = of(own);
        let (g, h) = slopes[i];
        all[side].add(g, h);
        for (feature, bin) in own.iter().enumerate() {
            sums[(side * f + feature) * (N_BINS + 1) + usize::from(*bin)].add(g, h);
        }
    }
    std::array::from_fn(|side| {
        let mut best: Option<(TreeSplit, f64)> = None;
        for feature in 0..f {
            let mut left = GradientSum::default();
            for bin in 0..N_BINS {
                let here = sums[(side * f + feature) * (N_BINS + 1) + bin];
                left.gradient += here.gradient;
                left.curvature += here.curvature;
                left.n += here.n;
                let right = all[side].less(left);
                if left.n < MIN_EXAMPLES_PER_LEAF || right.n < MIN_EXAMPLES_PER_LEAF {
                    continue;
                }
                let gain = left.split_score() + right.split_score() - all[side].split_score();
                if gain > best.map_or(0.0, |b| b.1) {
                    best = Some(((feature, bin as u8), gain));
                }
            }
        }
        (all[side], best)
    })
}

/// One tree on the chosen examples.
fn grow(
    bins: &[u8],
    f: usize,
    slopes: &[(f64, f64)],
    chosen: &[usize],
    share: &mut [f64],
) -> Option<BoostedTree> {
    let [(_, root), _] = splits(bins, f, slopes, chosen, |_| 0);
    let (root, gain) = root?;
    share[root.0] += gain;
    let side_of = |own: &[u8]| usize::from(own[root.0] > root.1);
    let below = splits(bins, f, slopes, chosen, side_of);
    let mut split_half = [[GradientSum::default(); 2]; 2];
    for &i in chosen {
        let own = &bins[i * f..(i + 1) * f];
        let side = side_of(own);
        if let Some(((feature, bin), _)) = below[side].1 {
            let (g, h) = slopes[i];
            split_half[side][usize::from(own[feature] > bin)].add(g, h);
        }
    }
    let sides = std::array::from_fn(|side| match below[side].1 {
        Some((split, gain)) => {
            share[split.0] += gain;
            (Some(split), split_half[side].map(GradientSum::step))
        }
        None => (None, [below[side].0.step(); 2]),
    });
    Some(BoostedTree { root, sides })
}

impl ClassifierResult {
    /// Gain over `other` on the same examples, and its standard error.
    pub(crate) fn more_than(&self, other: &Self) -> (f64, f64) {
        let n = self.cells.iter().map(|c| c.1).sum::<f64>().max(1e-300);
        let more = self.nats - other.nats;
        let each = self.cells.iter().zip(&other.cells);
        let square: f64 = each.map(|(a, b)| (a.0 - b.0 - more * a.1).powi(2)).sum();
        (more, square.sqrt() / n)
    }
}

/// Cross-validated classification of recorded against simulated examples; `None` with too few.
pub(crate) fn classify(examples: &LabelledEvents) -> Option<ClassifierResult> {
    classify_with(examples, |_| true)
}

/// The same with some of the features.
pub(crate) fn classify_with(
    examples: &LabelledEvents,
    uses: impl Fn(usize) -> bool,
) -> Option<ClassifierResult> {
    let n = examples.is_real.len();
    let n_real = examples.is_real.iter().filter(|real| **real).count();
    if n_real < 100 || n - n_real < 100 {
        return None;
    }
    let f = examples.n_features;
    let mut bins = binned(examples);
    for feature in (0..f).filter(|feature| !uses(*feature)) {
        // A constant feature cannot be split.
        bins.iter_mut().skip(feature).step_by(f).for_each(|bin| *bin = 0);
    }
    let weight = |real: bool| 0.5 * n as f64 / (if real { n_real } else { n - n_real }) as f64;
    let mut margins = vec![0.0; n];
    let mut share = vec![0.0; f];
    for fold in 0..N_FOLDS {
        let chosen: Vec<usize> = (0..n).filter(|&i| examples.fold[i] != fold).collect();
        if chosen.len() == n {
            continue;
        }
        // Held-out examples pass through the trees as well.
        let mut here = vec![0.0; n];
        let mut slopes = vec![(0.0, 0.0); n];
        for _ in 0..N_TREES {
            for &i in &chosen {
                let p = 1.0 / (1.0 + f64::exp(-here[i]));
                let w = weight(examples.is_real[i]);
                let y = f64::from(u8::from(examples.is_real[i]));
                slopes[i] = (w * (y - p), w * p * (1.0 - p));
            }
            let Some(tree) = grow(&bins, f, &slopes, &chosen, &mut share) else { break };
            for (i, margin) in here.iter_mut().enumerate() {
                *margin += tree.step(&bins[i * f..(i + 1) * f]);
            }
        }
        for i in (0..n).filter(|&i| examples.fold[i] == fold) {
            margins[i] = here[i];
        }
    }
    let all = share.iter().sum::<f64>().max(1e-300);
    share.iter_mut().for_each(|s| *s /= all);
    Some(summarise(examples, &margins, weight, share))
}

fn summarise(
    examples: &LabelledEvents,
    margins: &[f64],
    weight: impl Fn(bool) -> f64,
    share: Vec<f64>,
) -> ClassifierResult {
    let n = margins.len() as f64;
    let n_cells = examples.cell.iter().max().map_or(0, |c| *c as usize + 1);
    let mut by_cell = vec![(0.0, 0.0); n_cells];
    let mut right = 0.0;
    for (i, &margin) in margins.iter().enumerate() {
        let real = examples.is_real[i];
        let towards = if real { margin } else { -margin };
        // ln 2 plus the log probability of the true class.
        let gained = std::f64::consts::LN_2 - (-towards).exp().ln_1p();
        let w = weight(real);
        by_cell[examples.cell[i] as usize].0 += w * gained;
        by_cell[examples.cell[i] as usize].1 += w;
        right += w * if towards > 0.0 {
            1.0
        } else if towards < 0.0 {
            0.0
        } else {
            0.5
        };
    }
    let nats = by_cell.iter().map(|c| c.0).sum::<f64>() / n;
    let square: f64 = by_cell.iter().map(|c| (c.0 - nats * c.1).powi(2)).sum();
    ClassifierResult { nats, error: square.sqrt() / n, accuracy: right / n, cells: by_cell, share }
}

#[cfg(test)]
mod tests {
    use super::*;
    use evrig_core::stats::SplitMix;

    /// Two features; `shift` of the recorded examples have a positive product.
    fn examples(shift: f64) -> LabelledEvents {
        let mut random = SplitMix::new(5, 9);
        let mut all = LabelledEvents { n_features: 2, ..LabelledEvents::default() };
        for i in 0..6_000_u32 {
            let is_real = i % 2 == 0;
            let (a, b) = (random.uniform() - 0.5, random.uniform() - 0.5);
            let b = if is_real && random.uniform() < shift { b.abs() * a.signum() } else { b };
            all.features.extend([a as f32, b as f32]);
            all.is_real.push(is_real);
            all.fold.push((i / 7 % 3) as u8);
            all.cell.push(i / 60);
        }
        all
    }

    #[test]
    fn equal_samples_are_not_separated() {
        let result = classify(&examples(0.0)).unwrap();
        assert!(result.nats < 3.0 * result.error, "{result:?}");
        assert!((result.accuracy - 0.5).abs() < 0.02, "{result:?}");
    }

    #[test]
    fn a_difference_in_correlation_is_found() {
        let result = classify(&examples(0.6)).unwrap();
        assert!(result.nats > 5.0 * result.error && result.accuracy > 0.6, "{result:?}");
    }
}
