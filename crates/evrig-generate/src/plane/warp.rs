//! Frames of one camera on the pixel grid of another that sees the same plane.

use super::frame_mapping::{FrameMapping, FramePose};
use super::path::PlanePath;
use super::sample::CubicSampler;
use crate::grid::pixel_centre;
use crate::rows::RowTimes;
use evrig_core::frame::Luminance;
use evrig_core::geometry::Size;
use rayon::prelude::*;

/// Most samples along each side of a pixel.
const MAX_SAMPLES_PER_SIDE: f64 = 8.0;

/// Warps frames onto another camera's pixel grid at the frame's time.
///
/// A pixel gets the mean over its square. Rows of a rolling shutter are found at their own times.
pub struct PlaneWarper {
    from: Box<dyn PlanePath>,
    to: Box<dyn PlanePath>,
    size: Size,
    /// Ideal pixels of the middles of the other camera's; `NaN` where distortion has no inverse.
    ideal: Vec<[f64; 2]>,
}

impl PlaneWarper {
    /// From the frames of one camera to a grid of `size` of another, on one clock.
    #[must_use]
    pub fn new(from: Box<dyn PlanePath>, to: Box<dyn PlanePath>, size: Size) -> Self {
        let ideal = |i: usize| {
            let pixel = pixel_centre(size, i);
            if to.has_distortion() { to.undistort(pixel).unwrap_or([f64::NAN; 2]) } else { pixel }
        };
        let ideal = (0..size.n_pixels()).map(ideal).collect();
        Self { from, to, size, ideal }
    }

    /// The frame on the other camera's grid; `NaN` outside the frame or where its pixels are `NaN`.
    /// None where the plane's pose is unknown.
    #[must_use]
    pub fn warp(&self, frame: &Luminance, rows: RowTimes) -> Option<Luminance> {
        let t_us = frame.t_us as f64;
        let plane_from_pixel = self.to.pixel_from_plane(t_us)?.inverse()?;
        let shot = FramePose::new(self.from.as_ref(), frame, rows)?;
        let way = FrameMapping::new(&plane_from_pixel, &shot, rows.at_row);
        let find = |ideal: [f64; 2]| {
            let found = way.find(ideal);
            if self.from.has_distortion() { self.from.distort(found) } else { found }
        };
        let mut values = vec![f32::NAN; self.size.n_pixels()];
        values.par_iter_mut().zip(&self.ideal).with_min_len(1 << 12).for_each(|(value, &ideal)| {
            let at = find(ideal);
            let step = |to: [f64; 2]| {
                let there = find([ideal[0] + to[0], ideal[1] + to[1]]);
                [there[0] - at[0], there[1] - at[1]]
            };
            *value = mean(way.image, at, [step([1.0, 0.0]), step([0.0, 1.0])]);
        });
        Some(Luminance { t_us: frame.t_us, size: self.size, values })
    }
}

/// The mean over the parallelogram about a place; `NaN` where any of it lies outside.
fn mean(image: CubicSampler<'_>, at: [f64; 2], [right, down]: [[f64; 2]; 2]) -> f32 {
    let looks = |side: [f64; 2]| side[0].hypot(side[1]).ceil().clamp(1.0, MAX_SAMPLES_PER_SIDE);
    let (n, m) = (looks(right), looks(down));
    let (mut sum, mut count) = (0.0, 0.0_f32);
    for i in 0..n as usize {
        for j in 0..m as usize {
            let (a, b) = ((i as f64 + 0.5) / n - 0.5, (j as f64 + 0.5) / m - 0.5);
            let place = [0, 1].map(|k| (at[k] + a * right[k] + b * down[k]) as f32);
            let Some(value) = image.at(place) else { return f32::NAN };
            sum += value;
            count += 1.0;
        }
    }
    sum / count
}

#[cfg(test)]
mod tests {
    use super::*;
    use evrig_core::geometry::Homography;

    /// A camera that sees the print larger by a factor, shifted, and moving to the right.
    struct Camera {
        scale: f64,
        shift: f64,
    }

    impl PlanePath for Camera {
        fn pixel_from_plane(&self, t_us: f64) -> Option<Homography> {
            let x = self.scale * (self.shift + 5e-5 * t_us);
            let rows = [[self.scale, 0.0, x], [0.0, self.scale, 4.0 * self.scale], [0.0, 0.0, 1.0]];
            (t_us < 1e6).then(|| Homography::from(rows))
        }
    }

    fn print(x: f64, y: f64) -> f64 {
        100.0 + 40.0 * (0.6 * x).sin() + 20.0 * (0.4 * y + 0.3 * x).cos()
    }

    #[test]
    fn the_coarse_camera_sees_the_fine_ones_frame_at_one_instant() {
        let (fine, coarse) =
            (|| Camera { scale: 3.0, shift: 12.0 }, || Camera { scale: 1.0, shift: 6.0 });
        let (size, small) = (Size::new(150, 120), Size::new(60, 50));
        let rows = RowTimes::about_middle(50.0, size);
        let t_us = 40_000_i64;
        // The fine camera's pixels see the print at places, its rows one after another.
        let value = |i: usize| {
            let [u, v] = pixel_centre(size, i);
            let at = t_us as f64 + rows.after_us(v - 0.5);
            let back = fine().pixel_from_plane(at).unwrap().inverse().unwrap();
            let [x, y] = back.apply([u, v]);
            print(x, y) as f32
        };
        let values = (0..size.n_pixels()).map(value).collect();
        let frame = Luminance { t_us, size, values };
        let warper = PlaneWarper::new(Box::new(fine()), Box::new(coarse()), small);
        let seen = warper.warp(&frame, rows).unwrap();
        let back = coarse().pixel_from_plane(t_us as f64).unwrap().inverse().unwrap();
        let (mut n_known, mut squares) = (0_u32, 0.0);
        for (i, value) in seen.values.iter().enumerate().filter(|(_, value)| value.is_finite()) {
            let [u, v] = pixel_centre(small, i);
            let looks: f64 = (0..100)
                .map(|k| {
                    let (a, b) = (f64::from(k % 10), f64::from(k / 10));
                    let place = back.apply([u + a / 10.0 - 0.45, v + b / 10.0 - 0.45]);
                    print(place[0], place[1])
                })
                .sum();
            n_known += 1;
            let apart = f64::from(*value) - looks / 100.0;
            squares += apart * apart;
            // Beside the frame's edge the cubic has no neighbours.
            assert!(apart.abs() < 1.5, "{value} {}", looks / 100.0);
        }
        assert!((squares / f64::from(n_known)).sqrt() < 0.1, "{squares} {n_known}");
        assert!(n_known > 500 && (n_known as usize) < small.n_pixels(), "{n_known}");
        assert!(warper.warp(&Luminance { t_us: 1_000_000, ..frame }, rows).is_none());
    }
}
