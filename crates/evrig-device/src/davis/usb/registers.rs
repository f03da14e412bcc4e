//! The camera's registers, over a second handle: what the driver has no way to set or to read.
//!
//! Vendor requests go to the device, not to an interface, so the driver's claim is not in the way.
//! Module and parameter numbers are those of the driver's table (`inivation_davis346.rs`).

use evrig_session::rig::DAVIS_BIASES;
use neuromorphic_drivers::rusb::{self, UsbContext};
use serde_json::{Map, Value, json};
use std::time::Duration;

/// Vendor and product of a DAVIS346.
const IDS: (u16, u16) = (0x152A, 0x841A);
/// For one register.
const PATIENCE: Duration = Duration::from_secs(1);
/// The request that reads or writes a register.
const SPI: u8 = 0xBF;

const MULTIPLEXER: u16 = 0;
const DVS: u16 = 1;
const APS: u16 = 2;
const CHIP: u16 = 5;

const APS_RUN: u16 = 4;
/// The chip's parameter of each bias, in the order of [`DAVIS_BIASES`].
const BIAS_PARAMETERS: [u16; 21] =
    [8, 9, 10, 11, 12, 13, 14, 15, 16, 17, 18, 19, 20, 21, 22, 23, 24, 25, 26, 27, 34];
const HAS_STATISTICS: u16 = 80;
/// Upper word of the events that did not get through; the lower one is behind it.
const EVENTS_DROPPED: u16 = 83;

/// Reads and writes one register.
pub(super) trait DavisRegisters {
    /// The register's value.
    fn read(&self, module: u16, parameter: u16) -> Result<u32, String>;

    /// Sets the register.
    fn write(&self, module: u16, parameter: u16, value: u32) -> Result<(), String>;

    /// Lets the camera take frames, or not.
    fn set_frames(&self, are_taken: bool) -> Result<(), String> {
        self.write(APS, APS_RUN, u32::from(are_taken))?;
        match self.read(APS, APS_RUN)? {
            value if value == u32::from(are_taken) => Ok(()),
            value => {
                Err(format!("APS was set to {}, and {value} is read back", u32::from(are_taken)))
            }
        }
    }

    /// Events that the camera dropped since it was plugged in.
    fn n_dropped(&self) -> Result<u64, String> {
        if self.read(MULTIPLEXER, HAS_STATISTICS)? == 0 {
            return Ok(0);
        }
        let [upper, lower] =
            [self.read(MULTIPLEXER, EVENTS_DROPPED)?, self.read(MULTIPLEXER, EVENTS_DROPPED + 1)?];
        Ok(u64::from(upper) << 32 | u64::from(lower))
    }

    /// What the camera is set to now.
    fn read_back(&self) -> Result<Value, String> {
        let mut biases = Map::new();
        for (name, parameter) in DAVIS_BIASES.iter().zip(BIAS_PARAMETERS) {
            let value = self.read(CHIP, parameter)?;
            let (coarse, fine) = ((value >> 12) & 0x7, (value >> 4) & 0xff);
            biases.insert((*name).to_owned(), json!({"coarse": coarse, "fine": fine}));
        }
        Ok(json!({
            "biases": biases,
            "frames": self.read(APS, APS_RUN)? == 1,
            "global_shutter": self.read(APS, 7)? == 1,
            "exposure_clock_cycles": self.read(APS, 12)?,
            "frame_interval_clock_cycles": self.read(APS, 13)?,
            "background_activity_filter": self.read(DVS, 31)? == 1,
            "refractory_filter": self.read(DVS, 33)? == 1,
            "event_skipping": self.read(DVS, 51)? == 1,
        }))
    }
}

/// The second handle.
pub(super) struct Opened(rusb::DeviceHandle<rusb::Context>);

impl DavisRegisters for Opened {
    fn read(&self, module: u16, parameter: u16) -> Result<u32, String> {
        let mut bytes = [0; 4];
        let read = self.0.read_control(0xC0, SPI, module, parameter, &mut bytes, PATIENCE);
        match read {
            Ok(4) => Ok(u32::from_be_bytes(bytes)),
            Ok(n) => Err(format!("register {module}:{parameter}: 4 bytes expected, {n} read")),
            Err(error) => Err(format!("register {module}:{parameter}: {error}")),
        }
    }

    fn write(&self, module: u16, parameter: u16, value: u32) -> Result<(), String> {
        let bytes = value.to_be_bytes();
        match self.0.write_control(0x40, SPI, module, parameter, &bytes, PATIENCE) {
            Ok(4) => Ok(()),
            Ok(n) => Err(format!("register {module}:{parameter}: 4 bytes expected, {n} written")),
            Err(error) => Err(format!("register {module}:{parameter}: {error}")),
        }
    }
}

/// A handle of the camera at this place.
pub(super) fn open(bus: u8, address: u8) -> Result<Opened, String> {
    let is_it = |device: &rusb::Device<rusb::Context>| {
        device.bus_number() == bus && device.address() == address
    };
    let device = devices()?.into_iter().find(is_it);
    let device = device.ok_or_else(|| format!("nothing on bus {bus} at address {address}"))?;
    device.open().map(Opened).map_err(|error| error.to_string())
}

/// Where the first DAVIS346 is and how fast its port; nothing is set.
pub(super) fn find() -> Result<String, String> {
    let ids = |device: &rusb::Device<rusb::Context>| {
        device.device_descriptor().is_ok_and(|it| (it.vendor_id(), it.product_id()) == IDS)
    };
    let devices = devices()?;
    let n_devices = devices.len();
    let device = devices.into_iter().find(ids).ok_or_else(|| {
        format!("no DAVIS346 ({:04x}:{:04x}) among {n_devices} USB devices", IDS.0, IDS.1)
    })?;
    let place = format!("on bus {} at address {}", device.bus_number(), device.address());
    device.open().map_err(|error| format!("a DAVIS346 is {place}, but: {error}"))?;
    Ok(format!("{place}, {:?} speed", device.speed()))
}

fn devices() -> Result<Vec<rusb::Device<rusb::Context>>, String> {
    let listed = rusb::Context::new().and_then(|context| context.devices());
    let listed = listed.map_err(|error| format!("USB cannot be listed: {error}"))?;
    Ok(listed.iter().collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::cell::RefCell;
    use std::collections::BTreeMap;

    /// DavisRegisters in memory; one of them may be stuck.
    #[derive(Default)]
    struct UsbMemory {
        values: RefCell<BTreeMap<(u16, u16), u32>>,
        stuck: Option<(u16, u16)>,
    }

    impl DavisRegisters for UsbMemory {
        fn read(&self, module: u16, parameter: u16) -> Result<u32, String> {
            Ok(self.values.borrow().get(&(module, parameter)).copied().unwrap_or(0))
        }

        fn write(&self, module: u16, parameter: u16, value: u32) -> Result<(), String> {
            if self.stuck != Some((module, parameter)) {
                self.values.borrow_mut().insert((module, parameter), value);
            }
            Ok(())
        }
    }

    #[test]
    fn frames_are_switched_and_a_camera_that_does_not_obey_is_reported() {
        let obeys = UsbMemory::default();
        for on in [true, false] {
            obeys.set_frames(on).unwrap();
            assert_eq!(obeys.read_back().unwrap()["frames"], on);
        }
        let stuck = UsbMemory { stuck: Some((APS, APS_RUN)), ..UsbMemory::default() };
        assert!(stuck.set_frames(true).unwrap_err().contains("0 is read back"));
    }

    #[test]
    fn biases_are_read_back_as_coarse_and_fine() {
        let registers = UsbMemory::default();
        registers.write(CHIP, 11, 0b1111 | 173 << 4 | 6 << 12).unwrap();
        let found = registers.read_back().unwrap();
        assert_eq!(found["biases"]["onbn"], json!({"coarse": 6, "fine": 173}));
        assert_eq!(found["biases"].as_object().unwrap().len(), DAVIS_BIASES.len());
    }

    #[test]
    fn dropped_events_are_counted_in_sixty_four_bits_where_the_camera_counts() {
        let registers = UsbMemory::default();
        registers.write(MULTIPLEXER, EVENTS_DROPPED, 1).unwrap();
        registers.write(MULTIPLEXER, EVENTS_DROPPED + 1, 7).unwrap();
        assert_eq!(registers.n_dropped(), Ok(0));
        registers.write(MULTIPLEXER, HAS_STATISTICS, 1).unwrap();
        assert_eq!(registers.n_dropped(), Ok((1 << 32) + 7));
    }
}
