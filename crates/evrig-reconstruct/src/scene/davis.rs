//! The event camera beside the Pi: where a place of its sensor looks at a time.

use super::head::{DavisMount, Head, MOUNT};
use super::path::HeadPath;
use super::warp::Warp;
use evrig_core::time::{ClockMap, Davis, PiSensor, Span, Stamp};
use nalgebra::Matrix3;
use serde::{Deserialize, Serialize};

/// What ties the DAVIS to the head's path.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct DavisTie {
    /// How it sits, and its lens.
    pub mount: DavisMount,
    /// The clocks as they were known before.
    pub pi_from_davis: ClockMap<PiSensor, Davis>,
    /// What has to be added to a time so mapped, seconds.
    pub lag_s: f64,
    /// And what more for each second since `lag_at_s`.
    pub skew: f64,
    /// Where on the path's time the lag holds.
    pub lag_at_s: f64,
}

/// Steps of turn, offset and time for slopes.
const STEPS: [f64; MOUNT + 1] = [1e-5, 1e-5, 1e-5, 1e-3, 1e-3, 1e-3, 1e-4];

impl DavisTie {
    /// Seconds of the path at a stamp of the DAVIS, as the clocks were known before.
    pub(super) fn mapped_s(&self, path: &HeadPath, stamp: Stamp<Davis>) -> f64 {
        (self.pi_from_davis.map(stamp) - path.zero).as_secs_f64()
    }

    /// Seconds of the path at seconds so mapped.
    pub(super) fn path_s(&self, mapped_s: f64) -> f64 {
        mapped_s + self.lag_s + self.skew * (mapped_s - self.lag_at_s)
    }

    /// The DAVIS's stamp at seconds of the path.
    pub(super) fn stamp(&self, path: &HeadPath, path_s: f64) -> Stamp<Davis> {
        let mapped_s = (path_s - self.lag_s + self.skew * self.lag_at_s) / (1.0 + self.skew);
        self.pi_from_davis.inverse().map(path.zero + Span::from_secs_f64(mapped_s))
    }

    /// From rays of the DAVIS to millimetres on the print at seconds of the path.
    pub(super) fn plane_from_ray(
        &self,
        head: &Head,
        path: &HeadPath,
        path_s: f64,
    ) -> Option<Matrix3<f64>> {
        let pi = head.pi_from_plane(&path.pose(path_s)?);
        self.mount.davis_from_plane(&pi).try_inverse()
    }

    /// The same with its slopes by turn, offset and time.
    pub(super) fn warp(
        &self,
        head: &Head,
        path: &HeadPath,
        path_s: f64,
    ) -> Option<Warp<{ MOUNT + 1 }>> {
        let (pose, speed) = (path.pose(path_s)?, path.speed(path_s));
        Warp::new(&STEPS, |by| {
            let later = std::array::from_fn(|i| pose[i] + speed[i] * by[MOUNT]);
            let pi = head.pi_from_plane(&later);
            let mount = self.mount.moved(&std::array::from_fn(|i| by[i]));
            mount.davis_from_plane(&pi).try_inverse()
        })
    }
}
