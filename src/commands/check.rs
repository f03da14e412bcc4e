//! `check`: everything that must hold before a recording.

use super::plan::refused;
use super::{Ending, Output, WrongUse};
use crate::cli::CheckArgs;
use crate::drivers::{check_arm, check_recorders, start_simulated_arm};
use evrig_device::serial_port::{UsbSerialPort, usb_serial_ports};
use evrig_record::{Finding, Verdict};
use evrig_session::rig::{ArmPort, Rig};
use evrig_session::trajectory::{OptionalSegments, Plan, Trajectory};
use serde_json::json;
use std::path::Path;

/// Free space that a machine should have for recordings when no trajectory states how much.
const SOME_SPACE: u64 = 10_000_000_000;

pub(super) fn check(args: &CheckArgs, output: &Output) -> anyhow::Result<Ending> {
    let findings = match &args.rig {
        None => this_machine(&args.out),
        Some(rig) => of_rig(rig, args, output)?,
    };
    let is_ready = findings.iter().all(|finding| finding.holds());
    let line = |finding: &Finding| {
        let mark = match finding.verdict {
            Verdict::Good => "ok   ",
            Verdict::Doubt => "look ",
            Verdict::Bad => "FAIL ",
        };
        format!("{mark} {:<9} {}\n", finding.subject, finding.description)
    };
    let mut text: String = findings.iter().map(line).collect();
    text += if is_ready { "ready" } else { "not ready: mend what failed" };
    let value = json!({ "schema": "evrig.check/2", "ready": is_ready, "findings": findings });
    output.result(&value, text)?;
    Ok(if is_ready { Ending::Done } else { Ending::Negative })
}

fn this_machine(out: &Path) -> Vec<Finding> {
    let ports = usb_serial_ports(Path::new("/sys"));
    let port = match ports.as_slice() {
        [] => {
            Finding::doubt("port", "no USB serial port is plugged in; the simulated rig needs none")
        }
        some => {
            let name = |port: &UsbSerialPort| {
                format!("{} ({:04x}:{:04x})", port.path.display(), port.usb_id.0, port.usb_id.1)
            };
            let names: Vec<String> = some.iter().map(name).collect();
            Finding::good("port", format!("USB serial ports: {}", names.join(", ")))
        }
    };
    vec![port, disk(out, SOME_SPACE), clock()]
}

fn of_rig(name: &str, args: &CheckArgs, output: &Output) -> anyhow::Result<Vec<Finding>> {
    let rig = Rig::find(name).map_err(refused)?;
    let mut findings = vec![Finding::good("rig", format!("{name} is understood"))];
    let plan = match &args.trajectory {
        None => None,
        Some(trajectory) => {
            let described = Trajectory::find(trajectory).map_err(refused)?;
            let plan = Plan::new(&described, &rig, OptionalSegments::Included)
                .map_err(|error| WrongUse(format!("{trajectory} on rig {name}: {error}")))?;
            Some(plan)
        }
    };
    let path = plan.as_ref().and_then(|plan| plan.feasible_path().ok());
    if let Some(Err(beyond)) = plan.as_ref().map(Plan::feasible_path) {
        findings.push(Finding::bad("path", beyond.to_string()));
    }
    if rig.arm.port == ArmPort::Sim {
        output.detail("starting the simulated arm");
    }
    let simulated = start_simulated_arm(&rig, true)?;
    findings.extend(check_arm(&rig, simulated.as_ref(), path));
    output.detail("asking the cameras, and how fast the network is");
    let start = path.map_or(rig.arm.home, evrig_session::trajectory::ToolPath::start);
    findings.extend(check_recorders(&rig, start, simulated.as_ref()));
    let needed = plan.as_ref().map_or(SOME_SPACE, |plan| plan.disk_bytes);
    findings.push(disk(&args.out, needed));
    findings.push(clock());
    Ok(findings)
}

/// Free space where the recording goes: half as much again as is needed is comfortable.
fn disk(out: &Path, needed: u64) -> Finding {
    let gb = |bytes: u64| bytes as f64 * 1e-9;
    let free = match rustix::fs::statvfs(out) {
        Ok(space) => space.f_bavail * space.f_frsize,
        Err(error) => {
            let description =
                format!("{}: {error}; give a directory that exists as --out", out.display());
            return Finding::bad("disk", description);
        }
    };
    let description =
        format!("{:.1} GB free in {}, {:.1} GB needed", gb(free), out.display(), gb(needed));
    match free {
        free if free < needed => {
            Finding::bad("disk", format!("{description}; free space or record elsewhere"))
        }
        free if free < needed + needed / 2 => Finding::doubt("disk", description),
        _ => Finding::good("disk", description),
    }
}

/// Whether something keeps this machine's clock right.
fn clock() -> Finding {
    const SIGNS: [(&str, &str); 3] = [
        ("/run/systemd/timesync/synchronized", "systemd-timesyncd has synchronised it"),
        ("/run/chrony/chronyd.pid", "chronyd runs"),
        ("/run/ntpd.pid", "ntpd runs"),
    ];
    match SIGNS.iter().find(|(file, _)| Path::new(file).exists()) {
        Some((_, description)) => Finding::good("clock", *description),
        None => Finding::doubt(
            "clock",
            "nothing seems to discipline this machine's clock; install chrony, on the Pi too, \
             or their times will drift apart",
        ),
    }
}
