//! Effects limited to a rectangle of the sensor.
//!
//! An effect in one part only is underestimated over the whole sensor, or rejected by the rest. So
//! a search also starts from the rectangle of tiles with the largest gain. The region is kept only
//! if it gains more on held-out cells than the effect everywhere.

use super::cell_scores::{
    CellScores, CellSet, MIN_GAIN_NATS_PER_EVENT, is_significant, pixel_gains,
};
use super::fitted::FittedModel;
use super::gauss_newton::{fit, score_model};
use super::local_refinement::{fit_and_refine, refine_locally};
use crate::diagnose::{Evidence, Hypothesis};
use evrig_core::effect_id::EffectGroup;
use evrig_core::geometry::Rectangle;
use std::collections::BTreeMap;
use std::ops::Range;

/// Share of the events that a proper region leaves outside.
const MIN_SHARE_OUTSIDE: f64 = 0.03;

/// Difference within which two fits are equally good.
const EQUAL_NATS_PER_EVENT: f64 = 1e-4;

/// Loss beyond an edge that the edge needs.
const MIN_EDGE_LOSS_NATS: f64 = 3.0;

const MAX_STEPS: usize = 10;

/// A starting point limited to its best rectangle, if that gains much more. Both are scored on the
/// same `evidence` with the same nuisances.
pub(crate) fn start_in_region(
    evidence: &Evidence,
    without: &FittedModel,
    start: &FittedModel,
) -> Option<FittedModel> {
    can_have_region(start).then_some(())?;
    let region = best_rectangle(evidence, &without.cells, &start.cells)?;
    let mut limited = start.clone();
    limited.hypothesis = with_last_effect_in(without, start, Some(region));
    // The region consists of whole tiles.
    let n_blocks = evidence.blocks.n();
    limited.cells = limited
        .cells
        .restricted_to(&without.cells, n_blocks, |tile| evidence.tile_is_in(tile, region));
    let gain = limited.training() - start.training();
    (gain > MIN_GAIN_NATS_PER_EVENT).then_some(limited)
}

/// A converged fit with its last effect in its best region, or everywhere if that is as good.
pub(crate) fn choose_region(
    evidence: &Evidence,
    without: &FittedModel,
    model: FittedModel,
) -> FittedModel {
    if !can_have_region(&model) {
        return model;
    }
    let is_begun_in_part = model.hypothesis.regions.last().is_some_and(Option::is_some);
    let (mut everywhere, in_part) = if is_begun_in_part {
        let start = with_last_effect_in(without, &model, None);
        (fit_and_refine(evidence, start, MAX_STEPS), model)
    } else {
        let region = region_by_gain(evidence, without, &model);
        let in_part = region.map(|region| in_region(evidence, without, &model, region));
        let is_better = |part: &FittedModel| is_better(evidence, without, part, &model);
        let Some(in_part) = in_part.filter(is_better) else { return model };
        (model, in_part)
    };
    // The fitted values inside locate the edges better.
    let same = score_model(evidence, without.hypothesis.at_values_of(&in_part.hypothesis));
    let spread = score_model(evidence, with_last_effect_in(without, &in_part, None));
    let moved = region_by_gain(evidence, &same, &spread)
        .filter(|region| in_part.hypothesis.regions.last() != Some(&Some(*region)))
        .map(|region| in_region(evidence, without, &in_part, region));
    let nats = |a: &FittedModel| a.training();
    let in_part = match moved {
        // Without pixels near an edge the edge is that of the tiles.
        Some(moved) if nats(&moved) > nats(&in_part) - EQUAL_NATS_PER_EVENT => {
            refine_locally(evidence, moved)
        }
        _ if is_begun_in_part => in_part,
        _ => refine_locally(evidence, in_part),
    };
    // The fit in the region may have left a local maximum of the other.
    let spread = score_model(evidence, with_last_effect_in(without, &in_part, None));
    if spread.training() > everywhere.training() {
        everywhere = fit_and_refine(evidence, spread.hypothesis, MAX_STEPS);
    }
    if is_better(evidence, without, &in_part, &everywhere) { in_part } else { everywhere }
}

fn in_region(
    evidence: &Evidence,
    without: &FittedModel,
    model: &FittedModel,
    region: Rectangle,
) -> FittedModel {
    fit(evidence, with_last_effect_in(without, model, Some(region)), MAX_STEPS, 1e-5)
}

/// The rectangle with the largest gain, to the pixel.
fn region_by_gain(
    evidence: &Evidence,
    without: &FittedModel,
    with: &FittedModel,
) -> Option<Rectangle> {
    let region = best_rectangle(evidence, &without.cells, &with.cells)?;
    Some(refine_edges_to_pixels(evidence, &without.hypothesis, &with.hypothesis, region))
}

/// Whether the last effect can have a region: mixtures and clocks cannot.
fn can_have_region(model: &FittedModel) -> bool {
    let last = model.hypothesis.effects.last();
    last.is_some_and(|effect| effect.mixture.is_none() && effect.id.group() != EffectGroup::Clocks)
}

/// The model with its last effect in a region, or everywhere.
fn with_last_effect_in(
    without: &FittedModel,
    model: &FittedModel,
    region: Option<Rectangle>,
) -> Hypothesis {
    let last = model.hypothesis.effects.len() - 1;
    let effect = model.hypothesis.effects[last];
    let mut same = without.hypothesis.at_values_of(&model.hypothesis);
    if model.hypothesis.regions[last].is_none() {
        // A freed nuisance belongs to the effect, not to the rest.
        for freed in effect.freed.iter().map(|freed| freed.nuisance as usize) {
            same.values[freed] = without.hypothesis.values[freed];
        }
    }
    same.with_effect_in(effect, &model.hypothesis.fitted_values(last), region)
}

/// Held-out gain over a model without the effect of this index, with its standard error,
/// stratified by the effect's region.
pub(crate) fn effect_gain(
    evidence: &Evidence,
    model: &FittedModel,
    index: usize,
    other: &FittedModel,
) -> (f64, f64) {
    match model.hypothesis.regions.get(index).copied().flatten() {
        None => model.cells.gain(&other.cells, CellSet::HeldOut),
        Some(region) => model.cells.stratified_gain(&other.cells, CellSet::HeldOut, |cell| {
            evidence.tile_is_in(cell / evidence.blocks.n(), region)
        }),
    }
}

/// Whether a region is significantly better than no region, or significant where the effect
/// everywhere is not.
fn is_better(
    evidence: &Evidence,
    without: &FittedModel,
    limited: &FittedModel,
    everywhere: &FittedModel,
) -> bool {
    let is_gain = |model: &FittedModel, other: &FittedModel| {
        let last = model.hypothesis.effects.len().saturating_sub(1);
        let (gain, error) = effect_gain(evidence, model, last, other);
        is_significant(gain, error)
    };
    is_gain(limited, everywhere) || (is_gain(limited, without) && !is_gain(everywhere, without))
}

/// The contiguous range with the largest sum (Bentley, Comm. ACM 27, 1984); empty if all are
/// negative.
fn max_subarray(gains: impl Iterator<Item = f64>) -> (f64, Range<usize>) {
    let (mut sum, mut first, mut best) = (0.0, 0, (0.0, 0..0));
    for (i, gain) in gains.enumerate() {
        if sum <= 0.0 {
            (sum, first) = (0.0, i);
        }
        sum += gain;
        if sum > best.0 {
            best = (sum, first..i + 1);
        }
    }
    best
}

/// The rectangle of tiles with the largest training gain; `None` if it leaves hardly any events
/// outside.
fn best_rectangle(
    evidence: &Evidence,
    without: &CellScores,
    with: &CellScores,
) -> Option<Rectangle> {
    let [n_across, n_down] = evidence.tiles;
    let n_blocks = evidence.blocks.n();
    let mut gains = vec![0.0; n_across * n_down];
    for cell in with.of(CellSet::Training) {
        let gain = with.log_likelihood[cell] - without.log_likelihood[cell];
        gains[cell / n_blocks] += gain;
    }
    let mut best = (0.0, [0, 0, 0, 0]);
    for top in 0..n_down {
        let mut columns = vec![0.0; n_across];
        for bottom in top..n_down {
            for (x, column) in columns.iter_mut().enumerate() {
                *column += gains[bottom * n_across + x];
            }
            let (sum, Range { start, end }) = max_subarray(columns.iter().copied());
            if sum > best.0 {
                best = (sum, [start, end, top, bottom + 1]);
            }
        }
    }
    let [left, right, top, bottom] = best.1;
    let tile = usize::from(evidence.tile_px);
    let size = [2.0 * evidence.middle[0], 2.0 * evidence.middle[1]];
    let end = |tiles: usize, size: f64| ((tiles * tile) as f64).min(size) as u16;
    let region = Rectangle {
        x_px: [end(left, size[0]), end(right, size[0])],
        y_px: [end(top, size[1]), end(bottom, size[1])],
    };
    let outside = evidence.pixels.iter().filter(|pixel| !region.contains(pixel.x, pixel.y));
    let n_outside: usize = outside.map(|pixel| pixel.spikes.len()).sum();
    let is_part = n_outside as f64 >= MIN_SHARE_OUTSIDE * evidence.n_events() as f64;
    (best.0 > 0.0 && is_part).then_some(region)
}

/// Moves the edges of a rectangle to between pixels that gain and pixels that lose.
fn refine_edges_to_pixels(
    evidence: &Evidence,
    without: &Hypothesis,
    with: &Hypothesis,
    mut region: Rectangle,
) -> Rectangle {
    let gains = pixel_gains(evidence, without, with);
    let [width, height] = evidence.middle.map(|middle| (2.0 * middle) as u16);
    let is_within = |[low, high]: [u16; 2], at: u16| (low..high).contains(&at);
    for _ in 0..2 {
        let (columns, rows) = (region.x_px, region.y_px);
        let along = |is_x: bool| {
            let mut along: BTreeMap<u16, f64> = BTreeMap::new();
            for (pixel, gain) in evidence.pixels.iter().zip(&gains) {
                let (at, across, range) =
                    if is_x { (pixel.x, pixel.y, rows) } else { (pixel.y, pixel.x, columns) };
                if is_within(range, across) {
                    *along.entry(at).or_default() += gain;
                }
            }
            along
        };
        let (on_x, on_y) = (along(true), along(false));
        region.x_px = best_range(&on_x, width).unwrap_or(columns);
        region.y_px = best_range(&on_y, height).unwrap_or(rows);
    }
    region
}

/// The range with the largest gain. It ends midway to the next pixel, or with the sensor.
fn best_range(gains: &BTreeMap<u16, f64>, n: u16) -> Option<[u16; 2]> {
    let places: Vec<(u16, f64)> = gains.iter().map(|(at, gain)| (*at, *gain)).collect();
    let (_, Range { start, end }) = max_subarray(places.iter().map(|place| place.1));
    let between = |i: usize| (places[i - 1].0 + places[i].0).div_ceil(2);
    // An edge needs a loss beyond it.
    let is_told = |beyond: &[(u16, f64)]| {
        beyond.iter().map(|place| place.1).sum::<f64>() < -MIN_EDGE_LOSS_NATS
    };
    let low = if is_told(&places[..start]) { between(start) } else { 0 };
    let high = if is_told(&places[end..]) { between(end) } else { n };
    (start < end).then_some([low, high])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_range_ends_between_gain_and_loss() {
        let at = |all: &[(u16, f64)]| best_range(&all.iter().copied().collect(), 60);
        assert_eq!(at(&[(3, 1.0), (9, -0.5), (20, 2.0), (31, -4.5), (40, 1.0)]), Some([0, 26]));
        assert_eq!(at(&[(3, -4.0), (9, 2.0), (40, 1.0)]), Some([6, 60]));
        assert_eq!(at(&[(3, -1.0), (9, 2.0), (40, 1.0)]), Some([0, 60]));
        assert_eq!(at(&[(3, -1.0)]), None);
    }
}
