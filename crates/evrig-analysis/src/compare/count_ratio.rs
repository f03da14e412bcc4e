//! **count_ratio** = N_sim / N_real, over window and region.
//!
//! Source: the measures the authors of Raw2Event report; healthy is 0.5 to 2. Error: time blocks.
//! Independent of location, time and polarity of the events.

use super::ProfilePair;
use super::measure::{Cluster, Measure, MeasureDefinition, MeasureId, RAW2EVENT_MEASURES};

const DEFINITION: MeasureDefinition = MeasureDefinition {
    id: MeasureId::CountRatio,
    name: "Event count ratio",
    formula: "N_sim / N_real",
    source: RAW2EVENT_MEASURES,
    unit: "1",
    clusters: Cluster::TimeBlock,
    healthy: Some([0.5, 2.0]),
};

pub(super) fn measure(pair: &ProfilePair<'_>) -> Measure {
    let (real, simulated) = (pair.real, pair.simulated);
    let of_each = |measure: Measure| measure.of_each(real.n as f64, simulated.n as f64);
    if real.n == 0 {
        return of_each(DEFINITION.unknown("there are no real events"));
    }
    let (above, below) = (simulated.by_block().0, real.by_block().0);
    of_each(DEFINITION.with(pair.bootstrap.ratio(&above, &below, real.n + simulated.n)))
}
