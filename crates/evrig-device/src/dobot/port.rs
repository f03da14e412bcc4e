//! Finding and opening the arm's serial port.

use super::link::SerialLink;
use crate::serial_port::usb_serial_ports;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Bits per second of the Magician.
const BAUD: u32 = 115_200;

/// USB ids of the bridges a Magician is built with: Silicon Labs CP210x, QinHeng CH340 and CH9102.
const USB_IDS: &[(u16, u16)] = &[(0x10c4, 0xea60), (0x1a86, 0x7523), (0x1a86, 0x55d4)];

/// Why the port cannot be used.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum PortError {
    /// There is no such file.
    #[error("there is no port {}; {}", path.display(), there_are(present))]
    Missing {
        /// What was asked for.
        path: PathBuf,
        /// The serial ports there are.
        present: Vec<PathBuf>,
    },
    /// It may not be opened.
    #[error(
        "no permission to open {}, which belongs to group {group}; install rig/99-evrig.rules in \
         /etc/udev/rules.d and plug the arm in again, or run `sudo usermod -aG {group} $USER` and \
         log in again", path.display()
    )]
    NoPermission {
        /// The port.
        path: PathBuf,
        /// The group that may open it.
        group: String,
    },
    /// Another program has it.
    #[error(
        "{} is in use by another program; close DobotStudio, DobotLink or the other evrig",
        path.display()
    )]
    Busy {
        /// The port.
        path: PathBuf,
    },
    /// It is something else.
    #[error("{} is no serial port: {because}", path.display())]
    NotSerial {
        /// The path.
        path: PathBuf,
        /// The system's reason.
        because: String,
    },
    /// `auto` found no bridge.
    #[error(
        "no port looks like a Magician's (USB 10c4:ea60, 1a86:7523, 1a86:55d4); {}; plug it in \
         and switch it on, or name its port in the rig file",
        there_are(present)
    )]
    NoCandidate {
        /// The serial ports there are.
        present: Vec<PathBuf>,
    },
    /// `auto` found bridges, but no Magician behind them.
    #[error("no Magician answers: {}", tried.join("; "))]
    NoneAnswers {
        /// Each port and why it is not the one.
        tried: Vec<String>,
    },
    /// `auto` found several Magicians.
    #[error("several Magicians answer ({}); name the port in the rig file", listed(ports))]
    Several {
        /// Their ports.
        ports: Vec<PathBuf>,
    },
}

fn listed(ports: &[PathBuf]) -> String {
    ports.iter().map(|port| port.display().to_string()).collect::<Vec<_>>().join(", ")
}

fn there_are(present: &[PathBuf]) -> String {
    if present.is_empty() {
        "this machine has no USB serial port".to_owned()
    } else {
        format!("this machine has {}", listed(present))
    }
}

/// Opens a serial port as the arm wants it: 115200 baud, 8 data bits, no parity, one stop bit,
/// no flow control, for this process alone.
///
/// # Errors
/// Missing, no permission, busy, not a serial port: each by its name.
pub fn open(path: &Path) -> Result<SerialLink, PortError> {
    let exists = path.symlink_metadata().is_ok();
    if !exists {
        return Err(PortError::Missing { path: path.to_owned(), present: usb_ports() });
    }
    // DTR stays as the system leaves it: its effect on a Magician is unknown and a pty has none.
    let opened = serialport::new(path.to_string_lossy(), BAUD)
        .timeout(Duration::from_millis(2))
        .open()
        .map_err(|error| explain(path, &error))?;
    SerialLink::new(opened)
        .map_err(|error| PortError::NotSerial { path: path.to_owned(), because: error.to_string() })
}

fn explain(path: &Path, error: &serialport::Error) -> PortError {
    let path = path.to_owned();
    match error.kind() {
        serialport::ErrorKind::Io(ErrorKind::PermissionDenied) => {
            PortError::NoPermission { group: group_of(&path), path }
        }
        serialport::ErrorKind::Io(ErrorKind::NotFound) => {
            PortError::Missing { path, present: usb_ports() }
        }
        serialport::ErrorKind::NoDevice | serialport::ErrorKind::Io(ErrorKind::WouldBlock) => {
            PortError::Busy { path }
        }
        _ => PortError::NotSerial { path, because: error.to_string() },
    }
}

/// The group a device file belongs to; `dialout`, the usual one, when that is unknown.
fn group_of(path: &Path) -> String {
    use std::os::unix::fs::MetadataExt;
    let name = || {
        let id = path.metadata().ok()?.gid().to_string();
        let groups = std::fs::read_to_string("/etc/group").ok()?;
        let of_id = |line: &&str| line.split(':').nth(2) == Some(&id);
        groups.lines().find(of_id)?.split(':').next().map(str::to_owned)
    };
    // A device of root's group has no rule yet; the group to join is the usual one.
    name().filter(|group| group != "root").unwrap_or_else(|| "dialout".to_owned())
}

fn usb_ports() -> Vec<PathBuf> {
    usb_serial_ports(Path::new("/sys")).into_iter().map(|port| port.path).collect()
}

/// Finds the arm: by the USB ids of its bridge, then by who answers as a Magician does.
/// `answers` opens a candidate and returns why it is not an arm.
///
/// # Errors
/// None, none that answers, or several that do.
pub fn find(
    sys: &Path,
    mut answers: impl FnMut(&Path) -> Result<(), String>,
) -> Result<PathBuf, PortError> {
    let present = usb_serial_ports(sys);
    let (mut found, mut tried) = (Vec::new(), Vec::new());
    for port in present.iter().filter(|port| USB_IDS.contains(&port.usb_id)) {
        match answers(&port.path) {
            Ok(()) => found.push(port.path.clone()),
            Err(because) => tried.push(format!("{}: {because}", port.path.display())),
        }
    }
    match found.len() {
        1 => Ok(found.remove(0)),
        0 if tried.is_empty() => {
            let present = present.into_iter().map(|port| port.path).collect();
            Err(PortError::NoCandidate { present })
        }
        0 => Err(PortError::NoneAnswers { tried }),
        _ => Err(PortError::Several { ports: found }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;
    use std::os::unix::fs::symlink;

    /// A tree like /sys with ttys behind the given USB ids.
    fn sys(ports: &[(&str, &str, &str)]) -> tempfile::TempDir {
        let root = tempfile::tempdir().unwrap();
        fs::create_dir_all(root.path().join("class/tty/ttyS0")).unwrap();
        for (n, (name, vendor, product)) in ports.iter().enumerate() {
            let usb = root.path().join(format!("devices/usb1/1-{n}"));
            let tty = usb.join(format!("1-{n}:1.0")).join(name);
            fs::create_dir_all(&tty).unwrap();
            fs::write(usb.join("idVendor"), format!("{vendor}\n")).unwrap();
            fs::write(usb.join("idProduct"), format!("{product}\n")).unwrap();
            let class = root.path().join("class/tty").join(name);
            fs::create_dir_all(&class).unwrap();
            symlink(&tty, class.join("device")).unwrap();
        }
        root
    }

    #[test]
    fn ports_are_found_by_the_ids_above_them_and_chosen_by_who_answers() {
        let root = sys(&[
            ("ttyUSB0", "10c4", "ea60"),
            ("ttyUSB1", "1a86", "7523"),
            ("ttyACM0", "2341", "0043"),
        ]);
        let mut asked = Vec::new();
        let found = find(root.path(), |path| {
            asked.push(path.to_owned());
            if path.ends_with("ttyUSB1") { Ok(()) } else { Err("a GPS answers".to_owned()) }
        });
        assert_eq!(found, Ok(PathBuf::from("/dev/ttyUSB1")));
        assert_eq!(asked, [PathBuf::from("/dev/ttyUSB0"), PathBuf::from("/dev/ttyUSB1")]);
    }

    #[test]
    fn a_missing_item_is_reported_with_those_present() {
        let root = sys(&[("ttyACM0", "2341", "0043")]);
        let error = find(root.path(), |_| Ok(())).unwrap_err();
        assert!(error.to_string().contains("/dev/ttyACM0"), "{error}");
        let root = sys(&[("ttyUSB0", "10c4", "ea60")]);
        let error = find(root.path(), |_| Err("silence".to_owned())).unwrap_err();
        assert_eq!(error.to_string(), "no Magician answers: /dev/ttyUSB0: silence");
        let root = sys(&[("ttyUSB0", "10c4", "ea60"), ("ttyUSB1", "1a86", "55d4")]);
        assert!(matches!(find(root.path(), |_| Ok(())), Err(PortError::Several { .. })));
        assert!(find(Path::new("/nowhere"), |_| Ok(())).is_err());
    }

    #[test]
    fn a_missing_port_and_a_file_that_is_no_port_are_named() {
        let error = open(Path::new("/dev/ttyUSB-none")).unwrap_err();
        assert!(matches!(error, PortError::Missing { .. }), "{error}");
        let file = tempfile::NamedTempFile::new().unwrap();
        let error = open(file.path()).unwrap_err();
        assert!(matches!(error, PortError::NotSerial { .. }), "{error}");
    }

    #[test]
    fn no_permission_names_the_group_and_the_rule() {
        let io = serialport::ErrorKind::Io(ErrorKind::PermissionDenied);
        let error = explain(Path::new("/dev/null"), &serialport::Error::new(io, "denied"));
        let text = error.to_string();
        assert!(text.contains("dialout") && text.contains("rig/99-evrig.rules"), "{text}");
    }
}
