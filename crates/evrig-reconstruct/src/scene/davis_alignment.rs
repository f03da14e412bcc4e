//! Spatial and temporal alignment of the event camera to the path of the head.

use super::head::{DavisMount, HeadGeometry, MOUNT_DOF};
use super::path::HeadPath;
use super::warp::Warp;
use evrig_core::time::{ClockMap, Davis, PiSensor, Span, Stamp};
use nalgebra::Matrix3;
use serde::{Deserialize, Serialize};

/// Alignment of the DAVIS to the path of the head.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct DavisAlignment {
    /// Pose relative to the Pi camera, and lens.
    pub mount: DavisMount,
    /// Clock map before the refinement.
    pub pi_from_davis: ClockMap<PiSensor, Davis>,
    /// Correction of a mapped time at `lag_at_s`, seconds.
    pub lag_s: f64,
    /// Change of the correction per second since `lag_at_s`.
    pub skew: f64,
    /// Time on the path at which `lag_s` holds, seconds.
    pub lag_at_s: f64,
}

/// Steps of the numerical derivatives by rotation, offset and time.
const DERIVATIVE_STEPS: [f64; MOUNT_DOF + 1] = [1e-5, 1e-5, 1e-5, 1e-3, 1e-3, 1e-3, 1e-4];

impl DavisAlignment {
    /// Path time of a DAVIS stamp by the unrefined clock map, seconds.
    pub(super) fn mapped_s(&self, path: &HeadPath, stamp: Stamp<Davis>) -> f64 {
        (self.pi_from_davis.map(stamp) - path.zero).as_secs_f64()
    }

    /// Refined path time of such a time, seconds.
    pub(super) fn path_s(&self, mapped_s: f64) -> f64 {
        mapped_s + self.lag_s + self.skew * (mapped_s - self.lag_at_s)
    }

    /// DAVIS stamp of a path time.
    pub(super) fn stamp(&self, path: &HeadPath, path_s: f64) -> Stamp<Davis> {
        let mapped_s = (path_s - self.lag_s + self.skew * self.lag_at_s) / (1.0 + self.skew);
        self.pi_from_davis.inverse().map(path.zero + Span::from_secs_f64(mapped_s))
    }

    /// From rays of the DAVIS to millimetres on the target at a path time.
    pub(super) fn plane_from_ray(
        &self,
        head: &HeadGeometry,
        path: &HeadPath,
        path_s: f64,
    ) -> Option<Matrix3<f64>> {
        let pi = head.pi_from_plane(&path.pose(path_s)?);
        self.mount.davis_from_plane(&pi).try_inverse()
    }

    /// The same with its derivatives by rotation, offset and time.
    pub(super) fn warp(
        &self,
        head: &HeadGeometry,
        path: &HeadPath,
        path_s: f64,
    ) -> Option<Warp<{ MOUNT_DOF + 1 }>> {
        let (pose, speed) = (path.pose(path_s)?, path.speed(path_s));
        Warp::new(&DERIVATIVE_STEPS, |by| {
            let later = std::array::from_fn(|i| pose[i] + speed[i] * by[MOUNT_DOF]);
            let pi = head.pi_from_plane(&later);
            let mount = self.mount.moved(&std::array::from_fn(|i| by[i]));
            mount.davis_from_plane(&pi).try_inverse()
        })
    }
}
