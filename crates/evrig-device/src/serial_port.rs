//! Serial ports behind USB, as the system lists them.

use std::path::{Path, PathBuf};

/// A serial port behind USB.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct UsbSerialPort {
    /// Its device file.
    pub path: PathBuf,
    /// USB vendor and product.
    pub usb_id: (u16, u16),
}

/// The USB serial ports that `sys` (`/sys`) knows, sorted by name.
#[must_use]
pub fn usb_serial_ports(sys: &Path) -> Vec<UsbSerialPort> {
    let Ok(entries) = std::fs::read_dir(sys.join("class/tty")) else { return Vec::new() };
    let mut ports: Vec<UsbSerialPort> = entries
        .flatten()
        .filter_map(|entry| {
            let usb_id = usb_id(&entry.path().join("device"))?;
            Some(UsbSerialPort { path: Path::new("/dev").join(entry.file_name()), usb_id })
        })
        .collect();
    ports.sort();
    ports
}

/// The ids of the USB device above a tty's device in the tree.
fn usb_id(device: &Path) -> Option<(u16, u16)> {
    /// A port hangs at most a few levels below its USB device.
    const N_LEVELS: usize = 4;
    let device = device.canonicalize().ok()?;
    let number = |directory: &Path, name| {
        let text = std::fs::read_to_string(directory.join(name)).ok()?;
        u16::from_str_radix(text.trim(), 16).ok()
    };
    device.ancestors().take(N_LEVELS).find_map(|directory| {
        Some((number(directory, "idVendor")?, number(directory, "idProduct")?))
    })
}
