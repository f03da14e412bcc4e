//! **active_pixel_ratio** = a_sim / a_real, a the share of the region's pixels with an event.
//!
//! Whether the generator sets off as many pixels. Source: the measures the authors of
//! Raw2Event report; healthy is 0.8 to 1.2. Error: tiles.
//!
//! It cannot see which pixels these are, and says little once the window is so long that nearly
//! every pixel had an event in both streams.

use super::Pair;
use super::measure::{AUTHORS, Cluster, Definition, Measure, MeasureId};

const DEFINITION: Definition = Definition {
    id: MeasureId::ActivePixelRatio,
    name: "Active pixel ratio",
    formula: "a_sim / a_real, a = pixels with an event / pixels",
    source: AUTHORS,
    unit: "1",
    clusters: Cluster::Tile,
    healthy: Some([0.8, 1.2]),
};

pub(super) fn measure(pair: &Pair<'_>) -> Measure {
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
