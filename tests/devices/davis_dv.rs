//! The DAVIS over TCP, to and from dv-processing, the library of the camera's manufacturer.
//!
//! Needs a Python with `dv-processing` and `numpy`, named by `EVRIG_PYTHON`; skipped when unset.

use evrig::device::davis::{NetworkDavis, NetworkDavisTimeouts};
use evrig::device::stream_server::StreamServer;
use evrig::event::{Event, Events};
use evrig::format::aedat4::{Compression, Content, StreamSpec};
use evrig::frame::{Frame, FrameTiming, Samples};
use evrig::geometry::Size;
use evrig::record::recorder::{Received, Recorder, RecorderSample, channel};
use evrig::time::{Davis, Stamp};
use serde_json::Value;
use std::io::{BufRead, BufReader, Write};
use std::net::TcpListener;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

const CAMERA: &str = "DAVIS346_00000042";
const PATIENCE: Duration = Duration::from_secs(30);

fn python(arguments: &[&str]) -> Option<(Child, BufReader<std::process::ChildStdout>)> {
    let Some(python) = std::env::var_os("EVRIG_PYTHON") else {
        println!("skipped: EVRIG_PYTHON names no Python with dv-processing and numpy");
        return None;
    };
    let mut child = Command::new(python)
        .arg("tests/python/davis_network.py")
        .args(arguments)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let output = BufReader::new(child.stdout.take().unwrap());
    Some((child, output))
}

fn line(output: &mut impl BufRead) -> String {
    let mut text = String::new();
    output.read_line(&mut text).unwrap();
    text.trim().to_owned()
}

/// The events that the script serves.
fn event(k: i64, i: i64) -> Event {
    let (x, y) = ((i % 346) as u16, (k % 260) as u16);
    Event { t: 1_000_000 + 1_000 * k + i, x, y, on: i % 2 == 0 }
}

#[test]
fn events_and_frames_served_by_dv_processing_are_recorded_exactly() {
    for (kind, compression) in
        [("events", "none"), ("events", "lz4"), ("events", "zstd"), ("frames", "lz4")]
    {
        let free = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
        let port = free.to_string();
        let Some((mut server, mut lines)) = python(&["serve", &port, kind, compression, "40"])
        else {
            return;
        };
        assert_eq!(line(&mut lines), "listening");
        let mut davis =
            NetworkDavis::new(&format!("127.0.0.1:{port}"), NetworkDavisTimeouts::default());
        let prepared = davis.prepare().unwrap();
        assert_eq!(prepared.streams[0].size, Some(Size::DAVIS346));
        assert_eq!(prepared.streams[0].source, CAMERA);
        let (outlet, inlet) = channel(1 << 26);
        davis.start(outlet).unwrap();
        let mut events = Events::new();
        let mut frames = Vec::new();
        while events.len() < 40_000 && frames.len() < 40 {
            match inlet.take(PATIENCE) {
                Received::Sample(RecorderSample::Packet {
                    content: Content::Events(more), ..
                }) => {
                    events.extend_from_slice(more.as_slice());
                }
                Received::Sample(RecorderSample::Packet {
                    content: Content::Frame(frame), ..
                }) => {
                    frames.push(frame);
                }
                other => panic!("{kind} {compression}: {other:?}"),
            }
        }
        let tally = davis.finish().unwrap();
        assert_eq!((tally.n_dropped, tally.gaps), (0, Vec::new()));
        server.stdin.take().unwrap().write_all(b"done\n").unwrap();
        assert!(server.wait().unwrap().success());
        if kind == "events" {
            let truth: Events = (0..40).flat_map(|k| (0..1000).map(move |i| event(k, i))).collect();
            assert!(events == truth, "{compression}: the events differ");
        }
        for (k, frame) in frames.iter().enumerate() {
            assert_eq!(frame.timing.stamp.as_micros(), 1_000_000 + 1_000 * k as i64);
            assert_eq!(frame.samples, Samples::U8(vec![k as u8; Size::DAVIS346.n_pixels()]));
        }
    }
}

fn read_by_dv(
    kind: &str,
    spec: &StreamSpec,
    n: u64,
    send: impl Fn(&mut StreamServer),
) -> Option<Value> {
    let mut server = StreamServer::bind("127.0.0.1:0", spec, Compression::Lz4).unwrap();
    let port = server.address().port().to_string();
    let (mut reader, mut lines) = python(&["read", &port, kind, &n.to_string()])?;
    assert!(server.wait_for_clients(1, PATIENCE));
    assert_eq!(line(&mut lines), "connected");
    send(&mut server);
    let found = line(&mut lines);
    assert!(reader.wait().unwrap().success());
    assert_eq!(server.n_dropped(), 0);
    Some(serde_json::from_str(&found).unwrap_or_else(|error| panic!("{error}: {found}")))
}

#[test]
fn dv_processing_reads_every_served_event_and_frame() {
    let spec = StreamSpec::events(Size::DAVIS346, CAMERA);
    let packets: Vec<Events> = (0..40).map(|k| (0..1000).map(|i| event(k, i)).collect()).collect();
    let send = |server: &mut StreamServer| {
        for packet in &packets {
            server.send_events(packet.as_slice()).unwrap();
        }
    };
    let Some(found) = read_by_dv("events", &spec, 40_000, send) else { return };
    let all = packets.iter().flat_map(|packet| packet.as_slice().iter());
    let sum: i64 = all.map(|e| i64::from(e.x) + i64::from(e.y) + i64::from(e.on)).sum();
    assert_eq!(found["count"], 40_000);
    assert_eq!(found["sum"], sum);
    assert_eq!((&found["first"], &found["last"]), (&1_000_000.into(), &1_039_999.into()));
    assert_eq!(found["size"], serde_json::json!([346, 260]));
    assert_eq!(found["camera"], CAMERA);

    let spec = StreamSpec::frames(Size::DAVIS346, CAMERA);
    let send = |server: &mut StreamServer| {
        for k in 0..30_u8 {
            let frame = Frame::<Davis>::gray(
                FrameTiming::from_stamp(Stamp::from_micros(1_000_000 + i64::from(k))),
                Size::DAVIS346,
                Samples::U8(vec![k; Size::DAVIS346.n_pixels()]),
            );
            server.send_frame(&frame).unwrap();
        }
    };
    let Some(found) = read_by_dv("frames", &spec, 30, send) else { return };
    assert_eq!(found["count"], 30);
    assert_eq!(found["sum"], (0..30).sum::<i64>() * 346 * 260);
    assert_eq!((&found["first"], &found["last"]), (&1_000_000.into(), &1_000_029.into()));
}
