//! Ratio of the thresholds from the balance of ON and OFF.
//!
//! Where the brightness of a pixel returns, its ups and downs cancel: the ON threshold times the
//! number of ON events equals the OFF threshold times the number of OFF events. That it returns is
//! an assumption; busy pixels need it least, as the remainder of a change is a small part of all
//! their events.

use super::SectionResult;
use super::pixel_outliers::PixelCounts;
use evrig_core::geometry::Size;
use evrig_core::stats::Estimate;
use serde::Serialize;

/// Tiles along either side over which the error is resampled: scenes are alike nearby.
const N_TILES: usize = 8;

/// Fewest tiles with events, for an error from their scatter.
const MIN_TILES: usize = 5;

/// Fewest events of a pixel: with ten, a contrast of one threshold that is left is a tenth.
const MIN_EVENTS_PER_PIXEL: u32 = 10;

/// Share of all events, in the busiest pixels.
const BUSY_SHARE: f64 = 0.5;

/// Balance of the polarities.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ThresholdRatio {
    /// ON threshold over OFF threshold, if brightness returns and there is no leak.
    pub on_over_off: Estimate,
    /// Pixels that were used: the busiest ones with half of all events.
    pub n_pixels: u64,
    /// Share of ON events of the whole stream.
    pub on_share: f64,
}

/// `hot` pixels are left out; `left_out` are ON and OFF events of each pixel in bursts.
pub(super) fn ratio(
    pixels: &PixelCounts,
    size: Size,
    hot: &[bool],
    left_out: &[[u32; 2]],
) -> SectionResult<ThresholdRatio> {
    let all = hot.iter().enumerate().map(|(pixel, _)| pixels.by_polarity(pixel));
    let [all_on, all_off] =
        all.fold([0_u64; 2], |[on, off], [a, b]| [on + u64::from(a), off + u64::from(b)]);
    if all_on == 0 || all_off == 0 {
        return SectionResult::not_measured(format!(
            "too few polarities for the ratio of thresholds: {all_on} ON and {all_off} OFF events, \
             both are needed"
        ));
    }
    let busy = busy_pixels(pixels, hot, left_out, BUSY_SHARE * (all_on + all_off) as f64);
    let tiles = tile_sums(&busy, size);
    let [on, off] = [0, 1].map(|i| tiles.iter().map(|tile| tile[i]).sum::<f64>());
    if tiles.len() < MIN_TILES || on <= 0.0 || off <= 0.0 {
        return SectionResult::not_measured(format!(
            "too few events for the ratio of thresholds: {} pixels in {} of {} tiles have \
             {MIN_EVENTS_PER_PIXEL} events or more, at least {MIN_TILES} tiles are needed",
            busy.len(),
            tiles.len(),
            N_TILES * N_TILES
        ));
    }
    // Ratio estimator: its variance is that of the residuals of the tiles.
    let value = off / on;
    let residuals: f64 = tiles.iter().map(|tile| (tile[1] - value * tile[0]).powi(2)).sum();
    let m = tiles.len() as f64;
    let error = (m / (m - 1.0) * residuals).sqrt() / on;
    SectionResult::Known(ThresholdRatio {
        on_over_off: Estimate::normal(value, error, (on + off) as u64),
        n_pixels: busy.len() as u64,
        on_share: all_on as f64 / (all_on + all_off) as f64,
    })
}

/// The busiest pixels with a number of events together, and the ON and OFF events of each.
fn busy_pixels(
    pixels: &PixelCounts,
    hot: &[bool],
    left_out: &[[u32; 2]],
    enough: f64,
) -> Vec<(usize, [u32; 2])> {
    let kept = |pixel: usize| {
        let [on, off] = pixels.by_polarity(pixel);
        let [burst_on, burst_off] = left_out.get(pixel).copied().unwrap_or_default();
        [on.saturating_sub(burst_on), off.saturating_sub(burst_off)]
    };
    let cool = hot.iter().enumerate().filter(|(_, hot)| !**hot);
    let mut busy: Vec<(usize, [u32; 2])> = cool
        .map(|(pixel, _)| (pixel, kept(pixel)))
        .filter(|(_, [on, off])| on + off >= MIN_EVENTS_PER_PIXEL)
        .collect();
    busy.sort_by_key(|(_, [on, off])| std::cmp::Reverse(on + off));
    let mut sum = 0.0;
    let is_needed = |(_, [on, off]): &&(usize, [u32; 2])| {
        let is_needed = sum < enough;
        sum += f64::from(on + off);
        is_needed
    };
    let n = busy.iter().take_while(is_needed).count();
    busy.truncate(n);
    busy
}

/// ON and OFF events of each tile that has any.
fn tile_sums(busy: &[(usize, [u32; 2])], size: Size) -> Vec<[f64; 2]> {
    let [width, height] = [size.width, size.height].map(usize::from);
    let mut tiles = vec![[0.0; 2]; N_TILES * N_TILES];
    for (pixel, [on, off]) in busy {
        let [column, row] = [pixel % width * N_TILES / width, pixel / width * N_TILES / height];
        let tile = &mut tiles[row * N_TILES + column];
        tile[0] += f64::from(*on);
        tile[1] += f64::from(*off);
    }
    tiles.retain(|tile| tile[0] + tile[1] > 0.0);
    tiles
}
