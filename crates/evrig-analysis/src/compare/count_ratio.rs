//! **count_ratio** = N_sim / N_real, over window and region.
//!
//! Whether the generator makes events in the right number. Source: the measures the authors of
//! Raw2Event report; healthy is 0.5 to 2. Error: time blocks.
//!
//! It cannot see where, when or with which polarity events come: twice the events on one half of
//! the picture and none on the other is a ratio of one.

use super::Pair;
use super::measure::{AUTHORS, Cluster, Definition, Measure, MeasureId};

const DEFINITION: Definition = Definition {
    id: MeasureId::CountRatio,
    name: "Event count ratio",
    formula: "N_sim / N_real",
    source: AUTHORS,
    unit: "1",
    clusters: Cluster::TimeBlock,
    healthy: Some([0.5, 2.0]),
};

pub(super) fn measure(pair: &Pair<'_>) -> Measure {
    let (real, simulated) = (pair.real, pair.simulated);
    let of_each = |measure: Measure| measure.of_each(real.n as f64, simulated.n as f64);
    if real.n == 0 {
        return of_each(DEFINITION.unknown("there are no real events"));
    }
    let (above, below) = (simulated.by_block().0, real.by_block().0);
    of_each(DEFINITION.with(pair.bootstrap.ratio(&above, &below, real.n + simulated.n)))
}
