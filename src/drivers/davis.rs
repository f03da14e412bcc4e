//! Drivers of the event camera, chosen by `davis.transport`.

use super::driver::RecorderDriver;
use evrig_device::davis::{NetworkDavis, NetworkDavisTimeouts, ReplayDavis, ReplaySpeed};
use evrig_record::recorder::Recorder;
use evrig_session::rig::CameraTransport;
use std::path::Path;

pub(super) const KEY: &str = "davis.transport";

pub(super) const TCP: RecorderDriver = RecorderDriver {
    key: KEY,
    values: "tcp://HOST:PORT",
    open: |rig, _, _| {
        let CameraTransport::Tcp(address) = &rig.davis.camera.transport else { return None };
        Some(Ok(Box::new(NetworkDavis::new(address, NetworkDavisTimeouts::default()))))
    },
};

pub(super) const FILE: RecorderDriver = RecorderDriver {
    key: KEY,
    values: "file:PATH",
    open: |rig, options, _| {
        let CameraTransport::File(path) = &rig.davis.camera.transport else { return None };
        Some(Ok(replay(Path::new(path), options.replay_speed)))
    },
};

#[cfg(feature = "usb")]
pub(super) const USB: RecorderDriver = RecorderDriver {
    key: KEY,
    values: "usb",
    open: |rig, _, _| {
        let is_usb = rig.davis.camera.transport == CameraTransport::Usb;
        is_usb.then(|| Ok(Box::new(evrig_device::davis::UsbDavis::new(&rig.davis)) as _))
    },
};

#[cfg(not(feature = "usb"))]
pub(super) const USB: RecorderDriver = RecorderDriver {
    key: KEY,
    values: "usb (in an evrig built with `--features usb`)",
    open: |rig, _, _| {
        let not_built = super::DriverError::NotBuilt { key: KEY, found: "usb", feature: "usb" };
        (rig.davis.camera.transport == CameraTransport::Usb).then_some(Err(not_built))
    },
};

pub(super) fn replay(path: &Path, speed: Option<f64>) -> Box<dyn Recorder> {
    Box::new(ReplayDavis::new(path, speed.map_or(ReplaySpeed::Unpaced, ReplaySpeed::Times)))
}
