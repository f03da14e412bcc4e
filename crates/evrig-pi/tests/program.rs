//! The program `evrig-pi`: serves until a signal, and refuses wrong options before it listens.

#![allow(clippy::expect_used, clippy::unwrap_used)]

use evrig_pi::wire;
use rustix::process::{Pid, Signal, kill_process};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::{Command, Stdio};

fn program(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_evrig-pi"));
    command.args(["--camera", "synthetic", "--listen", "127.0.0.1:0"]).args(arguments);
    command
}

#[test]
fn the_program_serves_a_host_until_it_is_interrupted() {
    let mut child = program(&["--quiet"]).stdout(Stdio::piped()).spawn().unwrap();
    let mut line = String::new();
    BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
    let mut socket = TcpStream::connect(line.trim().strip_prefix("tcp://").unwrap()).unwrap();
    socket.write_all(&wire::preamble()).unwrap();
    let mut preamble = [0; wire::PREAMBLE_BYTES];
    socket.read_exact(&mut preamble).unwrap();
    wire::check_preamble(&preamble).unwrap();
    kill_process(Pid::from_child(&child), Signal::INT).unwrap();
    assert_eq!(child.wait().unwrap().code(), Some(0));
}

#[test]
fn wrong_options_are_refused_before_anything_listens() {
    let folder = tempfile::tempdir().unwrap();
    let absent = folder.path().join("absent");
    let absent = absent.to_str().unwrap();
    for (arguments, code, expected) in [
        (["--spool", absent], 2, "no directory"),
        (["--spool-gb", "0"], 2, "--spool-gb"),
        (["--keys", absent], 1, "evrig pair"),
    ] {
        let ended = program(&arguments).output().unwrap();
        let stderr = String::from_utf8(ended.stderr).unwrap();
        assert_eq!(ended.status.code(), Some(code), "{stderr}");
        assert!(stderr.contains(expected) && ended.stdout.is_empty(), "{stderr}");
    }
}
