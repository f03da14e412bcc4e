//! Alignment of the event camera from the tag in its frames.

use super::davis_alignment::DavisAlignment;
use super::error::SceneError;
use super::head::{DavisMount, HeadGeometry};
use super::path::HeadPath;
use crate::roi::{TagDetection, TargetPlane};
use evrig_core::time::{ClockMap, Davis, PiSensor};
use nalgebra::{SMatrix, SVector, Vector3};

/// Rotation, offset, focal length, radial distortion, lag, skew.
pub(super) const ALIGNMENT_DOF: usize = 10;

/// Prior standard deviations for a measured rig: radians, millimetres, shares, seconds. Distance
/// and focal length are nearly collinear and are therefore constrained tightly.
pub(super) const MEASURED_SIGMA: [f64; ALIGNMENT_DOF] =
    [0.1, 0.1, 0.1, 2.0, 2.0, 1.0, 0.01, 0.02, 0.1, 2e-5];

/// The same where only the type of rig is known.
pub(super) const NOMINAL_SIGMA: [f64; ALIGNMENT_DOF] =
    [0.3, 0.3, 0.3, 40.0, 40.0, 20.0, 0.05, 0.05, 1.0, 5e-5];

#[derive(Debug, Clone, Copy)]
pub(super) struct AlignmentPrior {
    pub(super) stated: DavisMount,
    pub(super) sigma: [f64; ALIGNMENT_DOF],
}

/// Steps of the numerical derivatives.
const DERIVATIVE_STEPS: [f64; ALIGNMENT_DOF] =
    [1e-5, 1e-5, 1e-5, 1e-3, 1e-3, 1e-3, 1e-5, 1e-4, 1e-4, 1e-5];

/// Fewest detections.
const MIN_DETECTIONS: usize = 8;
/// Huber threshold of a corner residual, pixels.
const HUBER_PX: f64 = 0.2;
/// Standard deviation of a corner position, pixels.
const CORNER_PX: f64 = 0.05;

/// Parameters of an alignment relative to the nominal ones.
pub(super) fn parameters_of(
    alignment: &DavisAlignment,
    stated: &DavisMount,
) -> SVector<f64, ALIGNMENT_DOF> {
    let mount = &alignment.mount;
    let mut list = SVector::zeros();
    for i in 0..3 {
        list[i] = mount.turn_rad[i] - stated.turn_rad[i];
        list[3 + i] = mount.offset_mm[i] - stated.offset_mm[i];
    }
    list[6] = mount.ln_focal;
    list[7] = mount.radial;
    list[8] = alignment.lag_s;
    list[9] = alignment.skew;
    list
}

pub(super) fn updated(
    alignment: &DavisAlignment,
    by: &SVector<f64, ALIGNMENT_DOF>,
) -> DavisAlignment {
    let mut mount = alignment.mount.moved(&std::array::from_fn(|i| by[i]));
    mount.ln_focal += by[6];
    mount.radial += by[7];
    DavisAlignment {
        mount,
        lag_s: alignment.lag_s + by[8],
        skew: alignment.skew + by[9],
        ..*alignment
    }
}

/// Alignment with the least reprojection error of the tag's corners.
///
/// # Errors
/// With too few detections on the path, or when they do not fit.
pub(super) fn align_by_tag(
    head: &HeadGeometry,
    path: &HeadPath,
    &AlignmentPrior { stated, sigma }: &AlignmentPrior,
    pi_from_davis: ClockMap<PiSensor, Davis>,
    detections: &[TagDetection<Davis>],
    plane: &TargetPlane,
) -> Result<DavisAlignment, SceneError> {
    let span = path.span_s().unwrap_or_default();
    let lag_at_s = (span[0] + span[1]) / 2.0;
    let mut alignment =
        DavisAlignment { mount: stated, pi_from_davis, lag_s: 0.0, skew: 0.0, lag_at_s };
    let no_fit = SceneError::NoFit("the alignment of the event camera by the tag");
    for _ in 0..12 {
        let mut normal = SMatrix::<f64, ALIGNMENT_DOF, ALIGNMENT_DOF>::zeros();
        let mut right = SVector::<f64, ALIGNMENT_DOF>::zeros();
        let list = parameters_of(&alignment, &stated);
        for i in 0..ALIGNMENT_DOF {
            normal[(i, i)] += sigma[i].powi(-2);
            right[i] -= list[i] * sigma[i].powi(-2);
        }
        let mut n = 0;
        for detection in detections {
            let Some(here) = predict_corners(&alignment, head, path, detection, plane) else {
                continue;
            };
            let Some(corner_derivatives) =
                corner_derivatives(&alignment, head, path, detection, plane)
            else {
                continue;
            };
            let residual =
                SVector::<f64, 8>::from_fn(|i, _| detection.corners_px[i / 2][i % 2]) - here;
            let far = residual.norm() / 8.0_f64.sqrt();
            let weight = CORNER_PX.powi(-2) * if far > HUBER_PX { HUBER_PX / far } else { 1.0 };
            normal += weight * corner_derivatives.transpose() * corner_derivatives;
            right += weight * corner_derivatives.transpose() * residual;
            n += 1;
        }
        if n < MIN_DETECTIONS {
            let (what, found, needed) = ("detections of the tag", n, MIN_DETECTIONS);
            return Err(SceneError::NoDavis { what, found, n: detections.len(), needed });
        }
        let change = normal.cholesky().ok_or_else(|| no_fit.clone())?.solve(&right);
        alignment = updated(&alignment, &change);
        if (0..ALIGNMENT_DOF).all(|i| change[i].abs() < 1e-5 * MEASURED_SIGMA[i]) {
            return Ok(alignment);
        }
    }
    Ok(alignment)
}

fn predict_corners(
    alignment: &DavisAlignment,
    head: &HeadGeometry,
    path: &HeadPath,
    detection: &TagDetection<Davis>,
    plane: &TargetPlane,
) -> Option<SVector<f64, 8>> {
    let mut predicted = SVector::<f64, 8>::zeros();
    let predict_corners = plane.tag_corners_mm().into_iter().zip(detection.corner_delays);
    for (i, (corner, delay)) in predict_corners.enumerate() {
        let time_s = alignment.path_s(alignment.mapped_s(path, detection.time + delay));
        let matrix = alignment.mount.davis_from_plane(&head.pi_from_plane(&path.pose(time_s)?));
        let q = matrix * Vector3::new(corner[0], corner[1], 1.0);
        let place = alignment.mount.place([q.x / q.z, q.y / q.z]);
        predicted[2 * i] = place[0];
        predicted[2 * i + 1] = place[1];
    }
    predicted.iter().all(|part| part.is_finite()).then_some(predicted)
}

fn corner_derivatives(
    alignment: &DavisAlignment,
    head: &HeadGeometry,
    path: &HeadPath,
    detection: &TagDetection<Davis>,
    plane: &TargetPlane,
) -> Option<SMatrix<f64, 8, ALIGNMENT_DOF>> {
    let mut corner_derivatives = SMatrix::<f64, 8, ALIGNMENT_DOF>::zeros();
    for (i, step) in DERIVATIVE_STEPS.into_iter().enumerate() {
        let side = |by: f64| {
            let mut list = SVector::<f64, ALIGNMENT_DOF>::zeros();
            list[i] = by;
            predict_corners(&updated(alignment, &list), head, path, detection, plane)
        };
        corner_derivatives.set_column(i, &((side(step)? - side(-step)?) / (2.0 * step)));
    }
    Some(corner_derivatives)
}
