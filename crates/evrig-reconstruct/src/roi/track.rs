//! Track: pose of the target at any time, with its error.

use super::detection::{LossReason, TagDetection, TrackTally};
use super::lens::Lens;
use super::path_state::{M, Numbers, PathChart, SHAPE};
use super::smoother::StateEstimate;
use super::target::TargetPlane;
use evrig_core::geometry::{Homography, UncertainHomography};
use evrig_core::time::{Clock, Span, Stamp};
use evrig_core::units::{Degrees, Pixels};
use nalgebra::{Matrix2, SMatrix};
use serde::{Deserialize, Serialize};

/// Path of the target through a camera's images.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(bound = "")]
pub struct Track<C: Clock> {
    /// Family and id of the tag.
    pub tag: String,
    /// Geometry of the target.
    pub plane: TargetPlane,
    /// The camera's lens.
    pub lens: Lens,
    /// Frames seen, used, and lost by reason.
    pub tally: TrackTally,
    /// Every lost frame, in order.
    pub losses: Vec<LostFrame<C>>,
    /// Gaps between detections that are not interpolated.
    pub gaps: Vec<TrackGap<C>>,
    /// The detections of the path, one for each knot.
    #[serde(alias = "sightings")]
    pub detections: Vec<TagDetection<C>>,
    /// The path at the detections' times, ascending.
    pub knots: Vec<TrackKnot<C>>,
    /// Goodness of fit.
    pub quality: TrackQuality,
}

/// A frame without a usable detection.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(bound = "")]
pub struct LostFrame<C: Clock> {
    /// Index of the frame among those given, from 0.
    pub frame: u64,
    /// Its time.
    pub time: Stamp<C>,
    /// Why.
    pub reason: LossReason,
}

/// A gap that is not interpolated.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(bound = "")]
pub struct TrackGap<C: Clock> {
    /// The last detection before it.
    pub from: Stamp<C>,
    /// The first after it.
    pub to: Stamp<C>,
}

/// The path at one time, in the parameters of `roi::state`: a similarity from the tag's half sides
/// to pixels with speed and acceleration, and the shape applied after it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(bound = "")]
pub struct TrackKnot<C: Clock> {
    /// When.
    pub time: Stamp<C>,
    /// Scaled rotation and translation; per second; per second squared. Pixels.
    pub similarity: [[f64; 4]; 3],
    /// Foreshortening and tilt.
    pub shape: [f64; 4],
    /// Covariance of similarity and shape, row-major.
    pub covariance: [[f64; 8]; 8],
}

/// Goodness of fit of a path.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct TrackQuality {
    /// Root-mean-square distance of the detected corners from the path, ideal pixels.
    pub corner_rms_px: f64,
    /// Factor by which the corners' stated variances were too small; the path's error includes it.
    pub variance_factor: f64,
    /// Density of the jerk of the tag's scale and rotation, px^2/s^5.
    pub turn_jerk: f64,
    /// Density of the jerk of the tag's translation, px^2/s^5.
    pub shift_jerk: f64,
    /// Longest gap that is interpolated.
    pub max_gap: Span,
}

/// Pose of the target at one time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TargetView {
    /// From millimetres on the target to ideal pixels, with its error.
    pub ideal_from_plane: UncertainHomography,
    lens: Lens,
    plane: TargetPlane,
}

/// Region of the target image at one time, in sensor pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Roi {
    /// Bottom left, bottom right, top right and top left of the upright target image.
    pub polygon: [[f64; 2]; 4],
    /// Standard errors of the polygon's corners along x and y.
    pub polygon_errors: [[f64; 2]; 4],
    /// Sensor pixel of the image's centre.
    pub centre: [f64; 2],
    /// Lengths of the centre lines: from left to right and from top to bottom.
    pub size: [Pixels; 2],
    /// Direction of the bottom edge from left to right: 0 is along the rows, positive is clockwise.
    pub angle: Degrees,
    /// Standard error of the angle.
    pub angle_error: Degrees,
}

/// Why there is no pose at a time.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum TrackTimeError {
    /// Before the first or after the last detection.
    #[error(
        "the track runs from {from_us} to {to_us} us of its clock; it has no pose at {at_us} us"
    )]
    Outside {
        /// The requested time.
        at_us: i64,
        /// The first detection.
        from_us: i64,
        /// The last detection.
        to_us: i64,
    },
    /// In a gap.
    #[error(
        "no detection of the tag from {from_us} to {to_us} us, longer than the maximum gap of \
         {limit}; the track has no pose at {at_us} us"
    )]
    TrackGap {
        /// The requested time.
        at_us: i64,
        /// The last detection before it.
        from_us: i64,
        /// The first after it.
        to_us: i64,
        /// Longest gap that is interpolated.
        limit: Span,
    },
    /// The stored parameters are no valid path.
    #[error("the track is invalid at {0} us: the file may be damaged, run `evrig track` again")]
    Broken(i64),
}

impl<C: Clock> Track<C> {
    /// The pose at a time, up to one frame's rows outside the first and last detection.
    ///
    /// # Errors
    /// When the time lies outside the track or in a gap.
    pub fn at(&self, time: Stamp<C>) -> Result<TargetView, TrackTimeError> {
        let at_us = time.as_micros();
        let (Some(first), Some(last)) = (self.knots.first(), self.knots.last()) else {
            return Err(TrackTimeError::Outside { at_us, from_us: 0, to_us: 0 });
        };
        let (from_us, to_us) = (first.time.as_micros(), last.time.as_micros());
        let after = self.knots.partition_point(|knot| knot.time < time);
        let (numbers, covariance) = match (after.checked_sub(1), self.knots.get(after)) {
            (_, Some(knot)) if knot.time == time => knot.here(),
            (Some(before), Some(knot)) => {
                let previous = &self.knots[before];
                if knot.time - previous.time > self.quality.max_gap {
                    let (from_us, to_us) = (previous.time.as_micros(), knot.time.as_micros());
                    let limit = self.quality.max_gap;
                    return Err(TrackTimeError::TrackGap { at_us, from_us, to_us, limit });
                }
                interpolate(previous, knot, time, &self.quality)
            }
            _ => return Err(TrackTimeError::Outside { at_us, from_us, to_us }),
        };
        let chart = PathChart::new(&self.lens, &self.plane);
        let ideal_from_plane = chart.uncertain(&numbers, &covariance);
        let is_sound = ideal_from_plane.homography.inverse().is_some();
        let view = TargetView { ideal_from_plane, lens: self.lens, plane: self.plane };
        is_sound.then_some(view).ok_or(TrackTimeError::Broken(at_us))
    }

    /// First and last time of the path.
    #[must_use]
    pub fn span(&self) -> Option<[Stamp<C>; 2]> {
        Some([self.knots.first()?.time, self.knots.last()?.time])
    }
}

impl<C: Clock> TrackKnot<C> {
    pub(super) fn of(time: Stamp<C>, estimate: &StateEstimate) -> Self {
        let mean = &estimate.mean;
        let place = |i: usize| if i < 4 { i } else { SHAPE + i - 4 };
        let covariance = |i, j| estimate.covariance[(place(i), place(j))];
        Self {
            time,
            similarity: std::array::from_fn(|order| std::array::from_fn(|i| mean[4 * order + i])),
            shape: std::array::from_fn(|i| mean[SHAPE + i]),
            covariance: std::array::from_fn(|i| std::array::from_fn(|j| covariance(i, j))),
        }
    }

    fn here(&self) -> (Numbers, SMatrix<f64, M, M>) {
        let mut numbers = Numbers::zeros();
        for i in 0..4 {
            numbers[i] = self.similarity[0][i];
            numbers[4 + i] = self.shape[i];
        }
        (numbers, SMatrix::from_fn(|row, column| self.covariance[row][column]))
    }
}

/// The path between two knots.
///
/// The mean is exact: under white jerk it is the quintic Hermite polynomial of position, speed and
/// acceleration at both ends. The covariance is interpolated between the knots, plus the variance
/// of the jerk between two known states: density T^5 (s (1 - s))^5 / 20.
fn interpolate<C: Clock>(
    before: &TrackKnot<C>,
    after: &TrackKnot<C>,
    time: Stamp<C>,
    quality: &TrackQuality,
) -> (Numbers, SMatrix<f64, M, M>) {
    let length = (after.time - before.time).as_secs_f64();
    let s = (time - before.time).as_secs_f64() / length;
    let ((mut numbers, start), (end_numbers, end)) = (before.here(), after.here());
    let r = 1.0 - s;
    // Quintic Hermite basis for position, speed and acceleration at one end.
    let basis = |near: f64, far: f64| {
        [
            far.powi(3) * (1.0 + 3.0 * near + 6.0 * near * near),
            near * far.powi(3) * (1.0 + 3.0 * near) * length,
            near * near * far.powi(3) / 2.0 * length * length,
        ]
    };
    let (left, right) = (basis(s, r), basis(r, s));
    for i in 0..4 {
        numbers[i] = (0..3)
            .map(|order| {
                // Speed changes sign with the direction of time.
                let sign = if order == 1 { -1.0 } else { 1.0 };
                left[order] * before.similarity[order][i]
                    + sign * right[order] * after.similarity[order][i]
            })
            .sum();
        numbers[4 + i] = r * numbers[4 + i] + s * end_numbers[4 + i];
    }
    let mut covariance = start * r + end * s;
    let bridge = length.powi(5) * (s * r).powi(5) / 20.0;
    for i in 0..4 {
        let density = if i < 2 { quality.turn_jerk } else { quality.shift_jerk };
        covariance[(i, i)] += density * bridge;
    }
    (numbers, covariance)
}

impl TargetView {
    /// From millimetres on the target to ideal pixels.
    #[must_use]
    pub fn homography(&self) -> &Homography {
        &self.ideal_from_plane.homography
    }

    /// Sensor pixel of a target position in millimetres.
    #[must_use]
    pub fn pixel(&self, place_mm: [f64; 2]) -> [f64; 2] {
        self.lens.distort(self.homography().apply(place_mm))
    }

    /// Ideal pixel of a target position, with its covariance.
    #[must_use]
    pub fn ideal_pixel(&self, place_mm: [f64; 2]) -> ([f64; 2], Matrix2<f64>) {
        self.ideal_from_plane.apply(place_mm)
    }

    /// Target position of a sensor pixel, millimetres; None beyond the horizon or the lens.
    #[must_use]
    pub fn place_mm(&self, pixel: [f64; 2]) -> Option<[f64; 2]> {
        let place = self.homography().inverse()?.apply(self.lens.undistort(pixel)?);
        place.iter().all(|part| part.is_finite()).then_some(place)
    }

    /// The region of the target image.
    #[must_use]
    pub fn roi(&self) -> Roi {
        let corners = self.plane.picture_corners_mm();
        let polygon = corners.map(|corner| self.pixel(corner));
        let polygon_errors = corners.map(|corner| {
            let covariance = self.ideal_pixel(corner).1;
            [covariance[(0, 0)].max(0.0).sqrt(), covariance[(1, 1)].max(0.0).sqrt()]
        });
        let middle = |i: usize, j: usize| {
            let [a, b] = [corners[i], corners[j]];
            self.pixel([(a[0] + b[0]) / 2.0, (a[1] + b[1]) / 2.0])
        };
        let distance = |a: [f64; 2], b: [f64; 2]| Pixels((b[0] - a[0]).hypot(b[1] - a[1]));
        let [left, right] = [polygon[0], polygon[1]];
        let along = [right[0] - left[0], right[1] - left[1]];
        Roi {
            polygon,
            polygon_errors,
            centre: self.pixel(self.plane.picture_centre_mm()),
            size: [distance(middle(0, 3), middle(1, 2)), distance(middle(3, 2), middle(0, 1))],
            angle: Degrees(along[1].atan2(along[0]).to_degrees()),
            angle_error: Degrees(self.angle_error(corners[0], corners[1]).to_degrees()),
        }
    }

    /// Standard error of the direction between two target positions, radians.
    fn angle_error(&self, from_mm: [f64; 2], to_mm: [f64; 2]) -> f64 {
        let direction = |h: &Homography| {
            let [a, b] = [h.apply(from_mm), h.apply(to_mm)];
            (b[1] - a[1]).atan2(b[0] - a[0])
        };
        let here = direction(self.homography());
        let elements: [[f64; 3]; 3] = (*self.homography()).into();
        // Numerical derivatives by the nine elements, each with a step in proportion to its error.
        let gradient = nalgebra::SVector::<f64, 9>::from_fn(|i, _| {
            let step = 1e-3 * self.ideal_from_plane.covariance[(i, i)].max(0.0).sqrt();
            if step == 0.0 {
                return 0.0;
            }
            let mut moved = elements;
            moved[i / 3][i % 3] += step;
            let turn = direction(&Homography::from(moved)) - here;
            turn.sin().atan2(turn.cos()) / step
        });
        gradient.dot(&(self.ideal_from_plane.covariance * gradient)).max(0.0).sqrt()
    }
}
