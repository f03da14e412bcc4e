//! Heat maps of where a model is wrong: over the sensor, over time and rows, and over how long ago
//! the pixel's last event was and how fast the light changes.

use super::fit::Fitted;
use super::strata::{quantiles_of, walked};
use super::{Evidence, PixelEvidence};
use crate::predict::{Residual, Silence};
use serde::{Deserialize, Serialize};

/// Cells along either side of the sensor, at most.
const ACROSS: usize = 10;

/// Bands of rows.
const BANDS: usize = 6;

/// Parts of an interval's or a contrast rate's range.
const PARTS: usize = 6;

/// Expected and real events that a cell has to have together to be shown.
const LEAST: f64 = 12.0;

/// What a cell's value is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum HeatValue {
    /// Real events that came beyond those the model expected, the past being known, over the root of
    /// the expected: beyond 3 of either sign it is hardly chance.
    Surplus,
    /// Mean of what the light had changed beyond the threshold when events came, in thresholds:
    /// late above 0, early below.
    Innovation,
}

/// One heat map, of the baseline and of the model with the named effects.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct HeatMap {
    /// What lies along the map, and upwards: covariates of `mismatch.where`.
    pub axes: [String; 2],
    /// AscendingFrames edges of the cells along either axis, one more than cells.
    pub edges: [Vec<f64>; 2],
    /// What the values are.
    pub value: HeatValue,
    /// Values row by row, the lowest first: baseline, then with the named effects; `null` in cells
    /// with too few events.
    pub values: [Vec<Option<f64>>; 2],
    /// Events in each cell.
    pub n_events: Vec<u64>,
}

/// What pixels show under a model: each one's events, and its counts in each block of time.
type Seen = Vec<(Vec<Residual>, Vec<Silence>)>;

/// The maps of a baseline and of a model on the same evidence.
pub(super) fn heat_maps(evidence: &Evidence, models: [&Fitted; 2]) -> Vec<HeatMap> {
    let seen = models.map(|model| walked(evidence, model));
    let [width, height] = evidence.middle.map(|middle| 2.0 * middle);
    let cell = width.max(height) / ACROSS as f64;
    let sensor = [even(width, (width / cell).ceil()), even(height, (height / cell).ceil())];
    let blocks = evidence.blocks;
    let seconds = blocks.length_us() as f64 * 1e-6;
    let rows = [even(seconds, blocks.n() as f64), even(height, BANDS as f64)];
    let half_s = 0.5 * seconds / blocks.n() as f64;
    let all: Vec<&Residual> = seen[0].iter().flat_map(|(events, _)| events).collect();
    let interval = |r: &Residual| r.previous.map_or(f64::NAN, |p| p.ago_s * 1e6);
    let rate = |r: &Residual| r.slope_per_s;
    let parts = |of: &dyn Fn(&Residual) -> f64| spanning(all.iter().map(|r| of(r)).collect());
    let past = [parts(&interval), parts(&rate)];
    let surplus = |axes, edges, at: &dyn Fn(&PixelEvidence, usize) -> [f64; 2]| {
        map(axes, edges, HeatValue::Surplus, &seen, &|seen, add| {
            for (pixel, (_, counts)) in evidence.pixels.iter().zip(seen) {
                for (block, one) in counts.iter().enumerate() {
                    let real = f64::from(one.on + one.off);
                    add(at(pixel, block), [real, one.expected_on + one.expected_off]);
                }
            }
        })
    };
    let innovation = |axes, edges, at: &dyn Fn(&Residual) -> [f64; 2]| {
        map(axes, edges, HeatValue::Innovation, &seen, &|seen, add| {
            for event in seen.iter().flat_map(|(events, _)| events) {
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

/// Edges of `n` equal cells from 0 to `length`.
fn even(length: f64, n: f64) -> Vec<f64> {
    (0..=n as usize).map(|i| length * i as f64 / n).collect()
}

/// Edges of cells that hold about equally many of the values, the least and the greatest included.
fn spanning(mut values: Vec<f64>) -> Vec<f64> {
    values.retain(|v| v.is_finite());
    values.sort_by(f64::total_cmp);
    let (Some(&first), Some(&last)) = (values.first(), values.last()) else { return Vec::new() };
    let mut edges = vec![first];
    edges.extend(quantiles_of(&values, PARTS));
    edges.push(last);
    edges.dedup();
    edges
}

/// The cell that a value lies in; the last edge belongs to the last cell.
fn cell_of(edges: &[f64], value: f64) -> Option<usize> {
    let n = edges.len().checked_sub(1).filter(|n| *n > 0)?;
    let is_inside = value >= edges[0] && value <= edges[n];
    is_inside.then(|| (edges.partition_point(|edge| *edge <= value).max(1) - 1).min(n - 1))
}

fn place(edges: &[Vec<f64>; 2], at: [f64; 2]) -> Option<usize> {
    let [x, y] = [cell_of(&edges[0], at[0])?, cell_of(&edges[1], at[1])?];
    Some(y * (edges[0].len() - 1) + x)
}

/// Takes what lies at a place: its events, and what the model expected or by how much they were late.
type Add<'a> = &'a mut dyn FnMut([f64; 2], [f64; 2]);

/// A map of what `sum` hands over of each model; none of a single cell.
fn map(
    axes: [&str; 2],
    edges: [Vec<f64>; 2],
    value: HeatValue,
    seen: &[Seen; 2],
    sum: &dyn Fn(&Seen, Add<'_>),
) -> Option<HeatMap> {
    let n: usize = edges.iter().map(|edges| edges.len().saturating_sub(1)).product();
    let [before, after] = seen.each_ref().map(|seen| {
        let mut sums = vec![[0.0; 2]; n];
        sum(seen, &mut |at, [events, other]| {
            if let Some(cell) = place(&edges, at) {
                sums[cell][0] += events;
                sums[cell][1] += other;
            }
        });
        sums
    });
    let told = |&[events, other]: &[f64; 2]| match value {
        HeatValue::Surplus => {
            (events + other >= LEAST).then(|| (events - other) / other.max(1.0).sqrt())
        }
        HeatValue::Innovation => (events >= LEAST).then(|| other / events),
    };
    (n > 1).then(|| HeatMap {
        axes: axes.map(str::to_owned),
        value,
        values: [&before, &after].map(|sums| sums.iter().map(told).collect()),
        n_events: before.iter().map(|[events, _]| *events as u64).collect(),
        edges,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_take_their_lower_edge_and_the_last_its_upper_too() {
        let edges = [0.0, 1.0, 4.0];
        let of = |value| cell_of(&edges, value);
        assert_eq!([of(0.0), of(1.0), of(4.0)], [Some(0), Some(1), Some(1)]);
        assert_eq!([of(-0.1), of(4.1), of(f64::NAN)], [None; 3]);
        assert_eq!(cell_of(&[], 1.0), None);
        let spread = spanning((0..=60).map(f64::from).collect());
        assert_eq!(spread, [0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0]);
    }
}
