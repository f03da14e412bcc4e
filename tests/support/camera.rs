//! An event camera on TCP whose events encode their own number, so that missing, altered and
//! misplaced events are found.

use evrig::device::stream_server::StreamServer;
use evrig::event::{Event, Events};
use evrig::format::aedat4::{Compression, Content, Reader, StreamSpec};
use evrig::geometry::Size;
use std::path::Path;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, TryRecvError, channel};
use std::thread::JoinHandle;
use std::time::Duration;

/// Events come 100 us apart, in packets of 5 ms.
pub const EVENT_US: i64 = 100;
pub const PACKET_EVENTS: i64 = 50;
pub const PACKET: Duration = Duration::from_millis(5);
const PATIENCE: Duration = Duration::from_secs(120);

/// The event of number `n`, which its timestamp encodes.
pub fn event(n: i64) -> Event {
    let place = n.unsigned_abs() as usize;
    Event {
        t: n * EVENT_US,
        x: (place % 346) as u16,
        y: (place / 346 % 260) as u16,
        on: n % 3 == 0,
    }
}

/// An event camera that reports every packet it has sent.
pub struct NumberedCamera {
    pub address: String,
    sent: Receiver<u64>,
    n_sent: u64,
    stop: Option<Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl NumberedCamera {
    /// Sends once `n_clients` have connected.
    pub fn start(n_clients: u64) -> Self {
        let spec = StreamSpec::events(Size::DAVIS346, "DAVIS346_1");
        let mut server = StreamServer::bind("127.0.0.1:0", &spec, Compression::None).unwrap();
        let address = server.address().to_string();
        let (report, sent) = channel();
        let (stop, stopped) = channel::<()>();
        let thread = std::thread::spawn(move || {
            // A recorder that was killed early never connects again; then `end` stops this thread.
            while !server.wait_for_clients(n_clients, PACKET) {
                if stopped.try_recv() == Err(TryRecvError::Disconnected) {
                    return;
                }
            }
            for packet in 0.. {
                let first = packet * PACKET_EVENTS;
                let events: Events = (first..first + PACKET_EVENTS).map(event).collect();
                server.send_events(events.as_slice()).unwrap();
                if report.send(packet as u64 + 1).is_err()
                    || stopped.recv_timeout(PACKET) != Err(RecvTimeoutError::Timeout)
                {
                    return;
                }
            }
        });
        Self { address, sent, n_sent: 0, stop: Some(stop), thread: Some(thread) }
    }

    /// Waits until `n` more packets were sent.
    pub fn wait_for(&mut self, n: u64) {
        let goal = self.n_sent() + n;
        while self.n_sent < goal {
            self.n_sent = self.sent.recv_timeout(PATIENCE).expect("the recorder takes packets");
        }
    }

    /// Packets sent so far.
    pub fn n_sent(&mut self) -> u64 {
        self.n_sent = self.sent.try_iter().last().unwrap_or(self.n_sent);
        self.n_sent
    }

    /// Stops and returns the number of packets sent.
    pub fn end(mut self) -> u64 {
        drop(self.stop.take());
        self.thread.take().unwrap().join().unwrap();
        self.sent.try_iter().last().unwrap_or(self.n_sent)
    }
}

/// The sent events that a file contains.
#[derive(Debug, Default, PartialEq, Eq)]
pub struct FoundEvents {
    /// Number after the last event; 0 for none.
    pub next: i64,
    pub n_gaps: usize,
    /// Events that differ from the one of their timestamp.
    pub n_wrong: usize,
}

/// Reads the recorded events.
pub fn find_events(path: &Path) -> FoundEvents {
    let mut found = FoundEvents::default();
    let mut next: Option<i64> = None;
    for packet in Reader::open(path).into_iter().flatten().map_while(Result::ok) {
        let Content::Events(events) = packet.content else { continue };
        for is in events.as_slice().iter() {
            let n = is.t.div_euclid(EVENT_US);
            found.n_gaps += usize::from(next.is_some_and(|next| next != n));
            found.n_wrong += usize::from(is != event(n));
            next = Some(n.saturating_add(1));
        }
    }
    found.next = next.unwrap_or(0);
    found
}

/// Requires that the recorded events match their timestamps and have no gap between them. Returns
/// the number after the last event, 0 for none.
pub fn check_events(path: &Path) -> i64 {
    let found = find_events(path);
    assert_eq!((found.n_gaps, found.n_wrong), (0, 0), "{found:?}");
    found.next
}
