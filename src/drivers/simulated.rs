//! Drivers of the simulated cameras, chosen by `sim`.

use super::driver::RecorderDriver;
use super::{davis, pi};
use evrig_core::time::Span;
use evrig_session::rig::CameraTransport;
use evrig_sim::recorder::SimulatedCamera;

/// How long the simulated arm takes to home; a real one takes some fifteen seconds.
pub(super) const HOMING: Span = Span::from_micros(500_000);

pub(super) const DAVIS: RecorderDriver = RecorderDriver {
    key: davis::KEY,
    values: "sim",
    open: |rig, _, world| {
        let world = world.filter(|_| rig.davis.camera.transport == CameraTransport::Sim)?;
        Some(SimulatedCamera::davis(world).map(|it| Box::new(it) as _).map_err(Into::into))
    },
};

pub(super) const PI: RecorderDriver = RecorderDriver {
    key: pi::KEY,
    values: "sim",
    open: |rig, _, world| {
        let world = world.filter(|_| rig.pi.camera.transport == CameraTransport::Sim)?;
        let camera = SimulatedCamera::pi(world, pi::order(rig));
        Some(camera.map(|it| Box::new(it) as _).map_err(Into::into))
    },
};
