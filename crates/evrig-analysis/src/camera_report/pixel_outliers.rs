//! Hot and silent pixels: Poisson tails against the neighbours' counts, with Holm's correction over
//! all pixels.

use super::SectionResult;
use super::chance::{HALF_LEVEL_Z, LEVEL, holm, normal_tail, poisson_rate, poisson_tail};
use evrig_core::event::EventSlice;
use evrig_core::geometry::Size;
use evrig_core::stats::Estimate;
use serde::Serialize;

/// A pixel is called hot above this many times its neighbours' rate, and silent below the
/// reciprocal of it. A definition: thresholds of neighbouring pixels differ by a tenth or a quarter
/// (Wang et al., arXiv 2012.09378), and noise rates by factors of two with them.
pub const OUTLIER_RATIO: f64 = 4.0;

/// The neighbour that counts, by rank: the largest or smallest one may be an outlier itself.
const REFERENCE_RANK: usize = 1;

/// Hot and silent pixels of the sensor.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PixelOutliers {
    /// Hot pixels, highest rate first.
    pub hot: Vec<HotPixel>,
    /// Share of all events from hot pixels.
    pub hot_share: Estimate,
    /// Pixels without any event although their neighbours have many.
    pub silent: Vec<[u16; 2]>,
    /// Pixels without any event.
    pub n_without_events: u64,
    /// Pixels whose neighbours have so many events that silence would be recognised.
    pub n_testable: u64,
    /// Pixels of the sensor.
    pub n_pixels: u64,
    /// Events of each pixel, row by row.
    #[serde(skip)]
    pub counts: Vec<u32>,
}

/// A pixel with many times its neighbours' events, in either half of the time.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct HotPixel {
    /// Column.
    pub x: u16,
    /// Row.
    pub y: u16,
    /// Events per second.
    pub rate_hz: Estimate,
    /// Second largest count of a direct neighbour.
    pub neighbour_events: u32,
    /// Share of ON events.
    pub on_share: f64,
    /// Probability of such a pixel anywhere on the sensor by chance.
    pub false_alarm_probability: f64,
}

/// Events of each pixel: OFF and ON in the first, OFF and ON in the second half of the time.
pub(super) struct PixelCounts {
    size: Size,
    counts: Vec<[u32; 4]>,
    seconds: f64,
}

impl PixelCounts {
    pub(super) fn new(events: EventSlice<'_>, size: Size) -> Self {
        let mut counts = vec![[0; 4]; size.n_pixels()];
        let [first, last] = [events.t.first(), events.t.last()].map(|t| t.copied().unwrap_or(0));
        let half = events.t.partition_point(|t| *t < first + (last - first) / 2);
        for i in 0..events.len() {
            let of_half = 2 * usize::from(i >= half) + usize::from(events.on[i]);
            counts[size.index(events.x[i], events.y[i])][of_half] += 1;
        }
        Self { size, counts, seconds: (last - first) as f64 * 1e-6 }
    }

    pub(super) fn total(&self, pixel: usize) -> u32 {
        self.counts[pixel].iter().sum()
    }

    fn halves(&self, pixel: usize) -> [u32; 2] {
        let [off, on, off_late, on_late] = self.counts[pixel];
        [off + on, off_late + on_late]
    }

    /// Number of ON and OFF events of a pixel.
    pub(super) fn by_polarity(&self, pixel: usize) -> [u32; 2] {
        let [off, on, off_late, on_late] = self.counts[pixel];
        [on + on_late, off + off_late]
    }

    /// Counts of the direct neighbours, ascending, and how many there are.
    fn neighbours(&self, x: usize, y: usize) -> ([u32; 8], usize) {
        let [width, height] = [self.size.width, self.size.height].map(usize::from);
        let (mut counts, mut n) = ([0; 8], 0);
        for v in y.saturating_sub(1)..(y + 2).min(height) {
            for u in x.saturating_sub(1)..(x + 2).min(width) {
                if (u, v) != (x, y) {
                    counts[n] = self.total(v * width + u);
                    n += 1;
                }
            }
        }
        counts[..n].sort_unstable();
        (counts, n)
    }
}

/// Finds the outliers of the sensor.
pub(super) fn outliers(pixels: &PixelCounts) -> SectionResult<PixelOutliers> {
    let n_pixels = pixels.counts.len();
    let n_events: u64 = (0..n_pixels).map(|pixel| u64::from(pixels.total(pixel))).sum();
    if n_pixels < 9 || pixels.seconds <= 0.0 {
        return SectionResult::not_measured(
            "too few pixels or too short for hot pixels: at least 3 x 3 pixels and two times are \
             needed",
        );
    }
    let width = usize::from(pixels.size.width);
    let mut hot: Vec<(f64, usize, u32)> = Vec::new();
    let mut silent: Vec<(f64, usize)> = Vec::new();
    let (mut n_without_events, mut n_testable) = (0, 0);
    for pixel in 0..n_pixels {
        let own = pixels.total(pixel);
        let (neighbours, n) = pixels.neighbours(pixel % width, pixel / width);
        let high = neighbours[(n - 1).saturating_sub(REFERENCE_RANK)];
        let low = neighbours[REFERENCE_RANK.min(n - 1)];
        // By chance, the second largest of eight neighbours is seldom below the common mean.
        let most = OUTLIER_RATIO * f64::from(high.max(1));
        if f64::from(own) > most {
            hot.push((poisson_tail(own.into(), most), pixel, high));
        }
        let silence = (-f64::from(low) / OUTLIER_RATIO).exp();
        n_testable += u64::from(silence * n_pixels as f64 <= LEVEL);
        if own == 0 {
            n_without_events += 1;
            silent.push((silence, pixel));
        }
    }
    hot.sort_by(|a, b| a.0.total_cmp(&b.0));
    silent.sort_by(|a, b| a.0.total_cmp(&b.0));
    let n_hot = holm(&hot.iter().map(|hot| hot.0).collect::<Vec<_>>(), n_pixels, LEVEL);
    let n_silent = holm(&silent.iter().map(|s| s.0).collect::<Vec<_>>(), n_pixels, LEVEL);
    hot.truncate(n_hot);
    hot.retain(|(_, pixel, high)| is_in_both_halves(pixels, *pixel, *high));
    let place = |pixel: usize| [(pixel % width) as u16, (pixel / width) as u16];
    let n_of_hot: u64 = hot.iter().map(|hot| u64::from(pixels.total(hot.1))).sum();
    let share = n_of_hot as f64 / n_events.max(1) as f64;
    let error = (n_of_hot as f64).sqrt() / n_events.max(1) as f64;
    let mut hot: Vec<HotPixel> =
        hot.into_iter().map(|found| hot_pixel(pixels, place(found.1), found)).collect();
    hot.sort_by(|a, b| b.rate_hz.value.total_cmp(&a.rate_hz.value));
    SectionResult::Known(PixelOutliers {
        hot,
        hot_share: Estimate::normal(share, error, n_events),
        silent: silent.into_iter().take(n_silent).map(|(_, pixel)| place(pixel)).collect(),
        n_without_events,
        n_testable,
        n_pixels: n_pixels as u64,
        counts: (0..n_pixels).map(|pixel| pixels.total(pixel)).collect(),
    })
}

fn hot_pixel(
    pixels: &PixelCounts,
    [x, y]: [u16; 2],
    (chance, pixel, neighbour_events): (f64, usize, u32),
) -> HotPixel {
    let [on, off] = pixels.by_polarity(pixel);
    HotPixel {
        x,
        y,
        rate_hz: poisson_rate(u64::from(on + off), pixels.seconds),
        neighbour_events,
        on_share: f64::from(on) / f64::from((on + off).max(1)),
        false_alarm_probability: (chance * pixels.counts.len() as f64).min(1.0),
    }
}

/// An edge that passes makes a pixel busy for a while; a hot pixel is busy in either half.
fn is_in_both_halves(pixels: &PixelCounts, pixel: usize, neighbour: u32) -> bool {
    let most = 0.5 * OUTLIER_RATIO * f64::from(neighbour.max(1));
    pixels
        .halves(pixel)
        .iter()
        .all(|n| poisson_tail(u64::from(*n), most) < normal_tail(HALF_LEVEL_Z))
}

impl PixelOutliers {
    /// Whether each pixel is hot, row by row.
    #[must_use]
    pub fn hot_mask(&self, size: Size) -> Vec<bool> {
        let mut mask = vec![false; size.n_pixels()];
        self.hot.iter().for_each(|hot| mask[size.index(hot.x, hot.y)] = true);
        mask
    }
}
