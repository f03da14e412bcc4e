//! The commands of the Pi: `evrig pair` makes the keys with which `evrig pi` serves a host.

use evrig::delivery::Focus;
use evrig::device::pi::{AgentAddress, NetworkPi, PiTimeouts};
use evrig::geometry::Size;
use evrig::pi::order::{CaptureOrder, CaptureSettings, Delivery};
use evrig::record::Verdict;
use evrig::record::recorder::Recorder;
use evrig::time::Span;
use evrig::units::Hertz;
use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Output, Stdio};

fn evrig(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_evrig")).args(arguments).output().unwrap()
}

/// A running agent, ended by SIGINT.
struct AgentProcess(Child);

impl AgentProcess {
    fn end(mut self) -> Option<i32> {
        let pid = rustix::process::Pid::from_child(&self.0);
        rustix::process::kill_process(pid, rustix::process::Signal::INT).unwrap();
        self.0.wait().unwrap().code()
    }
}

impl Drop for AgentProcess {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn order() -> CaptureOrder {
    let settings = CaptureSettings {
        size: Size::new(64, 48),
        frame_rate: Hertz(120.0),
        exposure: Span::from_micros(4_000),
        gain: 1.0,
        raw: true,
        rgb: true,
    };
    CaptureOrder { settings, focus: Focus::Once, delivery: Delivery::default() }
}

#[test]
fn a_host_with_paired_keys_reaches_the_agent_and_ctrl_c_ends_it() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("keys");
    let paired = evrig(&["pair", "--out", out.to_str().unwrap()]);
    let text = String::from_utf8(paired.stdout).unwrap();
    assert!(paired.status.success() && text.contains("scp") && text.contains("--keys"), "{text}");
    let mut child = Command::new(env!("CARGO_BIN_EXE_evrig"))
        .args(["pi", "--camera", "synthetic", "--listen", "0.0.0.0:0", "--quiet", "--keys"])
        .arg(out.join("agent"))
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut line = String::new();
    BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
    let agent = AgentProcess(child);
    let port = line.trim().rsplit_once(':').unwrap().1;
    assert!(line.starts_with("tls://"), "{line}");
    let reach = AgentAddress::Tls { address: format!("localhost:{port}"), keys: out.join("host") };
    let mut pi = NetworkPi::new(reach, order(), PiTimeouts::default());
    let findings = pi.check();
    assert!(findings.iter().all(|finding| finding.verdict == Verdict::Good), "{findings:?}");
    drop(pi);
    assert_eq!(agent.end(), Some(0));
}

#[test]
fn invalid_options_are_reported_before_anything_listens() {
    let folder = tempfile::tempdir().unwrap();
    let absent = folder.path().join("absent");
    let absent = absent.to_str().unwrap();
    for (arguments, code, expected) in [
        (vec!["--listen", "0.0.0.0:0"], 2, "evrig pair"),
        (vec!["--spool", absent], 2, "no directory"),
        (vec!["--spool-gb", "0"], 2, "--spool-gb"),
        (vec!["--keys", absent], 1, "evrig pair"),
    ] {
        let ended = evrig(&[vec!["pi", "--camera", "synthetic"], arguments].concat());
        let stderr = String::from_utf8(ended.stderr).unwrap();
        assert_eq!(ended.status.code(), Some(code), "{stderr}");
        assert!(stderr.contains(expected), "{stderr}");
    }
}
