//! **active_pixel_ratio** = a_sim / a_real, a the share of the region's pixels with an event.
//!
//! Source: the measures the authors of Raw2Event report; healthy is 0.8 to 1.2. Error: tiles.
//! Independent of which pixels are active, and uninformative in windows so long that nearly every
//! pixel is active in both streams.

use super::ProfilePair;
use super::measure::{Cluster, Measure, MeasureDefinition, MeasureId, RAW2EVENT_MEASURES};

const DEFINITION: MeasureDefinition = MeasureDefinition {
    id: MeasureId::ActivePixelRatio,
    name: "Active pixel ratio",
    formula: "a_sim / a_real, a = pixels with an event / pixels",
    source: RAW2EVENT_MEASURES,
    unit: "1",
    clusters: Cluster::Tile,
    healthy: Some([0.8, 1.2]),
};

pub(super) fn measure(pair: &ProfilePair<'_>) -> Measure {
    let is_active = |count: u64| f64::from(u8::from(count > 0));
    let real = pair.real.sum_by_tile(pair.layout, is_active);
    let simulated = pair.simulated.sum_by_tile(pair.layout, is_active);
    let n_pixels = pair.layout.n_region_pixels();
    let share = |active: &[f64]| active.iter().sum::<f64>() / n_pixels as f64;
    let of_each = |measure: Measure| measure.of_each(share(&real), share(&simulated));
    if pair.real.n == 0 {
        return of_each(DEFINITION.unknown("there are no real events"));
    }
    of_each(DEFINITION.with(pair.bootstrap.ratio(&simulated, &real, n_pixels)))
}
