//! Gain of one model over another on held-out cells.

use crate::diagnose::Evidence;
use crate::diagnose::fit::optimizer::ModelEvaluation;
use crate::diagnose::levels::{NEGLIGIBLE_NATS_PER_EVENT, SIGNIFICANT_STANDARD_ERRORS};

/// Held-out gain with its paired error over cells.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct PairedGain {
    /// Nats per event.
    pub(crate) mean: f64,
    /// Standard error.
    pub(crate) error: f64,
    /// Wilcoxon's signed-rank statistic over its standard deviation. A model that is far off in a
    /// few cells spreads the gains so widely that the mean has no significance, however many of the
    /// cells it loses.
    pub(crate) rank: f64,
}

impl PairedGain {
    /// Of `a` over `b`.
    pub(crate) fn of(evidence: &Evidence, a: &ModelEvaluation, b: &ModelEvaluation) -> Self {
        let n_blocks = evidence.blocks.n();
        let (a, b) = (a.cells(evidence), b.cells(evidence));
        let is_held = |i: &usize| evidence.is_held_out(i / n_blocks, i % n_blocks);
        let held = (0..a.len()).filter(|i| is_held(i) && a[*i][1] + b[*i][1] > 0.0);
        Self::from_cells(&held.map(|i| (a[i][0] - b[i][0], a[i][1])).collect::<Vec<_>>())
    }

    /// From the gain in nats and the number of events of each cell.
    fn from_cells(cells: &[(f64, f64)]) -> Self {
        let n_events: f64 = cells.iter().map(|cell| cell.1).sum();
        let mean = cells.iter().map(|cell| cell.0).sum::<f64>() / n_events.max(1.0);
        let k = cells.len() as f64;
        let square: f64 = cells.iter().map(|(gain, n)| (gain - mean * n).powi(2)).sum();
        let error = (square * k / (k - 1.0).max(1.0)).sqrt() / n_events.max(1.0);
        Self { mean, error, rank: signed_rank(cells.iter().map(|cell| cell.0)) }
    }

    /// Standard errors of the mean, or standard deviations of the ranks: the larger.
    pub(crate) fn standard_errors(self) -> f64 {
        (self.mean / self.error).max(self.rank)
    }

    /// Whether it is not by chance.
    pub(crate) fn is_sure(self) -> bool {
        self.mean > 0.0 && self.standard_errors() > SIGNIFICANT_STANDARD_ERRORS
    }

    /// Whether it is large enough for a name, and not by chance.
    pub(crate) fn is_significant(self) -> bool {
        self.mean > NEGLIGIBLE_NATS_PER_EVENT && self.is_sure()
    }
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

    #[test]
    fn ranks_find_what_a_few_cells_hide_from_the_mean() {
        let mut cells: Vec<(f64, f64)> = (1..=60).map(|i| (f64::from(i) / 30.0, 20.0)).collect();
        cells.push((-58.0, 20.0));
        let gain = PairedGain::from_cells(&cells);
        assert!(gain.mean < 2.0 * gain.error && gain.rank > 6.0 && !gain.is_significant());
        cells[60].0 = -20.0;
        assert!(PairedGain::from_cells(&cells).is_significant());
        let even = PairedGain::from_cells(&[(1.0, 9.0), (-1.0, 9.0), (0.0, 9.0)]);
        assert_eq!((even.mean, even.is_sure()), (0.0, false));
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
