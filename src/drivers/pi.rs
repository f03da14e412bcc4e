//! The driver of the frame camera behind its agent, chosen by `pi.transport`.

use super::driver::RecorderDriver;
use evrig_device::pi::{AgentAddress, NetworkPi, PiTimeouts};
use evrig_pi::keys;
use evrig_pi::order::{CaptureOrder, CaptureSettings, Delivery};
use evrig_session::rig::{CameraTransport, Rig};
use std::path::PathBuf;

pub(super) const KEY: &str = "pi.transport";

pub(super) const AGENT: RecorderDriver = RecorderDriver {
    key: KEY,
    values: "tls://HOST:PORT of an agent, tcp://HOST:PORT on this machine",
    open: |rig, _, _| {
        let address = match &rig.pi.camera.transport {
            CameraTransport::Tcp(address) => AgentAddress::Local { address: address.clone() },
            CameraTransport::Tls(address) => {
                let own = || keys::default_directory().join("host");
                let keys = rig.pi.keys.as_ref().map_or_else(own, PathBuf::from);
                AgentAddress::Tls { address: address.clone(), keys }
            }
            CameraTransport::Sim | CameraTransport::Usb | CameraTransport::File(_) => return None,
        };
        Some(Ok(Box::new(NetworkPi::new(address, order(rig), PiTimeouts::default()))))
    },
};

/// How the rig wants the frames.
pub(super) fn order(rig: &Rig) -> CaptureOrder {
    let pi = &rig.pi;
    let settings = CaptureSettings {
        size: pi.camera.size,
        frame_rate: pi.camera.frame_rate,
        exposure: pi.camera.exposure,
        gain: pi.camera.gain,
        raw: pi.raw,
        rgb: pi.rgb,
    };
    let delivery = Delivery { coding: pi.coding, rgb: pi.rgb_delivery };
    CaptureOrder { settings, focus: pi.focus, delivery }
}
