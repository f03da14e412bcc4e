//! Gain of one model over another, cell by cell.

use crate::diagnose::Evidence;
use crate::diagnose::fit::optimizer::ModelEvaluation;
use crate::diagnose::levels::{NEGLIGIBLE_NATS_PER_EVENT, SIGNIFICANT_STANDARD_ERRORS};

/// Gain of a model over one that it extends.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct PairedGain {
    /// On held-out cells, nats per event.
    pub(crate) mean: f64,
    /// Its standard error over cells.
    pub(crate) error: f64,
    /// The mean over all cells in its standard errors, or Wilcoxon's signed ranks of the cells in
    /// their standard deviations: the larger. Training cells count as well (Vuong, Econometrica 57,
    /// 1989): a constant that is free without cause gains half the square of its score `z` on them,
    /// with an error of `z`, so that it stands at `z / 2` and not above a level for `z`.
    pub(crate) standard_errors: f64,
}

/// Gain of a model on a cell.
#[derive(Debug, Clone, Copy)]
struct CellGain {
    nats: f64,
    n_events: f64,
    held_out: bool,
}

impl PairedGain {
    /// Of `a` over `b`.
    pub(crate) fn of(evidence: &Evidence, a: &ModelEvaluation, b: &ModelEvaluation) -> Self {
        let n_blocks = evidence.blocks.n();
        let (a, b) = (a.cells(evidence), b.cells(evidence));
        let cells = (0..a.len()).filter(|i| a[*i][1] + b[*i][1] > 0.0).map(|i| CellGain {
            nats: a[i][0] - b[i][0],
            n_events: a[i][1],
            held_out: evidence.is_held_out(i / n_blocks, i % n_blocks),
        });
        Self::from_cells(&cells.collect::<Vec<_>>())
    }

    fn from_cells(cells: &[CellGain]) -> Self {
        let held: Vec<CellGain> = cells.iter().copied().filter(|cell| cell.held_out).collect();
        let [mean, error] = mean_and_error(&held);
        let [of_all, error_of_all] = mean_and_error(cells);
        // A model that is far off in a few cells spreads the gains so widely that the mean has no
        // significance, however many of the cells it loses.
        let rank = signed_rank(cells.iter().map(|cell| cell.nats));
        Self { mean, error, standard_errors: (of_all / error_of_all).max(rank) }
    }

    /// Whether it is not by chance.
    pub(crate) fn is_sure(self) -> bool {
        self.mean > 0.0 && self.standard_errors > SIGNIFICANT_STANDARD_ERRORS
    }

    /// Whether it is large enough for a name, and not by chance.
    pub(crate) fn is_significant(self) -> bool {
        self.mean > NEGLIGIBLE_NATS_PER_EVENT && self.is_sure()
    }
}

/// Mean gain in nats per event, and its standard error over cells.
fn mean_and_error(cells: &[CellGain]) -> [f64; 2] {
    let n_events = cells.iter().map(|cell| cell.n_events).sum::<f64>().max(1.0);
    let mean = cells.iter().map(|cell| cell.nats).sum::<f64>() / n_events;
    let k = cells.len() as f64;
    let square: f64 = cells.iter().map(|cell| (cell.nats - mean * cell.n_events).powi(2)).sum();
    [mean, (square * k / (k - 1.0).max(1.0)).sqrt() / n_events]
}

/// Wilcoxon's signed-rank statistic, less its mean without a difference, over its standard
/// deviation (Wilcoxon, Biometrics Bulletin 1, 1945); zeros are left out.
fn signed_rank(differences: impl Iterator<Item = f64>) -> f64 {
    let mut differences: Vec<f64> = differences.filter(|d| *d != 0.0).collect();
    differences.sort_by(|a, b| a.abs().total_cmp(&b.abs()));
    let ranked = differences.iter().zip(1_u32..);
    let sum: f64 = ranked.map(|(d, rank)| d.signum() * f64::from(rank)).sum();
    let n = differences.len() as f64;
    sum / (n * (n + 1.0) * (2.0 * n + 1.0) / 6.0).sqrt().max(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn held_out(gains: impl IntoIterator<Item = f64>) -> Vec<CellGain> {
        let cell = |nats| CellGain { nats, n_events: 20.0, held_out: true };
        gains.into_iter().map(cell).collect()
    }

    #[test]
    fn ranks_find_what_a_few_cells_hide_from_the_mean() {
        let mut cells = held_out((1..=60).map(|i| f64::from(i) / 30.0));
        cells.extend(held_out([-58.0]));
        let gain = PairedGain::from_cells(&cells);
        assert!(gain.mean < 2.0 * gain.error && gain.standard_errors > 6.0);
        assert!(!gain.is_significant());
        cells[60].nats = -20.0;
        assert!(PairedGain::from_cells(&cells).is_significant());
        let even = PairedGain::from_cells(&held_out([1.0, -1.0, 0.0]));
        assert_eq!((even.mean, even.is_sure()), (0.0, false));
    }

    #[test]
    fn training_cells_count_for_what_the_held_out_cells_show_as_well() {
        let mut random = evrig_core::stats::SplitMix::new(3, 1);
        let mut cells = held_out((0..200).map(|_| 1.0 + 4.0 * random.normal()));
        cells.iter_mut().skip(20).for_each(|cell| cell.held_out = false);
        let gain = PairedGain::from_cells(&cells);
        let held = PairedGain::from_cells(&cells[..20]);
        assert!(!held.is_sure() && gain.is_sure() && gain.mean == held.mean);
        cells.iter_mut().take(20).for_each(|cell| cell.nats = -0.1);
        assert!(!PairedGain::from_cells(&cells).is_sure());
    }

    #[test]
    fn a_constant_that_is_free_without_cause_stands_at_half_its_score() {
        let mut random = evrig_core::stats::SplitMix::new(5, 1);
        let mut largest: f64 = 0.0;
        for _ in 0..2_000 {
            let scores: Vec<f64> = (0..60).map(|_| random.normal()).collect();
            let constant = scores.iter().sum::<f64>() / 60.0;
            let gains = scores.iter().map(|s| s * constant - 0.5 * constant * constant);
            largest = largest.max(PairedGain::from_cells(&held_out(gains)).standard_errors);
        }
        assert!(largest < 2.5, "{largest}");
    }

    #[test]
    fn without_a_difference_ranks_have_unit_variance() {
        let mut random = evrig_core::stats::SplitMix::new(7, 1);
        let trials: Vec<f64> =
            (0..4_000).map(|_| signed_rank((0..40).map(|_| random.normal().powi(3)))).collect();
        let square = trials.iter().map(|z| z * z).sum::<f64>() / 4_000.0;
        assert!((square - 1.0).abs() < 0.1, "{square}");
    }
}
