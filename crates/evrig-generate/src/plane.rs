//! Frames between frames of a plane that moves through the picture.
//!
//! What a pixel saw between two frames is not between what it saw in them: an edge moves on, it
//! does not fade. Where the frames show a plane whose way through the picture is known, a pixel at
//! any time is a place on the plane, and that place is found in the frame before and in the frame
//! after. Both are taken there and faded into each other, so that nothing jumps when the next pair
//! begins; the frames' own rhythm leaves the events. Rows that saw their light one after another
//! (a rolling shutter) are found at their own times: what comes out is of one instant.
//!
//! Whatever does not lie in the plane is moved as if it did.

mod carry;
mod mesh;
mod sample;

pub use carry::PlaneWarper;

use super::interpolate::{Interpolator, between};
use super::parameter_error::check;
use super::{ParameterError, RowTimes};
use evrig_core::frame::Luminance;
use evrig_core::geometry::{Homography, Size};
use mesh::{PixelMesh, NODE_SPACING_PX};
use rayon::prelude::*;
use sample::CubicSampler;

/// The way of a plane through the picture of a camera.
///
/// *Ideal* pixels are those of the same camera with a perfect lens. Pixel `i` covers `i..i + 1`.
pub trait PlanePath: Send + Sync {
    /// From places on the plane to ideal pixels at a time of the frames' clock, µs; none where it
    /// is not known.
    fn pixel_from_plane(&self, t_us: f64) -> Option<Homography>;

    /// The sensor pixel of an ideal pixel.
    fn distort(&self, ideal: [f64; 2]) -> [f64; 2] {
        ideal
    }

    /// The ideal pixel of a sensor pixel; none where the lens has no way back.
    fn undistort(&self, pixel: [f64; 2]) -> Option<[f64; 2]> {
        Some(pixel)
    }

    /// Whether the lens bends, so that ideal pixels are not the sensor's.
    fn has_distortion(&self) -> bool {
        false
    }
}

/// Puts frames between frames so densely that the plane moves by no more than this between two.
const MAX_STEP_PX: f64 = 0.25;

/// Rows that one thread takes at least.
const MIN_ROWS_PER_TASK: usize = 16;

/// Puts frames between frames along a plane's way.
pub struct PlaneInterpolator {
    finest_us: i64,
    path: Box<dyn PlanePath>,
    rows: RowTimes,
    /// Ideal pixels of the mesh's nodes in frames of this size; `NaN` where the lens has no way back.
    nodes: Option<(Size, Vec<[f64; 2]>)>,
    before: Option<Luminance>,
    n_in_place: u64,
}

/// Where the plane lay while the rows of one frame saw their light.
struct FramePose<'a> {
    frame: &'a Luminance,
    /// At the time of the first, the stated and the last row.
    rows: [Homography; 3],
}

impl<'a> FramePose<'a> {
    fn new(path: &dyn PlanePath, frame: &'a Luminance, times: RowTimes) -> Option<Self> {
        let at = |row: f64| path.pixel_from_plane(frame.t_us as f64 + times.after_us(row));
        let stated = at(times.at_row)?;
        // The outermost rows of the first and last frame may lie outside the path.
        let [top, bottom] = [0.0, f64::from(frame.size.height)].map(at);
        let rows = [top.unwrap_or(stated), stated, bottom.unwrap_or(stated)];
        Some(Self { frame, rows })
    }
}

impl PlaneInterpolator {
    /// Frames are put no closer than `finest_us`, 10 to 1,000,000, and no closer than the plane's
    /// speed asks for: a quarter of a pixel.
    ///
    /// # Errors
    /// A step out of range.
    pub fn new(finest_us: u32, path: Box<dyn PlanePath>) -> Result<Self, ParameterError> {
        check("interpolate_us", f64::from(finest_us), 10.0, 1e6)?;
        Ok(Self {
            finest_us: i64::from(finest_us),
            path,
            rows: RowTimes::default(),
            nodes: None,
            before: None,
            n_in_place: 0,
        })
    }

    /// Rows of the frames to come saw their light at these times.
    pub fn set_rows(&mut self, rows: RowTimes) {
        self.rows = rows;
    }

    /// Intervals that were filled pixel by pixel since nobody knew where the plane was.
    #[must_use]
    pub const fn n_in_place(&self) -> u64 {
        self.n_in_place
    }

    /// Hands on the frames after the previous one up to this one, each of one instant. Where the
    /// plane's place is not known, as [`Interpolator::push`].
    ///
    /// # Errors
    /// What `take` refuses.
    pub fn push<E>(
        &mut self,
        frame: Luminance,
        mut take: impl FnMut(&Luminance) -> Result<(), E>,
    ) -> Result<(), E> {
        match self.before.take() {
            Some(before) => self.fill(&before, &frame, &mut take)?,
            None => take(&self.alone(&frame))?,
        }
        self.before = Some(frame);
        Ok(())
    }

    /// A frame at its own time: its rows brought to one instant.
    fn alone(&mut self, frame: &Luminance) -> Luminance {
        self.straighten(frame.size);
        let shot = self.shot(frame).filter(|_| self.rows.row_us != 0.0);
        let made = shot.and_then(|shot| self.made(&shot, &shot, 0.0, frame.t_us));
        made.unwrap_or_else(|| frame.clone())
    }

    fn fill<E>(
        &mut self,
        before: &Luminance,
        after: &Luminance,
        take: &mut impl FnMut(&Luminance) -> Result<(), E>,
    ) -> Result<(), E> {
        let span_us = after.t_us.saturating_sub(before.t_us);
        let fits = before.size == after.size && (1..Interpolator::BREAK_US).contains(&span_us);
        self.straighten(after.size);
        let shots = if fits { self.shot(before).zip(self.shot(after)) } else { None };
        let Some((first, last)) = shots else {
            self.n_in_place += u64::from(fits);
            let n = if fits { (span_us + self.finest_us - 1) / self.finest_us } else { 1 };
            for i in 1..n {
                let share = i as f32 / n as f32;
                take(&between(before, after, share, before.t_us + span_us * i / n))?;
            }
            return take(&self.alone(after));
        };
        let most = (span_us + self.finest_us - 1) / self.finest_us;
        let n = ((moved_px(&first, &last) / MAX_STEP_PX).ceil() as i64).clamp(1, most);
        for i in 1..n {
            let (t_us, share) = (before.t_us + span_us * i / n, i as f32 / n as f32);
            if let Some(frame) = self.made(&first, &last, share, t_us) {
                take(&frame)?;
            }
        }
        take(&self.alone(after))
    }

    fn shot<'a>(&self, frame: &'a Luminance) -> Option<FramePose<'a>> {
        FramePose::new(self.path.as_ref(), frame, self.rows)
    }

    fn straighten(&mut self, size: Size) {
        if self.nodes.as_ref().is_some_and(|(known, _)| *known == size) {
            return;
        }
        let path = &self.path;
        let ideal = |pixel: [f64; 2]| match path.has_distortion() {
            true => path.undistort(pixel).unwrap_or([f64::NAN; 2]),
            false => pixel,
        };
        self.nodes = Some((size, PixelMesh::pixels(size).map(ideal).collect()));
    }

    /// What the camera would have seen at one instant; none where the plane's place is not known.
    fn made(&self, first: &FramePose<'_>, last: &FramePose<'_>, share: f32, t_us: i64) -> Option<Luminance> {
        let plane_from_pixel = self.path.pixel_from_plane(t_us as f64)?.inverse()?;
        let size = first.frame.size;
        let (_, nodes) = self.nodes.as_ref().filter(|(known, _)| *known == size)?;
        let ways = [first, last].map(|shot| FrameMapping::new(&plane_from_pixel, shot, self.rows.at_row));
        let meshes = [&ways[0], &ways[1]].map(|way| {
            let find = |ideal: &[f64; 2]| {
                let found = way.find(*ideal);
                if self.path.has_distortion() { self.path.distort(found) } else { found }
            };
            PixelMesh::new(size, nodes.iter().map(find))
        });
        let mut values = vec![0.0; size.n_pixels()];
        let width = usize::from(size.width).max(1);
        values.par_chunks_mut(width).with_min_len(MIN_ROWS_PER_TASK).enumerate().for_each(|(y, row)| {
            for (cell, part) in row.chunks_mut(NODE_SPACING_PX).enumerate() {
                let lines = [meshes[0].line(cell, y), meshes[1].line(cell, y)];
                for (k, value) in part.iter_mut().enumerate() {
                    let look = |way: usize| ways[way].picture.at(lines[way].at(k));
                    *value = match (look(0), if share == 0.0 { None } else { look(1) }) {
                        (Some(a), Some(b)) => a + (b - a) * share,
                        (Some(one), None) | (None, Some(one)) => one,
                        (None, None) => {
                            let i = y * width + cell * NODE_SPACING_PX + k;
                            let [a, b] = [first, last].map(|shot| shot.frame.values[i]);
                            a + (b - a) * share
                        }
                    };
                }
            }
        });
        Some(Luminance { t_us, size, values })
    }
}

/// From ideal pixels at one instant to those of a frame, row-true.
struct FrameMapping<'a> {
    picture: CubicSampler<'a>,
    /// By the time of the first, the stated and the last row.
    rows: [Homography; 3],
    at_row: f64,
    height: f64,
    is_rolling: bool,
}

impl<'a> FrameMapping<'a> {
    fn new(plane_from_pixel: &Homography, shot: &FramePose<'a>, at_row: f64) -> Self {
        Self {
            picture: CubicSampler::new(shot.frame),
            rows: [0, 1, 2].map(|i| plane_from_pixel.then(&shot.rows[i])),
            at_row,
            height: f64::from(shot.frame.size.height),
            is_rolling: shot.rows[0] != shot.rows[1] || shot.rows[2] != shot.rows[1],
        }
    }

    fn find(&self, pixel: [f64; 2]) -> [f64; 2] {
        let stated = self.rows[1].apply(pixel);
        if !self.is_rolling {
            return stated;
        }
        // The row is known to a fraction of a pixel, its time to microseconds: one round is enough.
        let rows = stated[1] - 0.5 - self.at_row;
        let (end, share) = if rows < 0.0 {
            (self.rows[0].apply(pixel), rows / -self.at_row.max(1.0))
        } else {
            (self.rows[2].apply(pixel), rows / (self.height - self.at_row).max(1.0))
        };
        [0, 1].map(|i| stated[i] + (end[i] - stated[i]) * share.min(1.0))
    }
}

/// How far the plane moves at most between two shots, pixels: judged at corners and middle.
fn moved_px(first: &FramePose<'_>, last: &FramePose<'_>) -> f64 {
    let [width, height] = [first.frame.size.width, first.frame.size.height].map(f64::from);
    let places = [[0.5, 0.5], [0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]];
    let Some(back) = first.rows[1].inverse() else { return f64::INFINITY };
    let way = back.then(&last.rows[1]);
    let moved = places.map(|[u, v]| {
        let from = [u * width, v * height];
        let to = way.apply(from);
        (to[0] - from[0]).hypot(to[1] - from[1])
    });
    moved.into_iter().fold(0.0, f64::max)
}

/// The middle of a pixel of a row-major number.
fn middle(size: Size, pixel: usize) -> [f64; 2] {
    let width = usize::from(size.width).max(1);
    [(pixel % width) as f64 + 0.5, (pixel / width) as f64 + 0.5]
}

#[cfg(test)]
mod tests;
