//! Corners in a frame to a detection in time, and to an observation in ideal pixels.

use super::corner_fit::FittedCorners;
use super::detection::TagDetection;
use super::lens::Lens;
use super::path_state::PathChart;
use super::smoother::Observation;
use super::target::TargetPlane;
use evrig_core::frame::Frame;
use evrig_core::geometry::Homography;
use evrig_core::time::{Clock, Span, Stamp};
use nalgebra::{SMatrix, SVector};

/// Delay of a row coordinate's exposure after that of the first row.
fn row_delay(row_time: Span, y: f64) -> Span {
    Span::from_secs_f64(row_time.as_secs_f64() * (y - 0.5).max(0.0))
}

/// The detection of fitted corners, with the time of each corner's row.
pub(super) fn detection<C: Clock>(
    frame: &Frame<C>,
    number: u64,
    corners: &FittedCorners,
) -> TagDetection<C> {
    let row_time = frame.timing.row_time;
    let middle = corners.points.iter().map(|point| point[1]).sum::<f64>() / 4.0;
    let delay = row_delay(row_time, middle);
    let covariance = &corners.covariance;
    TagDetection {
        frame: number,
        time: frame.timing.mid_exposure(0) + delay,
        corners_px: corners.points,
        corner_delays: corners.points.map(|point| row_delay(row_time, point[1]) - delay),
        covariance_px2: std::array::from_fn(|i| std::array::from_fn(|j| covariance[(i, j)])),
        blur_px: corners.blur_px,
    }
}

/// A detection in ideal pixels; None when lens or corners are degenerate.
pub(super) fn observe<C: Clock>(
    detection: &TagDetection<C>,
    zero: Stamp<C>,
    lens: &Lens,
    plane: &TargetPlane,
    chart: &PathChart,
) -> Option<Observation> {
    let mut corners = SVector::<f64, 8>::zeros();
    let mut slope = SMatrix::<f64, 8, 8>::zeros();
    let mut pairs = [([0.0; 2], [0.0; 2]); 4];
    for (i, pixel) in detection.corners_px.into_iter().enumerate() {
        let ideal = lens.undistort(pixel)?;
        pairs[i] = (plane.tag_corners_mm()[i], ideal);
        corners[2 * i] = ideal[0];
        corners[2 * i + 1] = ideal[1];
        slope.fixed_view_mut::<2, 2>(2 * i, 2 * i).copy_from(&lens.undistort_jacobian(pixel)?);
    }
    let covariance =
        SMatrix::<f64, 8, 8>::from_fn(|row, column| detection.covariance_px2[row][column]);
    Some(Observation {
        at_s: (detection.time - zero).as_secs_f64(),
        delays_s: detection.corner_delays.map(Span::as_secs_f64),
        corners,
        covariance: slope * covariance * slope.transpose(),
        numbers: chart.numbers(&Homography::fit(&pairs).ok()?)?,
        is_start: false,
    })
}
