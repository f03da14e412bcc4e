//! The event camera over TCP and from a recording: complete, interrupted, silent and absent.

use evrig::device::davis::{NetworkDavis, NetworkDavisTimeouts, ReplayDavis, ReplaySpeed};
use evrig::device::stream_server::StreamServer;
use evrig::event::{Event, Events};
use evrig::format::aedat4::{Compression, Content, Reader, StreamSpec};
use evrig::geometry::Size;
use evrig::record::Verdict;
use evrig::record::recorder::{Received, Recorder, RecorderSample, SampleReceiver, channel};
use std::net::TcpListener;
use std::path::Path;
use std::time::Duration;

const STREET: &str = "tests/data/davis346-street.aedat4";
const PATIENCE: Duration = Duration::from_secs(30);
const QUICK: NetworkDavisTimeouts = NetworkDavisTimeouts {
    connect: Duration::from_millis(500),
    silence: Duration::from_millis(300),
    reconnect: Duration::from_secs(20),
    drain: Duration::from_millis(10),
};

fn run(first: i64, n: i64) -> Events {
    (first..first + n).map(|t| Event { t, x: 3, y: 4, on: true }).collect()
}

fn next_events(inlet: &SampleReceiver) -> Events {
    match inlet.take(PATIENCE) {
        Received::Sample(RecorderSample::Packet { content: Content::Events(events), .. }) => events,
        other => panic!("{other:?}"),
    }
}

fn server(port: u16) -> StreamServer {
    let spec = StreamSpec::events(Size::DAVIS346, "DAVIS346_1");
    StreamServer::bind(("127.0.0.1", port), &spec, Compression::None).unwrap()
}

#[test]
fn a_recording_is_played_to_its_last_packet() {
    let mut davis = ReplayDavis::new(Path::new(STREET), ReplaySpeed::Unpaced);
    let prepared = davis.prepare().unwrap();
    let (outlet, inlet) = channel(1 << 20);
    davis.start(outlet).unwrap();
    let mut played = Vec::new();
    loop {
        match inlet.take(PATIENCE) {
            Received::Sample(RecorderSample::Packet { stream, content, .. }) => {
                played.push((stream, content))
            }
            Received::Closed => break,
            other => panic!("{other:?}"),
        }
    }
    let file = Reader::open(STREET).unwrap();
    assert_eq!(prepared.streams.len(), file.streams().len());
    let there: Vec<_> = file.map(|packet| packet.unwrap().content).collect();
    assert!(played.into_iter().map(|(_, content)| content).eq(there));
    let tally = davis.finish().unwrap();
    assert!(tally.is_over && tally.n_dropped == 0);
}

#[test]
fn a_reconnected_server_leaves_a_reported_gap() {
    let mut first = server(0);
    let port = first.address().port();
    let mut davis = NetworkDavis::new(&format!("127.0.0.1:{port}"), QUICK);
    davis.prepare().unwrap();
    assert!(first.wait_for_clients(1, PATIENCE));
    let (outlet, inlet) = channel(1 << 20);
    first.send_events(run(0, 10).as_slice()).unwrap();
    davis.start(outlet).unwrap();
    assert_eq!(next_events(&inlet), run(0, 10));
    drop(first);
    let mut second = server(port);
    assert!(second.wait_for_clients(1, PATIENCE));
    second.send_events(run(500, 7).as_slice()).unwrap();
    assert_eq!(next_events(&inlet), run(500, 7));
    let tally = davis.finish().unwrap();
    assert_eq!(tally.n_samples, 2);
    assert!(tally.gaps.len() == 1 && tally.gaps[0].contains("away for"), "{:?}", tally.gaps);
}

#[test]
fn a_half_open_connection_is_replaced() {
    let mut source = server(0);
    let address = source.address();
    let mut davis = NetworkDavis::new(&address.to_string(), QUICK);
    davis.prepare().unwrap();
    assert!(source.wait_for_clients(1, PATIENCE));
    source.send_events(run(0, 1).as_slice()).unwrap();
    let (outlet, inlet) = channel(1 << 20);
    davis.start(outlet).unwrap();
    assert_eq!(next_events(&inlet).len(), 1);
    // No data for longer than the allowed silence: the client reconnects.
    assert!(source.wait_for_clients(2, PATIENCE));
    source.send_events(run(9, 1).as_slice()).unwrap();
    assert_eq!(next_events(&inlet), run(9, 1));
    assert!(!davis.finish().unwrap().gaps.is_empty());
}

#[test]
fn a_server_that_does_not_return_is_an_error() {
    let mut source = server(0);
    let patience = NetworkDavisTimeouts { reconnect: Duration::ZERO, ..QUICK };
    let mut davis = NetworkDavis::new(&source.address().to_string(), patience);
    davis.prepare().unwrap();
    assert!(source.wait_for_clients(1, PATIENCE));
    source.send_events(run(0, 1).as_slice()).unwrap();
    let (outlet, inlet) = channel(1 << 20);
    davis.start(outlet).unwrap();
    drop(source);
    assert!(matches!(inlet.take(PATIENCE), Received::Sample(_)));
    assert!(matches!(inlet.take(PATIENCE), Received::Closed));
    let message = davis.progress().unwrap_err().to_string();
    assert!(message.contains("tcp://127.0.0.1") && message.contains("emulate davis"), "{message}");
    davis.abort();
    davis.abort();
}

#[test]
fn an_absent_server_and_another_program_are_distinguished_before_anything_moves() {
    let absent = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    let finding = &NetworkDavis::new(&absent.to_string(), QUICK).check()[0];
    assert!(
        finding.verdict == Verdict::Bad && finding.description.contains("refused"),
        "{finding:?}"
    );
    let mute = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = mute.local_addr().unwrap().to_string();
    let finding = &NetworkDavis::new(&address, QUICK).check()[0];
    assert!(
        finding.verdict == Verdict::Bad && finding.description.contains("header"),
        "{finding:?}"
    );
}

#[test]
fn a_slow_reader_loses_only_counted_packets() {
    let mut source = server(0);
    let mut davis = NetworkDavis::new(&source.address().to_string(), QUICK);
    davis.prepare().unwrap();
    assert!(source.wait_for_clients(1, PATIENCE));
    // Capacity for one packet: the others are dropped while none is taken.
    let (outlet, inlet) = channel(1);
    for k in 0..20 {
        source.send_events(run(100 * k, 50).as_slice()).unwrap();
    }
    davis.start(outlet).unwrap();
    while davis.progress().unwrap().n_dropped < 19 {
        std::thread::yield_now();
    }
    let tally = davis.finish().unwrap();
    assert_eq!((tally.n_samples, tally.n_dropped), (1, 19));
    assert_eq!(next_events(&inlet), run(0, 50));
}
