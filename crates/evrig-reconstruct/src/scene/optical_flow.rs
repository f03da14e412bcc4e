//! Optical flow between two frames for motion-compensated interpolation.
//!
//! Points near changed pixels are tracked in both directions (pyramidal Lucas-Kanade; Bouguet,
//! 2000). Their displacements are clustered into candidates for each neighbourhood. At a position
//! and instant the candidate, or no motion, whose patches agree best in both frames is used.

use super::frame_view::FrameView;
use super::patch::patch_difference;
use super::pixel_noise::PixelNoise;
use evrig_core::geometry::Size;
use kornia_image::{Image, ImageSize};
use kornia_imgproc::optical_flow_pyr_lk::{
    PyrLKError, PyrLKParams, PyrLKPrecomputed, build_lk_precomputed,
    calc_optical_flow_pyr_lk_with_precomputed,
};
use std::collections::BTreeMap;

/// A pixel has changed when it differs by so many standard deviations of the noise.
const CHANGE_SIGMAS: f32 = 6.0;
/// Neighbourhood of a changed pixel in which motion is possible, pixels.
const REACH_PX: usize = 10;
/// Spacing of tracked points, pixels.
const POINT_SPACING_PX: usize = 3;
/// Range of accepted displacements, pixels.
const MIN_SHIFT_PX: f32 = 0.3;
const MAX_SHIFT_PX: f32 = 40.0;
/// Displacements that differ by less are merged, pixels.
const MERGE_PX: f32 = 0.5;
/// Most candidate displacements; indices are one byte.
const MAX_SHIFTS: usize = 255;
/// Side of a cell with its own list of candidates, pixels.
const CELL_PX: usize = 16;
const MAX_LEVELS: usize = 3;
/// Side of the tracking window; no pyramid level is smaller.
const WINDOW_PX: usize = 21;

/// Candidate displacements between two frames.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct FrameFlow {
    /// Displacements from the earlier frame to the later, pixels.
    shifts: Vec<[f32; 2]>,
    /// Candidates of each cell; empty where nothing moved.
    cells: Vec<Vec<u8>>,
    cells_across: usize,
}

impl FrameFlow {
    /// Tracks at most `most_points` points from each frame. Frames too small to track have no
    /// motion.
    pub(super) fn estimate(
        before: FrameView<'_>,
        after: FrameView<'_>,
        noise: &PixelNoise,
        max_points: usize,
    ) -> Self {
        if before.width().min(before.height()) < 2 * WINDOW_PX {
            return Self::default();
        }
        let mut points = changed_points(before, after, noise);
        let step = points.len().div_ceil(max_points).max(1);
        points = points.into_iter().step_by(step).collect();
        if points.is_empty() {
            return Self::default();
        }
        let tracks = track_points(before, after, &points).unwrap_or_default();
        Self::from_tracks(&tracks, before.size)
    }

    /// Merges similar displacements and enters each in the cells near its tracks.
    fn from_tracks(tracks: &[[[f32; 2]; 2]], size: Size) -> Self {
        let mut clusters: BTreeMap<[i32; 2], Vec<[[f32; 2]; 2]>> = BTreeMap::new();
        for &[from, to] in tracks {
            let class = [to[0] - from[0], to[1] - from[1]].map(|d| (d / MERGE_PX).round() as i32);
            clusters.entry(class).or_default().push([from, to]);
        }
        let mut clusters: Vec<_> = clusters.into_iter().collect();
        clusters.sort_by(|a, b| b.1.len().cmp(&a.1.len()).then(a.0.cmp(&b.0)));
        clusters.truncate(MAX_SHIFTS);
        let cells_across = usize::from(size.width).div_ceil(CELL_PX);
        let cells_down = usize::from(size.height).div_ceil(CELL_PX);
        let mut flow = Self {
            shifts: Vec::new(),
            cells: vec![Vec::new(); cells_across * cells_down],
            cells_across,
        };
        for (id, (_, tracks)) in clusters.iter().enumerate() {
            let mean = |axis: usize| {
                let moved = tracks.iter().map(|[from, to]| to[axis] - from[axis]);
                moved.sum::<f32>() / tracks.len() as f32
            };
            flow.shifts.push([mean(0), mean(1)]);
            for track in tracks {
                flow.enter(id as u8, *track, [cells_across, cells_down]);
            }
        }
        flow
    }

    /// Enters a displacement in the cells near the segment between two points.
    fn enter(&mut self, id: u8, [from, to]: [[f32; 2]; 2], n_cells: [usize; 2]) {
        let range = |axis: usize| {
            let (low, high) = (from[axis].min(to[axis]), from[axis].max(to[axis]));
            let reach = REACH_PX as f32;
            let cell = |at: f32| ((at.max(0.0) as usize) / CELL_PX).min(n_cells[axis] - 1);
            cell(low - reach)..=cell(high + reach)
        };
        for y in range(1) {
            for x in range(0) {
                let cell = &mut self.cells[y * n_cells[0] + x];
                if cell.last() != Some(&id) {
                    cell.push(id);
                }
            }
        }
    }

    pub(super) fn candidates(
        &self,
        [x, y]: [f32; 2],
    ) -> impl Iterator<Item = [f32; 2]> + Clone + '_ {
        let cell = |at: f32| at.max(0.0) as usize / CELL_PX;
        let index = cell(y) * self.cells_across + cell(x);
        let ids = self.cells.get(index).map_or(&[][..], Vec::as_slice);
        ids.iter().map(|id| self.shifts[usize::from(*id)])
    }
}

/// The candidate displacement with the best agreement of both frames at a position, `share` of the
/// way from the earlier frame to the later. Zero unless a candidate agrees better by more than the
/// noise.
pub(super) fn best_shift(
    [before, after]: [FrameView<'_>; 2],
    place: [f32; 2],
    share: f32,
    shifts: impl Iterator<Item = [f32; 2]>,
    noise: f32,
) -> [f32; 2] {
    let unmoved = patch_difference(before, after, [place; 2], f32::INFINITY);
    let mut best = ([0.0; 2], unmoved.unwrap_or(f32::INFINITY));
    for shift in shifts {
        let flow_ends = flow_ends(place, share, shift);
        if let Some(cost) = patch_difference(before, after, flow_ends, best.1 - noise) {
            best = (shift, cost + noise);
        }
    }
    best.0
}

/// Positions in the earlier and later frame of what is at `place` between them.
pub(super) fn flow_ends(place: [f32; 2], share: f32, shift: [f32; 2]) -> [[f32; 2]; 2] {
    [
        [place[0] - share * shift[0], place[1] - share * shift[1]],
        [place[0] + (1.0 - share) * shift[0], place[1] + (1.0 - share) * shift[1]],
    ]
}

/// Grid points near pixels that differ between two frames.
fn changed_points(
    before: FrameView<'_>,
    after: FrameView<'_>,
    noise: &PixelNoise,
) -> Vec<[f32; 2]> {
    let (width, height) = (before.width(), before.height());
    let has_changed: Vec<bool> = before
        .values
        .iter()
        .zip(after.values)
        .map(|(a, b)| (b - a).abs() > CHANGE_SIGMAS * noise.at(a.max(*b)))
        .collect();
    let n_cells = [width.div_ceil(POINT_SPACING_PX), height.div_ceil(POINT_SPACING_PX)];
    let mut is_near = vec![false; n_cells[0] * n_cells[1]];
    let around = |at: usize, n: usize| {
        at.saturating_sub(REACH_PX) / POINT_SPACING_PX
            ..=(at + REACH_PX).min(n - 1) / POINT_SPACING_PX
    };
    for y in 0..height.saturating_sub(1) {
        for x in 0..width.saturating_sub(1) {
            // A single changed pixel is noise or a hot pixel.
            let at = |dx: usize, dy: usize| has_changed[(y + dy) * width + x + dx];
            if at(0, 0) && (at(1, 0) || at(0, 1)) {
                for j in around(y, height) {
                    for i in around(x, width) {
                        is_near[j * n_cells[0] + i] = true;
                    }
                }
            }
        }
    }
    (0..is_near.len())
        .filter(|i| is_near[*i])
        .map(|i| [i % n_cells[0], i / n_cells[0]].map(|cell| (cell * POINT_SPACING_PX) as f32))
        .collect()
}

/// Tracks of the points, followed in both directions.
fn track_points(
    before: FrameView<'_>,
    after: FrameView<'_>,
    points: &[[f32; 2]],
) -> Result<Vec<[[f32; 2]; 2]>, PyrLKError> {
    let least = before.width().min(before.height());
    let max_level = (1..=MAX_LEVELS).take_while(|level| least >> level > WINDOW_PX).count();
    let parameters = PyrLKParams { max_level, min_eigen_threshold: 1e-5, ..PyrLKParams::default() };
    let image = |view: FrameView<'_>| {
        let size = ImageSize { width: view.width(), height: view.height() };
        Image::<f32, 1>::new(size, view.values.to_vec())
    };
    let [before, after] = [image(before)?, image(after)?];
    let follow = |from: &Image<f32, 1>, to: &Image<f32, 1>| {
        let pyramids: PyrLKPrecomputed = build_lk_precomputed(from, to, max_level)?;
        let found =
            calc_optical_flow_pyr_lk_with_precomputed(&pyramids, points, None, &parameters)?;
        let ways = points.iter().zip(found.next_pts).zip(found.status);
        let ways = ways.filter(|way| way.1 == 1).map(|way| [*way.0.0, way.0.1]);
        Ok::<Vec<_>, PyrLKError>(ways.collect())
    };
    let forwards = follow(&before, &after)?;
    let backwards = follow(&after, &before)?.into_iter().map(|[from, to]| [to, from]);
    let is_one = |[from, to]: &[[f32; 2]; 2]| {
        (MIN_SHIFT_PX..=MAX_SHIFT_PX).contains(&(to[0] - from[0]).hypot(to[1] - from[1]))
    };
    Ok(forwards.into_iter().chain(backwards).filter(is_one).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: Size = Size { width: 96, height: 80 };

    /// A textured square at a column in front of a static textured wall.
    fn view(left: f32) -> Vec<f32> {
        let wall = |x: f32, y: f32| 0.3 + 0.1 * (0.4 * x).sin() * (0.3 * y).cos();
        let square = |x: f32, y: f32| 0.7 + 0.2 * (0.5 * x).cos() * (0.6 * y).sin();
        let value = |i: usize| {
            let (x, y) = ((i % 96) as f32, (i / 96) as f32);
            let is_in = (0.0..24.0).contains(&(x - left)) && (20.0..50.0).contains(&y);
            if is_in { square(x - left, y) } else { wall(x, y) }
        };
        (0..SIZE.n_pixels()).map(value).collect()
    }

    fn view_of(values: &[f32]) -> FrameView<'_> {
        FrameView { size: SIZE, values }
    }

    /// Noise of 0.002 at any intensity.
    fn constant_noise() -> PixelNoise {
        PixelNoise::estimate(&[0.5; 3], 1, 0.002)
    }

    #[test]
    fn moving_regions_are_compensated_and_static_regions_stay() {
        let [first, estimate, last] = [30.0, 32.0, 38.0].map(view);
        let [before, after] = [view_of(&first), view_of(&last)];
        let flow = FrameFlow::estimate(before, after, &constant_noise(), 1_500);
        let at = |place: [f32; 2]| {
            best_shift([before, after], place, 0.25, flow.candidates(place), 0.002)
        };
        let inside = at([42.0, 35.0]);
        assert!((inside[0] - 8.0).abs() < 0.2 && inside[1].abs() < 0.2, "{inside:?}");
        assert_eq!(at([80.0, 70.0]), [0.0; 2]);
        let error = |guess: &dyn Fn([f32; 2]) -> f32| {
            let (mut sum, mut n) = (0.0, 0);
            for y in 22..48 {
                for x in 28..64 {
                    let place = [x as f32, y as f32];
                    sum += (guess(place) - estimate[y * 96 + x]).powi(2);
                    n += 1;
                }
            }
            (sum / n as f32).sqrt()
        };
        let led = error(&|place| {
            let [from, to] = flow_ends(place, 0.25, at(place));
            0.75 * before.at(from) + 0.25 * after.at(to)
        });
        let faded = error(&|place| 0.75 * before.at(place) + 0.25 * after.at(place));
        // What the square uncovers or hides is in one of the two frames only.
        assert!(led < 0.5 * faded, "{led} against {faded}");
    }

    #[test]
    fn nothing_moves_in_noise_or_in_frames_too_small() {
        let first = view(30.0);
        let noisy: Vec<f32> = first
            .iter()
            .enumerate()
            .map(|(i, v)| v + 0.004 * ((i * 7919 % 13) as f32 - 6.0) / 6.0)
            .collect();
        assert_eq!(
            FrameFlow::estimate(view_of(&first), view_of(&noisy), &constant_noise(), 1_500),
            FrameFlow::default()
        );
        let size = Size { width: 2, height: 2 };
        let small = |values| FrameView { size, values };
        let flow =
            FrameFlow::estimate(small(&[0.0; 4]), small(&[1.0; 4]), &constant_noise(), 1_500);
        assert_eq!(flow.candidates([0.0, 0.0]).count(), 0);
    }
}
