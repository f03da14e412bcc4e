//! **event_image_ssim** and **event_image_psnr**: likeness of event images of both streams.
//!
//! An event image holds the signed count of each pixel, ON minus OFF events, over 10 ms, clipped to
//! -2..2: the images of v2e with its default exposure and full scale (`--dvs_exposure duration 0.01`,
//! `--dvs_vid_full_scale 2`; Hu, Liu and Delbruck, CVPRW 2021). Each of the 40 time blocks gives up
//! to 4 images, evenly spaced; a block shorter than 10 ms is one image.
//!
//! - ssim: mean structural similarity (Wang et al., IEEE Transactions on Image Processing 13, 2004)
//!   with uniform windows of 7 x 7 pixels, sample covariances and a data range of 4, as scikit-image
//!   computes it by default. Over the windows whose middle is in the region and which lie in the
//!   grid. 1: equal images.
//! - psnr = 10 log10(16 / mean square difference), the mean over the pixels of all images, dB.
//!   Unknown for equal images, for which it is infinite.
//!
//! Error: time blocks. There is no chance level: two streams of one distribution have images that
//! differ by chance, and how much depends on the number of events.
//!
//! Both depend on the contents: windows without events of either stream are equal, so that sparse
//! images have an ssim near 1 and a high psnr, whatever the simulator. Compare simulators on the
//! same recording only.

use super::ProfilePair;
use super::measure::{Cluster, Measure, MeasureDefinition, MeasureId};
use super::profile::{N_BLOCKS, OUTSIDE};
use evrig_core::event::EventSlice;
use evrig_core::geometry::Size;
use rayon::prelude::*;

/// Duration of an image, µs.
const IMAGE_US: i64 = 10_000;
/// Images of a time block, a budget of work: 160 in all for a recording of any length.
const MAX_IMAGES_PER_BLOCK: i64 = 4;
/// Signed events that are fully white or black.
const FULL_SCALE: i32 = 2;
/// From fully black to fully white.
const DATA_RANGE: f64 = 2.0 * FULL_SCALE as f64;
/// Side of a window of the structural similarity, pixels.
const WINDOW_SIDE: usize = 7;

const SSIM: MeasureDefinition = MeasureDefinition {
    id: MeasureId::EventImageSsim,
    name: "Event image SSIM",
    formula: "mean SSIM of images of 10 ms of signed counts, clipped to -2..2; windows of 7 x 7",
    source: "Wang et al., Image Quality Assessment, IEEE Trans. Image Process. 13, 2004",
    unit: "1",
    clusters: Cluster::TimeBlock,
    healthy: None,
};

const PSNR: MeasureDefinition = MeasureDefinition {
    id: MeasureId::EventImagePsnr,
    name: "Event image PSNR",
    formula: "10 log10(16 / mean square difference of images of 10 ms of signed counts, clipped to \
              -2..2)",
    source: "peak signal-to-noise ratio; images as v2e draws them (Hu et al., CVPRW 2021)",
    unit: "dB",
    clusters: Cluster::TimeBlock,
    healthy: None,
};

/// Sums over the images of a time block.
#[derive(Debug, Clone, Copy, Default)]
struct LikenessSums {
    ssim: f64,
    n_windows: f64,
    squares: f64,
    n_pixels: f64,
}

/// Both measures.
pub(super) fn measures(
    pair: &ProfilePair<'_>,
    real: EventSlice<'_>,
    simulated: EventSlice<'_>,
) -> [Measure; 2] {
    let blocks: Vec<LikenessSums> = (0..N_BLOCKS as i64)
        .into_par_iter()
        .map(|block| {
            let mut sums = LikenessSums::default();
            for [start, end] in spans(pair.layout.window, block) {
                let image = |events: EventSlice<'_>| image(pair, events.between(start, end));
                sums.add(pair, &image(real), &image(simulated));
            }
            sums
        })
        .collect();
    let sums = |of: fn(&LikenessSums) -> f64| -> Vec<f64> { blocks.iter().map(of).collect() };
    let (ssim, n_windows) = (sums(|block| block.ssim), sums(|block| block.n_windows));
    let (squares, n_pixels) = (sums(|block| block.squares), sums(|block| block.n_pixels));
    let n = |counts: &[f64]| counts.iter().sum::<f64>() as u64;
    let ssim = match n(&n_windows) {
        0 => SSIM.unknown("the region holds no window of 7 x 7 pixels"),
        n => SSIM.with(pair.bootstrap.ratio(&ssim, &n_windows, n)),
    };
    let psnr = if squares.iter().all(|&sum| sum == 0.0) {
        PSNR.unknown("all event images are equal: the ratio is infinite")
    } else {
        let dot = evrig_core::stats::dot;
        PSNR.with(pair.bootstrap.estimate(N_BLOCKS, n(&n_pixels), |w| {
            10.0 * (DATA_RANGE.powi(2) * dot(w, &n_pixels) / dot(w, &squares)).log10()
        }))
    };
    [ssim, psnr]
}

/// Start and end of the images of a block, each in the middle of an equal part of it.
fn spans([start, end]: [i64; 2], block: i64) -> Vec<[i64; 2]> {
    let at =
        |i: i64, n: i64| start + (i128::from(end - start) * i128::from(i) / i128::from(n)) as i64;
    let n_blocks = N_BLOCKS as i64;
    let block_us = at(block + 1, n_blocks) - at(block, n_blocks);
    let n = (block_us / IMAGE_US).clamp(1, MAX_IMAGES_PER_BLOCK);
    let middle = |i: i64| {
        let part = [at(block * n + i, n_blocks * n), at(block * n + i + 1, n_blocks * n)];
        let first = part[0] + ((part[1] - part[0] - IMAGE_US) / 2).max(0);
        [first, first.saturating_add(IMAGE_US).min(part[1])]
    };
    (0..n).map(middle).collect()
}

/// Clipped signed counts, row-major.
fn image(pair: &ProfilePair<'_>, events: EventSlice<'_>) -> Vec<i32> {
    let mut counts = vec![0_i32; pair.layout.size.n_pixels()];
    for (pixel, i) in pair.layout.in_region(events) {
        counts[pixel] += if events.on[i] { 1 } else { -1 };
    }
    counts.iter_mut().for_each(|count| *count = (*count).clamp(-FULL_SCALE, FULL_SCALE));
    counts
}

impl LikenessSums {
    fn add(&mut self, pair: &ProfilePair<'_>, real: &[i32], simulated: &[i32]) {
        let is_in = |pixel: usize| pair.layout.tile_of[pixel] != OUTSIDE;
        for (pixel, (a, b)) in real.iter().zip(simulated).enumerate() {
            if is_in(pixel) {
                self.squares += f64::from((a - b).pow(2));
                self.n_pixels += 1.0;
            }
        }
        each_window(real, simulated, pair.layout.size, |pixel, sums| {
            if is_in(pixel) {
                self.ssim += similarity(sums);
                self.n_windows += 1.0;
            }
        });
    }
}

/// Sums of a, b, aa, bb and ab over a window.
type WindowSums = [i32; 5];

/// Calls `visit` with the middle pixel and the sums of each window in the grid. Sums run down the
/// columns, then along the rows; they are integers and therefore exact.
fn each_window(a: &[i32], b: &[i32], size: Size, mut visit: impl FnMut(usize, WindowSums)) {
    let (width, height) = (size.width as usize, size.height as usize);
    if width.min(height) < WINDOW_SIDE {
        return;
    }
    let terms = |pixel: usize| -> WindowSums {
        let (a, b) = (a[pixel], b[pixel]);
        [a, b, a * a, b * b, a * b]
    };
    let add = |sums: &mut WindowSums, terms: WindowSums, sign: i32| {
        sums.iter_mut().zip(terms).for_each(|(sum, term)| *sum += sign * term);
    };
    let mut columns = vec![[0; 5]; width];
    for y in 0..height {
        for (x, column) in columns.iter_mut().enumerate() {
            add(column, terms(y * width + x), 1);
            if y >= WINDOW_SIDE {
                add(column, terms((y - WINDOW_SIDE) * width + x), -1);
            }
        }
        if y + 1 < WINDOW_SIDE {
            continue;
        }
        let mut window = [0; 5];
        for x in 0..width {
            add(&mut window, columns[x], 1);
            if x >= WINDOW_SIDE {
                add(&mut window, columns[x - WINDOW_SIDE], -1);
            }
            if x + 1 >= WINDOW_SIDE {
                let half = WINDOW_SIDE / 2;
                visit((y - half) * width + x - half, window);
            }
        }
    }
}

/// Structural similarity of a window, with the constants 0.01 and 0.03 of its authors.
fn similarity(sums: WindowSums) -> f64 {
    let n = (WINDOW_SIDE * WINDOW_SIDE) as f64;
    let [a, b, aa, bb, ab] = sums.map(f64::from);
    let (mean_a, mean_b) = (a / n, b / n);
    let covariance = |sum: f64, product: f64| (sum / n - product) * n / (n - 1.0);
    let (c1, c2) = ((0.01 * DATA_RANGE).powi(2), (0.03 * DATA_RANGE).powi(2));
    let [of_a, of_b] = [covariance(aa, mean_a * mean_a), covariance(bb, mean_b * mean_b)];
    let of_both = covariance(ab, mean_a * mean_b);
    (2.0 * mean_a * mean_b + c1) * (2.0 * of_both + c2)
        / ((mean_a * mean_a + mean_b * mean_b + c1) * (of_a + of_b + c2))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_structural_similarity_is_that_of_scikit_image() {
        // skimage.metrics.structural_similarity(a, b, data_range=4) of scikit-image 0.26.0, a and
        // b as below.
        let size = Size::new(12, 9);
        let value = |i: usize, step: usize| ((i * i * step + 3 * i) % 5) as i32 - 2;
        let a: Vec<i32> = (0..108).map(|i| value(i, 7)).collect();
        let b: Vec<i32> = (0..108).map(|i| if i % 4 == 0 { value(i, 3) } else { a[i] }).collect();
        let (mut sum, mut n) = (0.0, 0);
        each_window(&a, &b, size, |_, sums| {
            sum += similarity(sums);
            n += 1;
        });
        assert_eq!(n, 6 * 3);
        assert!(
            (sum / f64::from(n) - 0.019_346_105_039_354_203).abs() < 1e-12,
            "{}",
            sum / f64::from(n)
        );
    }

    #[test]
    fn images_lie_in_their_blocks_and_cover_short_ones() {
        let all: Vec<_> = (0..40).flat_map(|block| spans([0, 4_000_000], block)).collect();
        assert_eq!(all.len(), 160);
        assert_eq!(all[..2], [[7_500, 17_500], [32_500, 42_500]]);
        let short: Vec<_> = (0..40).flat_map(|block| spans([5, 85], block)).collect();
        assert_eq!((short[0], short[39]), ([5, 7], [83, 85]));
        assert_eq!(spans([i64::MAX - 9, i64::MAX], 39).len(), 1);
    }
}
