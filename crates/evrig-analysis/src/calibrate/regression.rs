//! The paper's three weighted regressions, and the two that follow from them.
//!
//! 1. Within each mean brightness: mu = a k_dL + b, with k_dL the change of brightness per µs.
//! 2. Over all: 1/a = L/k1 + k2/k1.
//! 3. Over all: mu = k1' c + k5 L + k4, with c = k_dL / (L + k2). k1' should agree with k1.
//! 4. The paper states no regression for the noise; the stated sigma is linear in k3 and k6 once
//!    k2 is known: sigma = k3 sqrt(L)/(L + k2) + k6.
//!
//! Weights are numbers of samples, as in the paper. Errors: bootstrap over tiles of pixels.
//!
//! # Biases
//! - An interval over several frames is assigned to the brightness of its last one, while
//!   1/interval averages the drift over all: drifts of slow pixels are blurred towards neighbouring
//!   bins.
//! - Brightness and its rate of change vary within a bin. Fast pixels give more samples, so the
//!   mean interval belongs to a faster change than the bin's middle, and the spread of intervals
//!   between pixels counts as diffusion: k3 and k6 are far too large.
//! - Bins around zero change hold intervals of both signs, of which the majority's is taken.
//! - Intervals that do not end within the recording or within a second are missing: slow drifts
//!   appear fast, which raises k4 and k5.
//! - 1/a in the second regression is the inverse of a noisy estimate and so too large.
//!
//! [`super::passage_fit`] has none of these.

use super::bins::{BinFit, Bins};
use super::estimate::Constant;
use super::least_squares::weighted;
use super::{BrightnessSeries, CalibrateError};
use crate::calibrate::passage::Passage;
use evrig_core::stats::{Moments, SplitMix};
use serde::{Deserialize, Serialize};

/// Bootstrap replicates.
const N_RESAMPLINGS: u64 = 200;
/// Minimum number of bins for a line of the first regression.
const MIN_POINTS: usize = 3;
/// Number of histograms.
const N_SHOWN: usize = 4;

/// The paper's regressions with what its figures show.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Regressions {
    /// k1 to k6.
    pub k: [Constant; 6],
    /// k1' of the third regression.
    pub k1_prime: Constant,
    /// k1' / k1; 1 when the regressions agree.
    pub agreement: Constant,
    /// The bins.
    pub points: Vec<BinFit>,
    /// The lines of the first regression.
    pub lines: Vec<RegressionLine>,
    /// Histograms of the intervals in some bins.
    pub histograms: Vec<Histogram>,
}

/// A line of the first regression.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct RegressionLine {
    /// Mean brightness, DN.
    pub mean_dn: f64,
    /// a: thresholds per DN.
    pub slope: f64,
    /// b: thresholds per µs.
    pub intercept_per_us: f64,
    /// Samples behind it.
    pub n: f64,
}

/// Intervals of one bin.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Histogram {
    /// Number of the bin in [`Regressions::points`].
    pub point: usize,
    /// Edges, µs, evenly spaced in the logarithm.
    pub edges_us: Vec<f64>,
    /// Probability per decade.
    pub per_decade: Vec<f64>,
}

/// k1 to k6 and k1'.
type Solution = [f64; 7];

/// Runs the paper's procedure on passages.
pub(super) fn regress(
    brightness: &BrightnessSeries,
    passages: &[Passage],
    seed: u64,
) -> Result<Regressions, CalibrateError> {
    let bins = Bins::new(brightness, passages);
    let points = bins.fit(&vec![1.0; bins.n_tiles()]);
    let lines = lines(&points);
    let n = bins.n_samples();
    let too_few = || CalibrateError::TooFewBins {
        n_passages: passages.len(),
        n_bins: points.len(),
        n_lines: lines.len(),
    };
    let solution = solve(&points, &lines).ok_or_else(too_few)?;
    let errors = errors(&bins, seed);
    let freedom = bins.n_tiles().saturating_sub(1) as f64;
    let constant = |i: usize| Constant::new(solution[i], errors[i], freedom, n);
    Ok(Regressions {
        k: std::array::from_fn(constant),
        k1_prime: constant(6),
        agreement: Constant::new(solution[6] / solution[0], errors[7], freedom, n),
        histograms: bins.fullest(N_SHOWN).into_iter().map(|(i, t)| histogram(i, &t)).collect(),
        points,
        lines,
    })
}

/// Bootstrap standard deviations of the solution and of k1'/k1.
fn errors(bins: &Bins, seed: u64) -> [f64; 8] {
    let n = bins.n_tiles();
    let mut moments = [Moments::default(); 8];
    for number in 0..N_RESAMPLINGS {
        let mut weights = vec![0.0; n];
        let mut random = SplitMix::new(seed, number);
        (0..n).for_each(|_| weights[random.below(n)] += 1.0);
        let points = bins.fit(&weights);
        if let Some(solution) = solve(&points, &lines(&points)) {
            solution.iter().zip(&mut moments).for_each(|(value, moment)| moment.push(*value));
            moments[7].push(solution[6] / solution[0]);
        }
    }
    moments.map(|moment| moment.standard_deviation())
}

/// First regression: a line for each mean brightness.
fn lines(points: &[BinFit]) -> Vec<RegressionLine> {
    let of_one_mean = points.chunk_by(|a, b| a.mean_dn == b.mean_dn);
    let line = |group: &[BinFit]| {
        let rows = group.iter().map(|p| ([p.change_dn_per_us, 1.0], p.drift_per_us, p.n));
        let [slope, intercept_per_us] = weighted(rows).filter(|_| group.len() >= MIN_POINTS)?;
        let n = group.iter().map(|p| p.n).sum();
        (slope > 0.0).then_some(RegressionLine {
            mean_dn: group[0].mean_dn,
            slope,
            intercept_per_us,
            n,
        })
    };
    of_one_mean.filter_map(line).collect()
}

/// Second, third and fourth regression.
fn solve(points: &[BinFit], lines: &[RegressionLine]) -> Option<Solution> {
    let [slope, intercept] =
        weighted(lines.iter().map(|line| ([line.mean_dn, 1.0], 1.0 / line.slope, line.n)))?;
    let (k1, k2) = (1.0 / slope, intercept / slope);
    // The gain must be finite within the range.
    let lowest = points.iter().map(|p| p.mean_dn).fold(f64::INFINITY, f64::min);
    let k2 = k2.max(-0.5 * lowest);
    let [k1_prime, k5, k4] = weighted(points.iter().map(|p| {
        let c = p.change_dn_per_us / (p.mean_dn + k2);
        ([c, p.mean_dn, 1.0], p.drift_per_us, p.n)
    }))?;
    let [k3, k6] = weighted(
        points
            .iter()
            .map(|p| ([p.mean_dn.sqrt() / (p.mean_dn + k2), 1.0], p.sigma_per_sqrt_us, p.n)),
    )?;
    Some([k1, k2, k3, k4, k5, k6, k1_prime])
}

fn histogram(point: usize, intervals_us: &[f64]) -> Histogram {
    const PER_DECADE: f64 = 10.0;
    let log = |t: f64| t.max(1.0).log10() * PER_DECADE;
    let low = intervals_us.iter().map(|t| log(*t)).fold(f64::INFINITY, f64::min).floor();
    let high = intervals_us.iter().map(|t| log(*t)).fold(0.0, f64::max).floor();
    let n_bins = (high - low).clamp(0.0, 1e3) as usize + 1;
    let mut counts = vec![0.0; n_bins];
    for t in intervals_us {
        counts[((log(*t) - low) as usize).min(n_bins - 1)] += 1.0;
    }
    let edge = |i: usize| 10_f64.powf((low + i as f64) / PER_DECADE);
    let n = intervals_us.len().max(1) as f64;
    Histogram {
        point,
        edges_us: (0..=n_bins).map(edge).collect(),
        per_decade: counts.iter().map(|count| count / n * PER_DECADE).collect(),
    }
}
