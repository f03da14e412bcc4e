//! Maps of the misfit: over the sensor, over time and rows, and over the interval and the contrast
//! rate.

use crate::diagnose::test::event_strata::quantiles_of;
use crate::diagnose::{Evidence, PixelEvidence};
use crate::predict::Residual;
use serde::{Deserialize, Serialize};

const MAX_CELLS_PER_SIDE: usize = 10;

const N_ROW_BANDS: usize = 6;

const N_QUANTILE_CELLS: usize = 6;

/// Expected plus recorded events that a cell needs.
const MIN_CELL_EVENTS: f64 = 12.0;

/// The quantity of a map.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum HeatValue {
    /// Recorded minus expected events over the root of the expected number; beyond 3 of either
    /// sign it is significant.
    Surplus,
    /// Mean change of the signal beyond the threshold, in thresholds: positive for late events.
    Innovation,
}

/// A map of the baseline and of the final model.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct HeatMap {
    /// Horizontal and vertical covariate, as in `mismatch.where`.
    pub axes: [String; 2],
    /// Ascending cell edges of both axes, one more than cells.
    pub edges: [Vec<f64>; 2],
    /// The quantity.
    pub value: HeatValue,
    /// Values in row-major order from the lowest row: baseline, then final model; `null` in cells
    /// with too few events.
    pub values: [Vec<Option<f64>>; 2],
    /// Number of events per cell.
    pub n_events: Vec<u64>,
}

/// Residuals of each pixel's events, and its recorded and expected events per time block.
pub(crate) type ModelResiduals = Vec<(Vec<Residual>, Vec<[f64; 2]>)>;

/// Maps of the residuals of baseline and final model.
pub(crate) fn heat_maps(evidence: &Evidence, residuals: &[ModelResiduals; 2]) -> Vec<HeatMap> {
    let [width, height] = evidence.middle.map(|middle| 2.0 * middle);
    let cell = width.max(height) / MAX_CELLS_PER_SIDE as f64;
    let sensor = [even(width, (width / cell).ceil()), even(height, (height / cell).ceil())];
    let blocks = evidence.blocks;
    let seconds = blocks.length_us() as f64 * 1e-6;
    let rows = [even(seconds, blocks.n() as f64), even(height, N_ROW_BANDS as f64)];
    let half_s = 0.5 * seconds / blocks.n() as f64;
    let all: Vec<&Residual> = residuals[0].iter().flat_map(|(events, _)| events).collect();
    let interval = |r: &Residual| r.previous.map_or(f64::NAN, |p| p.ago_s * 1e6);
    let rate = |r: &Residual| r.slope_per_s;
    let parts = |of: &dyn Fn(&Residual) -> f64| spanning(all.iter().map(|r| of(r)).collect());
    let past = [parts(&interval), parts(&rate)];
    let surplus = |axes, edges, at: &dyn Fn(&PixelEvidence, usize) -> [f64; 2]| {
        map(axes, edges, HeatValue::Surplus, residuals, &|residuals, add| {
            for (pixel, (_, counts)) in evidence.pixels.iter().zip(residuals) {
                for (block, pair) in counts.iter().enumerate() {
                    add(at(pixel, block), *pair);
                }
            }
        })
    };
    let innovation = |axes, edges, at: &dyn Fn(&Residual) -> [f64; 2]| {
        map(axes, edges, HeatValue::Innovation, residuals, &|residuals, add| {
            for event in residuals.iter().flat_map(|(events, _)| events) {
                event.innovation.into_iter().for_each(|late| add(at(event), [1.0, late]));
            }
        })
    };
    let place = |pixel: &PixelEvidence| [f64::from(pixel.x), f64::from(pixel.y)];
    let middle_s = |block| blocks.end_us(block) * 1e-6 - half_s;
    [
        surplus(["column", "row"], sensor, &|pixel, _| place(pixel)),
        surplus(["time_s", "row"], rows, &|pixel, block| [middle_s(block), place(pixel)[1]]),
        innovation(["interval_us", "contrast_rate_per_s"], past, &|r| [interval(r), rate(r)]),
    ]
    .into_iter()
    .flatten()
    .collect()
}

fn even(length: f64, n: f64) -> Vec<f64> {
    (0..=n as usize).map(|i| length * i as f64 / n).collect()
}

/// Edges of cells with equally many values.
fn spanning(mut values: Vec<f64>) -> Vec<f64> {
    values.retain(|v| v.is_finite());
    values.sort_by(f64::total_cmp);
    let (Some(&first), Some(&last)) = (values.first(), values.last()) else { return Vec::new() };
    let mut edges = vec![first];
    edges.extend(quantiles_of(&values, N_QUANTILE_CELLS));
    edges.push(last);
    edges.dedup();
    edges
}

/// The cell of a value; the last edge belongs to the last cell.
fn cell_of(edges: &[f64], value: f64) -> Option<usize> {
    let n = edges.len().checked_sub(1).filter(|n| *n > 0)?;
    let is_inside = value >= edges[0] && value <= edges[n];
    is_inside.then(|| (edges.partition_point(|edge| *edge <= value).max(1) - 1).min(n - 1))
}

fn place(edges: &[Vec<f64>; 2], at: [f64; 2]) -> Option<usize> {
    let [x, y] = [cell_of(&edges[0], at[0])?, cell_of(&edges[1], at[1])?];
    Some(y * (edges[0].len() - 1) + x)
}

/// Receives coordinates, and an event count with the expected count or the innovation.
type CellSink<'a> = &'a mut dyn FnMut([f64; 2], [f64; 2]);

/// A map of the sums per cell; `None` for a single cell.
fn map(
    axes: [&str; 2],
    edges: [Vec<f64>; 2],
    value: HeatValue,
    residuals: &[ModelResiduals; 2],
    sum: &dyn Fn(&ModelResiduals, CellSink<'_>),
) -> Option<HeatMap> {
    let n: usize = edges.iter().map(|edges| edges.len().saturating_sub(1)).product();
    let [before, after] = residuals.each_ref().map(|residuals| {
        let mut sums = vec![[0.0; 2]; n];
        sum(residuals, &mut |at, [events, other]| {
            if let Some(cell) = place(&edges, at) {
                sums[cell][0] += events;
                sums[cell][1] += other;
            }
        });
        sums
    });
    let value_of = |&[events, other]: &[f64; 2]| match value {
        HeatValue::Surplus => {
            (events + other >= MIN_CELL_EVENTS).then(|| (events - other) / other.max(1.0).sqrt())
        }
        HeatValue::Innovation => (events >= MIN_CELL_EVENTS).then(|| other / events),
    };
    (n > 1).then(|| HeatMap {
        axes: axes.map(str::to_owned),
        value,
        values: [&before, &after].map(|sums| sums.iter().map(value_of).collect()),
        n_events: before.iter().map(|[events, _]| *events as u64).collect(),
        edges,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_cell_includes_its_upper_edge() {
        let edges = [0.0, 1.0, 4.0];
        let of = |value| cell_of(&edges, value);
        assert_eq!([of(0.0), of(1.0), of(4.0)], [Some(0), Some(1), Some(1)]);
        assert_eq!([of(-0.1), of(4.1), of(f64::NAN)], [None; 3]);
        assert_eq!(cell_of(&[], 1.0), None);
        let spread = spanning((0..=60).map(f64::from).collect());
        assert_eq!(spread, [0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0]);
    }
}
