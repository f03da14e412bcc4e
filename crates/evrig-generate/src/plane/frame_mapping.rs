//! From ideal pixels at one instant to the pixels of a frame, row by row of a rolling shutter.

use super::path::PlanePath;
use super::sample::CubicSampler;
use crate::rows::RowTimes;
use evrig_core::frame::Luminance;
use evrig_core::geometry::Homography;

/// Where the plane lay while the rows of one frame saw their light.
pub(super) struct FramePose<'a> {
    pub(super) frame: &'a Luminance,
    /// At the time of the first, the stated and the last row.
    pub(super) rows: [Homography; 3],
}

impl<'a> FramePose<'a> {
    pub(super) fn new(path: &dyn PlanePath, frame: &'a Luminance, times: RowTimes) -> Option<Self> {
        let at = |row: f64| path.pixel_from_plane(frame.t_us as f64 + times.after_us(row));
        let stated = at(times.at_row)?;
        // The outermost rows of the first and last frame may lie outside the path.
        let [top, bottom] = [0.0, f64::from(frame.size.height)].map(at);
        let rows = [top.unwrap_or(stated), stated, bottom.unwrap_or(stated)];
        Some(Self { frame, rows })
    }
}

/// From ideal pixels at one instant to those of a frame, row-true.
pub(super) struct FrameMapping<'a> {
    pub(super) image: CubicSampler<'a>,
    /// By the time of the first, the stated and the last row.
    pub(super) rows: [Homography; 3],
    at_row: f64,
    height: f64,
    is_rolling: bool,
}

impl<'a> FrameMapping<'a> {
    pub(super) fn new(plane_from_pixel: &Homography, shot: &FramePose<'a>, at_row: f64) -> Self {
        Self {
            image: CubicSampler::new(shot.frame),
            rows: [0, 1, 2].map(|i| plane_from_pixel.then(&shot.rows[i])),
            at_row,
            height: f64::from(shot.frame.size.height),
            is_rolling: shot.rows[0] != shot.rows[1] || shot.rows[2] != shot.rows[1],
        }
    }

    pub(super) fn find(&self, pixel: [f64; 2]) -> [f64; 2] {
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
