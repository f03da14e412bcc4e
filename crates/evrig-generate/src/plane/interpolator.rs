//! Frames between frames along the motion of a plane.

use super::frame_mapping::{FrameMapping, FramePose};
use super::mesh::{NODE_SPACING_PX, PixelMesh};
use super::path::PlanePath;
use crate::interpolate::{Interpolator, between};
use crate::parameter_error::{ParameterError, check};
use crate::rows::RowTimes;
use evrig_core::frame::Luminance;
use evrig_core::geometry::Size;
use rayon::prelude::*;

/// Largest motion of the plane between two output frames, pixels.
const MAX_STEP_PX: f64 = 0.25;

/// Fewest rows of a parallel task.
const MIN_ROWS_PER_TASK: usize = 16;

/// Inserts frames between frames along the motion of a plane.
pub struct PlaneInterpolator {
    finest_us: i64,
    path: Box<dyn PlanePath>,
    rows: RowTimes,
    /// Ideal pixels of the mesh's nodes in frames of this size; `NaN` where distortion has no
    /// inverse.
    nodes: Option<(Size, Vec<[f64; 2]>)>,
    before: Option<Luminance>,
    n_in_place: u64,
}

impl PlaneInterpolator {
    /// Output frames are no closer than `finest_us`, 10 to 1,000,000, and no closer than a quarter
    /// of a pixel of the plane's motion.
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

    /// Sets the exposure times of the rows of the following frames.
    pub fn set_rows(&mut self, rows: RowTimes) {
        self.rows = rows;
    }

    /// Intervals filled pixel by pixel because the plane's motion was unknown.
    #[must_use]
    pub const fn n_in_place(&self) -> u64 {
        self.n_in_place
    }

    /// Passes the frames after the previous one up to this one to `take`, each of one instant.
    /// Where the plane's motion is unknown, as [`Interpolator::push`].
    ///
    /// # Errors
    /// Errors of `take`.
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

    /// The image at one instant; none where the plane's pose is unknown.
    fn made(
        &self,
        first: &FramePose<'_>,
        last: &FramePose<'_>,
        share: f32,
        t_us: i64,
    ) -> Option<Luminance> {
        let plane_from_pixel = self.path.pixel_from_plane(t_us as f64)?.inverse()?;
        let size = first.frame.size;
        let (_, nodes) = self.nodes.as_ref().filter(|(known, _)| *known == size)?;
        let ways =
            [first, last].map(|shot| FrameMapping::new(&plane_from_pixel, shot, self.rows.at_row));
        let meshes = [&ways[0], &ways[1]].map(|way| {
            let find = |ideal: &[f64; 2]| {
                let found = way.find(*ideal);
                if self.path.has_distortion() { self.path.distort(found) } else { found }
            };
            PixelMesh::new(size, nodes.iter().map(find))
        });
        let mut values = vec![0.0; size.n_pixels()];
        let width = usize::from(size.width).max(1);
        values.par_chunks_mut(width).with_min_len(MIN_ROWS_PER_TASK).enumerate().for_each(
            |(y, row)| {
                for (cell, part) in row.chunks_mut(NODE_SPACING_PX).enumerate() {
                    let lines = [meshes[0].line(cell, y), meshes[1].line(cell, y)];
                    for (k, value) in part.iter_mut().enumerate() {
                        let look = |way: usize| ways[way].image.at(lines[way].at(k));
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
            },
        );
        Some(Luminance { t_us, size, values })
    }
}

/// Largest motion of the plane between two frames at corners and centre, pixels.
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
