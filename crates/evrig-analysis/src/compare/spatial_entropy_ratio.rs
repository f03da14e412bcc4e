//! **spatial_entropy_ratio** = H_sim / H_real, H = -sum q ln q over the pixels' shares q of
//! the events.
//!
//! exp(H) is the effective number of pixels. Source: the measures the authors of Raw2Event report;
//! healthy is 0.8 to 1.2. Error: tiles; with C the events and S the sum of c ln c over
//! pixels, H = ln C - S / C, and C and S are sums over tiles.
//!
//! Invariant under permutations of the pixels. Biased low for few events per pixel (by about active
//! pixels / 2N), equally in both streams only for equal numbers of events.

use super::ProfilePair;
use super::measure::{Cluster, Measure, MeasureDefinition, MeasureId, RAW2EVENT_MEASURES};
use super::profile::{ClusterLayout, StreamProfile};
use evrig_core::stats::dot;

const DEFINITION: MeasureDefinition = MeasureDefinition {
    id: MeasureId::SpatialEntropyRatio,
    name: "Spatial entropy ratio",
    formula: "H_sim / H_real, H = -sum q ln q, q = events of the pixel / events",
    source: RAW2EVENT_MEASURES,
    unit: "1",
    clusters: Cluster::Tile,
    healthy: Some([0.8, 1.2]),
};

/// EntropySums of c and of c ln c over the pixels of each tile.
struct EntropySums {
    count: Vec<f64>,
    count_log_count: Vec<f64>,
}

impl EntropySums {
    fn of(profile: &StreamProfile, layout: &ClusterLayout) -> Self {
        let count_log_count = |count: u64| match count {
            0 => 0.0,
            count => count as f64 * (count as f64).ln(),
        };
        Self {
            count: profile.sum_by_tile(layout, |count| count as f64),
            count_log_count: profile.sum_by_tile(layout, count_log_count),
        }
    }

    fn entropy(&self, weights: &[f64]) -> f64 {
        let count = dot(weights, &self.count);
        count.ln() - dot(weights, &self.count_log_count) / count
    }
}

pub(super) fn measure(pair: &ProfilePair<'_>) -> Measure {
    let real = EntropySums::of(pair.real, pair.layout);
    let simulated = EntropySums::of(pair.simulated, pair.layout);
    let alike = vec![1.0; pair.layout.n_tiles()];
    let (real_entropy, simulated_entropy) = (real.entropy(&alike), simulated.entropy(&alike));
    let of_each = |measure: Measure| measure.of_each(real_entropy, simulated_entropy);
    if pair.real.n == 0 {
        return of_each(DEFINITION.unknown("there are no real events"));
    }
    if pair.simulated.n == 0 {
        return of_each(DEFINITION.unknown("there are no simulated events"));
    }
    if real_entropy <= 0.0 {
        return of_each(DEFINITION.unknown("all real events are at one pixel: no entropy"));
    }
    let n = pair.real.n + pair.simulated.n;
    let ratio = |w: &[f64]| simulated.entropy(w) / real.entropy(w);
    of_each(DEFINITION.with(pair.bootstrap.estimate(alike.len(), n, ratio)))
}
