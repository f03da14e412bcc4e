//! Alignment of the event camera from the tag in its frames.

use super::davis::DavisTie;
use super::error::SceneError;
use super::head::{DavisMount, Head};
use super::path::HeadPath;
use crate::roi::{Sighting, TargetPlane};
use evrig_core::time::{ClockMap, Davis, PiSensor};
use nalgebra::{SMatrix, SVector, Vector3};

/// Rotation, offset, focal length, radial distortion, lag, skew.
pub(super) const TIES: usize = 10;

/// Prior standard deviations for a measured rig: radians, millimetres, shares, seconds. Distance
/// and focal length are nearly collinear and are therefore constrained tightly.
pub(super) const MEASURED: [f64; TIES] = [0.1, 0.1, 0.1, 2.0, 2.0, 1.0, 0.01, 0.02, 0.1, 2e-5];

/// The same where only the type of rig is known.
pub(super) const OF_ITS_KIND: [f64; TIES] =
    [0.3, 0.3, 0.3, 40.0, 40.0, 20.0, 0.05, 0.05, 1.0, 5e-5];

#[derive(Debug, Clone, Copy)]
pub(super) struct Before {
    pub(super) stated: DavisMount,
    /// Prior standard deviations of the parameters.
    pub(super) sigma: [f64; TIES],
}

/// Steps of the numerical derivatives.
const STEPS: [f64; TIES] = [1e-5, 1e-5, 1e-5, 1e-3, 1e-3, 1e-3, 1e-5, 1e-4, 1e-4, 1e-5];

/// Fewest detections.
const LEAST: usize = 8;

/// Huber threshold of a corner residual, pixels.
const HUBER_PX: f64 = 0.2;

/// Standard deviation of a corner position, pixels.
const CORNER_PX: f64 = 0.05;

/// Parameters of an alignment relative to the nominal ones.
pub(super) fn listed(tie: &DavisTie, stated: &DavisMount) -> SVector<f64, TIES> {
    let mount = &tie.mount;
    let mut list = SVector::zeros();
    for i in 0..3 {
        list[i] = mount.turn_rad[i] - stated.turn_rad[i];
        list[3 + i] = mount.offset_mm[i] - stated.offset_mm[i];
    }
    list[6] = mount.ln_focal;
    list[7] = mount.radial;
    list[8] = tie.lag_s;
    list[9] = tie.skew;
    list
}

pub(super) fn changed(tie: &DavisTie, by: &SVector<f64, TIES>) -> DavisTie {
    let mut mount = tie.mount.moved(&std::array::from_fn(|i| by[i]));
    mount.ln_focal += by[6];
    mount.radial += by[7];
    DavisTie { mount, lag_s: tie.lag_s + by[8], skew: tie.skew + by[9], ..*tie }
}

/// Alignment with the least reprojection error of the tag's corners.
///
/// # Errors
///
/// With too few detections on the path, or when they do not fit.
pub(super) fn tie_by_tag(
    head: &Head,
    path: &HeadPath,
    &Before { stated, sigma }: &Before,
    pi_from_davis: ClockMap<PiSensor, Davis>,
    sightings: &[Sighting<Davis>],
    plane: &TargetPlane,
) -> Result<DavisTie, SceneError> {
    let span = path.span_s().unwrap_or_default();
    let lag_at_s = (span[0] + span[1]) / 2.0;
    let mut tie = DavisTie { mount: stated, pi_from_davis, lag_s: 0.0, skew: 0.0, lag_at_s };
    let no_fit = SceneError::NoFit("the event camera's place by the tag");
    for _ in 0..12 {
        let mut normal = SMatrix::<f64, TIES, TIES>::zeros();
        let mut right = SVector::<f64, TIES>::zeros();
        let list = listed(&tie, &stated);
        for i in 0..TIES {
            normal[(i, i)] += sigma[i].powi(-2);
            right[i] -= list[i] * sigma[i].powi(-2);
        }
        let mut n = 0;
        for sighting in sightings {
            let Some(here) = corners(&tie, head, path, sighting, plane) else { continue };
            let Some(slopes) = slopes(&tie, head, path, sighting, plane) else { continue };
            let left = SVector::<f64, 8>::from_fn(|i, _| sighting.corners_px[i / 2][i % 2]) - here;
            let far = left.norm() / 8.0_f64.sqrt();
            let weight = CORNER_PX.powi(-2) * if far > HUBER_PX { HUBER_PX / far } else { 1.0 };
            normal += weight * slopes.transpose() * slopes;
            right += weight * slopes.transpose() * left;
            n += 1;
        }
        if n < LEAST {
            let (what, found, needed) = ("sightings of the tag", n, LEAST);
            return Err(SceneError::NoDavis { what, found, n: sightings.len(), needed });
        }
        let change = normal.cholesky().ok_or_else(|| no_fit.clone())?.solve(&right);
        tie = changed(&tie, &change);
        if (0..TIES).all(|i| change[i].abs() < 1e-5 * MEASURED[i]) {
            return Ok(tie);
        }
    }
    Ok(tie)
}

/// Predicted corners of a detection.
fn corners(
    tie: &DavisTie,
    head: &Head,
    path: &HeadPath,
    sighting: &Sighting<Davis>,
    plane: &TargetPlane,
) -> Option<SVector<f64, 8>> {
    let mut predicted = SVector::<f64, 8>::zeros();
    let corners = plane.tag_corners_mm().into_iter().zip(sighting.corner_delays);
    for (i, (corner, delay)) in corners.enumerate() {
        let time_s = tie.path_s(tie.mapped_s(path, sighting.time + delay));
        let matrix = tie.mount.davis_from_plane(&head.pi_from_plane(&path.pose(time_s)?));
        let q = matrix * Vector3::new(corner[0], corner[1], 1.0);
        let place = tie.mount.place([q.x / q.z, q.y / q.z]);
        predicted[2 * i] = place[0];
        predicted[2 * i + 1] = place[1];
    }
    predicted.iter().all(|part| part.is_finite()).then_some(predicted)
}

fn slopes(
    tie: &DavisTie,
    head: &Head,
    path: &HeadPath,
    sighting: &Sighting<Davis>,
    plane: &TargetPlane,
) -> Option<SMatrix<f64, 8, TIES>> {
    let mut slopes = SMatrix::<f64, 8, TIES>::zeros();
    for (i, step) in STEPS.into_iter().enumerate() {
        let side = |by: f64| {
            let mut list = SVector::<f64, TIES>::zeros();
            list[i] = by;
            corners(&changed(tie, &list), head, path, sighting, plane)
        };
        slopes.set_column(i, &((side(step)? - side(-step)?) / (2.0 * step)));
    }
    Some(slopes)
}
