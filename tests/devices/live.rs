//! The live view as clients receive it: AEDAT4 by evrig and dv-processing, Foxglove by a raw
//! socket.
//!
//! The test with dv-processing needs a Python named by `EVRIG_PYTHON`; skipped when unset.

use evrig::device::davis::{NetworkDavis, NetworkDavisTimeouts};
use evrig::event::Events;
use evrig::format::aedat4::{Content, Reader};
use evrig::geometry::Size;
use evrig::live::{Addresses, Live, LiveError};
use evrig::record::recorder::{Received, Recorder, RecorderSample, channel, host_time};
use std::process::{Command, Stdio};
use std::time::Duration;

const STREET: &str = "tests/data/davis346-street.aedat4";
const N_EVENTS: usize = 78_830;
const PATIENCE: Duration = Duration::from_secs(60);

fn addresses() -> Addresses {
    let any = "127.0.0.1:0".parse().unwrap();
    Addresses { events: any, frames: any, foxglove: None }
}

fn serve(addresses: Addresses) -> Live {
    Live::serve(addresses, Size::DAVIS346, "DAVIS346_1", ("tag36h11", 0)).unwrap()
}

/// Packets that the queue of a viewer holds.
const QUEUE_PACKETS: usize = 250;

/// The first packets of the recording as a camera delivers them, and their events.
fn samples() -> (Vec<RecorderSample>, Events) {
    let packets = Reader::open(STREET).unwrap().map(Result::unwrap);
    let sample = |packet: evrig::format::aedat4::Packet| RecorderSample::Packet {
        stream: packet.stream,
        arrived: host_time(),
        content: packet.content,
    };
    let samples: Vec<RecorderSample> = packets.take(QUEUE_PACKETS).map(sample).collect();
    let mut truth = Events::new();
    for sample in &samples {
        if let RecorderSample::Packet { content: Content::Events(events), .. } = sample {
            truth.extend_from_slice(events.as_slice());
        }
    }
    (samples, truth)
}

#[test]
fn a_viewer_gets_every_event_and_the_status_counts_them() {
    let mut live = serve(addresses());
    let mut viewer =
        NetworkDavis::new(&live.events().address().to_string(), NetworkDavisTimeouts::default());
    viewer.prepare().unwrap();
    assert!(live.events().wait_for_clients(1, PATIENCE));
    live.update_status(host_time(), None, 0);
    let (samples, truth) = samples();
    samples.iter().for_each(|sample| live.take(sample).unwrap());
    live.show_events(host_time());
    let status = live.update_status(host_time(), None, 3);
    assert!(truth.len() > 10_000);
    assert!(status.events_per_s > 0.0 && status.davis_frames_per_s > 0.0);
    assert_eq!((status.n_dropped_by_devices, status.n_dropped_for_viewers), (3, 0));
    assert_eq!(status.tag_px, None, "the recording shows no tag");
    let (outlet, inlet) = channel(1 << 28);
    viewer.start(outlet).unwrap();
    let mut got = Events::new();
    while got.len() < truth.len() {
        match inlet.take(PATIENCE) {
            Received::Sample(RecorderSample::Packet {
                content: Content::Events(events), ..
            }) => {
                got.extend_from_slice(events.as_slice());
            }
            other => panic!("{other:?}"),
        }
    }
    assert!(got == truth, "the events differ");
}

#[test]
fn dv_processing_reads_the_events() {
    let Some(python) = std::env::var_os("EVRIG_PYTHON") else {
        eprintln!("skipped: EVRIG_PYTHON names no Python with dv-processing and numpy");
        return;
    };
    let mut live = serve(addresses());
    let port = live.events().address().port().to_string();
    let (samples, truth) = samples();
    let n = truth.len().to_string();
    let reader = Command::new(python)
        .args(["tests/python/davis_network.py", "read", &port, "events", &n])
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    assert!(live.events().wait_for_clients(1, PATIENCE));
    samples.iter().for_each(|sample| live.take(sample).unwrap());
    let printed = String::from_utf8(reader.wait_with_output().unwrap().stdout).unwrap();
    let found: serde_json::Value = serde_json::from_str(printed.lines().last().unwrap()).unwrap();
    assert_eq!(found["count"], truth.len());
    assert_eq!(found["size"], serde_json::json!([346, 260]));
}

#[test]
fn the_live_view_listens_on_loopback_only() {
    let open = Addresses { frames: "0.0.0.0:0".parse().unwrap(), ..addresses() };
    let refused = Live::serve(open, Size::DAVIS346, "x", ("tag36h11", 0)).unwrap_err();
    assert!(matches!(refused, LiveError::NotLoopback { .. }));
}

#[test]
fn a_session_is_played_to_its_end_and_counted() {
    let folder = tempfile::tempdir().unwrap();
    let session = folder.path().join("street");
    let evrig = |arguments: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_evrig"));
        command.args(arguments).output().unwrap()
    };
    let path = session.to_str().unwrap();
    assert!(evrig(&["import", "aedat4", STREET, "--out", path]).status.success());
    let any = "127.0.0.1:0";
    let played = evrig(&["live", path, "--pace", "20", "--events", any, "--frames", any, "--json"]);
    assert!(played.status.success(), "{played:?}");
    let value: serde_json::Value = serde_json::from_slice(&played.stdout).unwrap();
    assert_eq!((&value["n_events"], &value["n_dropped_by_devices"]), (&N_EVENTS.into(), &0.into()));
    assert!(String::from_utf8(played.stderr).unwrap().contains("events  tcp://127.0.0.1:"));
}

#[cfg(not(feature = "foxglove"))]
#[test]
fn foxglove_without_its_feature_is_refused_with_the_reason() {
    let asked = Addresses { foxglove: Some("127.0.0.1:0".parse().unwrap()), ..addresses() };
    let refused = Live::serve(asked, Size::DAVIS346, "x", ("tag36h11", 0)).unwrap_err();
    assert!(refused.to_string().contains("--features foxglove"));
}

#[cfg(feature = "foxglove")]
#[test]
fn foxglove_receives_every_channel() {
    use std::io::{Read, Write};
    let asked = Addresses { foxglove: Some("127.0.0.1:0".parse().unwrap()), ..addresses() };
    let live = serve(asked);
    let address = live.foxglove().unwrap();
    let mut socket = std::net::TcpStream::connect(address).unwrap();
    socket.set_read_timeout(Some(PATIENCE)).unwrap();
    let hello = format!(
        "GET / HTTP/1.1\r\nHost: {address}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n\
         Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\
         Sec-WebSocket-Protocol: foxglove.sdk.v1\r\n\r\n"
    );
    socket.write_all(hello.as_bytes()).unwrap();
    let mut text = Vec::new();
    let topics = [
        "/davis/frame",
        "/davis/tag",
        "/davis/events",
        "/pi/raw",
        "/pi/rgb",
        "/arm/pose",
        "/evrig/status",
    ];
    let has_all = |text: &[u8]| {
        let text = String::from_utf8_lossy(text);
        topics.iter().all(|topic| text.contains(&format!("\"{topic}\"")))
    };
    while !has_all(&text) {
        let mut part = [0; 4096];
        let n = socket.read(&mut part).expect("the server advertises its channels");
        assert!(n > 0, "closed after {}", String::from_utf8_lossy(&text));
        text.extend_from_slice(&part[..n]);
    }
    let text = String::from_utf8_lossy(&text);
    assert!(text.starts_with("HTTP/1.1 101"), "{text}");
    for schema in ["foxglove.RawImage", "foxglove.ImageAnnotations", "foxglove.PoseInFrame"] {
        assert!(text.contains(schema), "{schema}");
    }
}
