//! The agent of the Pi's camera and its host: keys, strangers, bounds, and frames that must not be lost.

#![allow(clippy::expect_used, clippy::unwrap_used)]

use evrig::delivery::{Coding, Focus, RgbDelivery};
use evrig::device::pi::{NetworkPi, Patience, Reach};
use evrig::geometry::Size;
use evrig::pi::agent::{Agent, AgentError, Room, Service, Spool};
use evrig::pi::keys::{self, Keys};
use evrig::pi::order::{Delivery, Order, Settings};
use evrig::pi::source::{FrameSource, SourceError, Synthetic};
use evrig::pi::wire::{self, Decoder, Message};
use evrig::pi_camera::PiFrame;
use evrig::record::Verdict;
use evrig::record::recorder::{Inlet, Recorder, Sample, Taken, channel};
use evrig::time::Span;
use evrig::units::Hertz;
use std::io::{Read, Write};
use std::net::{Shutdown, SocketAddr, TcpStream};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel as signal};
use std::time::Duration;

/// Longer than anything here takes; a test that waits so long has failed.
const DEADLINE: Duration = Duration::from_secs(60);
const LOCAL: &str = "127.0.0.1:0";

fn settings() -> Settings {
    Settings {
        size: Size::new(64, 48),
        frame_rate: Hertz(120.0),
        exposure: Span::from_micros(4_000),
        gain: 1.0,
        raw: true,
        rgb: true,
    }
}

fn order(coding: Coding, rgb: RgbDelivery) -> Order {
    Order { settings: settings(), focus: Focus::Once, delivery: Delivery { coding, rgb } }
}

fn local(agent: &Agent) -> Reach {
    Reach::Local { address: agent.address().to_string() }
}

/// A camera whose takes end after so many frames; it says when the last one was taken.
struct Counted {
    inner: Synthetic,
    n_left: u64,
    ended: Sender<()>,
}

fn counted(n_frames: u64) -> (Box<dyn FrameSource>, Receiver<()>) {
    let (ended, end) = signal();
    (Box::new(Counted { inner: Synthetic::unpaced(n_frames), n_left: n_frames, ended }), end)
}

impl FrameSource for Counted {
    fn describe(&self) -> String {
        self.inner.describe()
    }

    fn configure(&mut self, settings: &Settings) -> Result<Settings, SourceError> {
        self.inner.configure(settings)
    }

    fn next(&mut self) -> Result<Option<PiFrame>, SourceError> {
        let frame = self.inner.next()?;
        // The frame that was handed out before is kept or dropped once the next is asked for.
        if frame.is_some() {
            self.n_left -= 1;
        } else if self.n_left == 0 {
            let _ = self.ended.send(());
        }
        Ok(frame)
    }
}

fn take_all(inlet: &Inlet) -> Vec<Sample> {
    let mut samples = Vec::new();
    loop {
        match inlet.take(DEADLINE) {
            Taken::Sample(sample) => samples.push(sample),
            Taken::Nothing => panic!("the recorder neither delivered nor ended"),
            Taken::Closed => return samples,
        }
    }
}

/// Records until the camera has no more frames; every sample comes back, and the recorder's tally.
fn record(pi: &mut NetworkPi, end: &Receiver<()>) -> (Vec<Sample>, evrig::record::recorder::Tally) {
    let (outlet, inlet) = channel(1 << 30);
    pi.prepare().unwrap();
    pi.start(outlet).unwrap();
    end.recv_timeout(DEADLINE).unwrap();
    let tally = pi.finish().unwrap();
    (take_all(&inlet), tally)
}

/// The synthetic camera's pictures of one frame.
fn assert_pictures(frame: &PiFrame, has_raw: bool, has_rgb: bool) {
    let size = frame.metadata.size;
    let k = frame.metadata.sequence;
    assert_eq!((frame.raw10.is_some(), frame.rgb.is_some()), (has_raw, has_rgb), "frame {k}");
    let sample = |column, row| Synthetic::sample(k, column, row);
    if let Some(raw10) = &frame.raw10 {
        let samples = evrig::raw10::unpack(raw10, size, raw10.len() / 48).unwrap();
        assert_eq!(samples[5 * 64 + 9], sample(9, 5));
        assert_eq!(samples.last(), Some(&sample(63, 47)));
    }
    if let Some(rgb) = &frame.rgb {
        assert_eq!(rgb[3 * (7 * 64 + 3)], (sample(3, 7) >> 2) as u8);
        assert_eq!(rgb.len(), 3 * 64 * 48);
    }
}

fn frames(samples: &[Sample]) -> Vec<&PiFrame> {
    let frames = samples.iter().filter_map(|sample| match sample {
        Sample::Frame { frame, .. } => Some(&**frame),
        _ => None,
    });
    frames.collect()
}

fn spool(folder: &Path, memory_bytes: usize) -> Room {
    let spool = Spool { directory: folder.to_owned(), limit_bytes: 1 << 30 };
    Room { memory_bytes, spool: Some(spool) }
}

fn serve(room: Room, camera: Box<dyn FrameSource>) -> Agent {
    let service = Service { room, ..Service::local(LOCAL.parse().unwrap()) };
    Agent::open(service, camera).unwrap()
}

#[test]
fn with_a_spool_no_frame_is_lost_however_slow_the_network_is() {
    let folder = tempfile::tempdir().unwrap();
    let (camera, end) = counted(500);
    let agent = serve(spool(folder.path(), 1), camera);
    let mut pi = NetworkPi::reached(
        local(&agent),
        order(Coding::Lossless, RgbDelivery::Live),
        Patience::default(),
    );
    let (samples, tally) = record(&mut pi, &end);
    let frames = frames(&samples);
    assert_eq!((frames.len(), tally.n_samples, tally.n_dropped), (500, 500, 0));
    for (k, frame) in frames.iter().enumerate() {
        assert_eq!(frame.metadata.sequence, k as u64, "in order");
        assert_pictures(frame, true, true);
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn rgb_after_the_take_comes_late_and_whole() {
    let folder = tempfile::tempdir().unwrap();
    let (camera, end) = counted(100);
    let agent = serve(spool(folder.path(), 1 << 20), camera);
    for coding in [Coding::Plain, Coding::Lossless] {
        let order = order(coding, RgbDelivery::AfterTake);
        let mut pi = NetworkPi::reached(local(&agent), order, Patience::default());
        if coding == Coding::Lossless {
            // The camera has given all its frames to the first take.
            assert!(pi.prepare().is_ok());
            continue;
        }
        let (samples, _) = record(&mut pi, &end);
        let live = frames(&samples);
        assert_eq!(live.len(), 100);
        live.iter().for_each(|frame| assert_pictures(frame, true, false));
        let first_late =
            samples.iter().position(|sample| matches!(sample, Sample::LateRgb { .. })).unwrap();
        let is_live = |sample: &Sample| matches!(sample, Sample::Frame { .. });
        assert!(!samples[first_late..].iter().any(is_live), "late ones come after the live ones");
        let mut n_late = 0;
        for sample in &samples[first_late..] {
            if let Sample::LateRgb { frame, .. } = sample {
                assert_pictures(frame, false, true);
                assert_eq!(frame.metadata.sequence, n_late);
                n_late += 1;
            }
        }
        assert_eq!(n_late, 100);
    }
}

#[test]
fn rgb_after_the_take_without_a_spool_is_refused_with_the_remedy() {
    let agent = Agent::serve(LOCAL.parse().unwrap(), Box::new(Synthetic::unpaced(9))).unwrap();
    let order = order(Coding::Lossless, RgbDelivery::AfterTake);
    let mut pi = NetworkPi::reached(local(&agent), order, Patience::default());
    pi.prepare().unwrap();
    let (outlet, _inlet) = channel(1 << 20);
    let said = pi.start(outlet).unwrap_err().to_string();
    assert!(said.contains("--spool DIR"), "{said}");
}

#[test]
fn every_nth_rgb_picture_comes_with_its_raw_one() {
    let (camera, end) = counted(50);
    let agent = serve(Room { memory_bytes: 1 << 28, spool: None }, camera);
    let order = order(Coding::Lossless, RgbDelivery::Every(4));
    let mut pi = NetworkPi::reached(local(&agent), order, Patience::default());
    let (samples, _) = record(&mut pi, &end);
    let frames = frames(&samples);
    assert_eq!(frames.len(), 50);
    for frame in frames {
        assert_pictures(frame, true, frame.metadata.sequence % 4 == 0);
    }
}

#[test]
fn clocks_are_read_before_during_and_after_on_both_of_the_pis_clocks() {
    let (camera, end) = counted(20);
    let agent = serve(Room { memory_bytes: 1 << 28, spool: None }, camera);
    let mut pi = NetworkPi::new(&agent.address().to_string(), settings(), Patience::default());
    let (samples, _) = record(&mut pi, &end);
    let mut n = 0;
    for sample in &samples {
        if let Sample::Clock(reading) = sample {
            let raw = reading.pi_raw.unwrap();
            assert!(reading.pi.boottime_before <= reading.pi.boottime_after);
            assert!(raw.monotonic_raw_before <= raw.monotonic_raw_after);
            assert!(reading.asked.monotonic <= reading.answered.monotonic);
            n += 1;
        }
    }
    assert!(n >= 10, "{n}");
    let is_note = |sample: &Sample| matches!(sample, Sample::Note { text, .. } if text.contains("clock after the take"));
    assert!(samples.iter().any(is_note));
}

struct Encrypted {
    agent: Agent,
    folder: tempfile::TempDir,
}

impl Encrypted {
    fn new() -> Self {
        Self::with(Box::new(Synthetic::unpaced(u64::MAX)))
    }

    fn with(camera: Box<dyn FrameSource>) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let pair = keys::pair(folder.path()).unwrap();
        let keys = Some(Keys::read(&pair.agent).unwrap());
        let service = Service { keys, ..Service::local("0.0.0.0:0".parse().unwrap()) };
        let agent = Agent::open(service, camera).unwrap();
        Self { agent, folder }
    }

    fn address(&self) -> SocketAddr {
        SocketAddr::from(([127, 0, 0, 1], self.agent.address().port()))
    }

    fn pi(&self, keys: &Path) -> NetworkPi {
        let reach = Reach::Tls { address: self.address().to_string(), keys: keys.to_owned() };
        let order = order(Coding::Lossless, RgbDelivery::Live);
        NetworkPi::reached(reach, order, Patience::default())
    }

    fn host_keys(&self) -> std::path::PathBuf {
        self.folder.path().join("host")
    }
}

#[test]
fn a_paired_host_records_over_tls() {
    let bench = Encrypted::new();
    let mut pi = bench.pi(&bench.host_keys());
    let findings = pi.check();
    assert!(findings.iter().all(|finding| finding.verdict == Verdict::Good), "{findings:?}");
    assert!(findings[1].description.contains("Mbit/s"), "{findings:?}");
    pi.prepare().unwrap();
    let (outlet, inlet) = channel(1 << 30);
    pi.start(outlet).unwrap();
    for _ in 0..20 {
        assert!(matches!(inlet.take(DEADLINE), Taken::Sample(_)));
    }
    assert!(pi.finish().unwrap().n_samples > 0);
}

#[test]
fn strangers_get_nothing_and_cannot_keep_the_paired_host_out() {
    let bench = Encrypted::new();
    let others = tempfile::tempdir().unwrap();
    let other = keys::pair(others.path()).unwrap();
    let said = bench.pi(&other.host).check()[0].description.clone();
    assert!(said.contains("of another pair"), "{said}");
    // Without TLS at all, and with noise: not a byte of the camera comes back.
    for words in [wire::preamble().to_vec(), vec![0x5a; 300], Vec::new()] {
        let mut stranger = TcpStream::connect(bench.address()).unwrap();
        stranger.set_read_timeout(Some(DEADLINE)).unwrap();
        stranger.write_all(&words).unwrap();
        let _ = stranger.shutdown(Shutdown::Write);
        let mut heard = Vec::new();
        let _ = stranger.read_to_end(&mut heard);
        assert!(heard.len() < 16, "a TLS alert at most, not {heard:?}");
    }
    let findings = bench.pi(&bench.host_keys()).check();
    assert_eq!(findings[0].verdict, Verdict::Good, "{findings:?}");
}

/// A wire that keeps what the host says: its address, and the words once both ends have closed.
fn tapped(server: SocketAddr) -> (SocketAddr, std::thread::JoinHandle<Vec<u8>>) {
    let listener = std::net::TcpListener::bind(LOCAL).unwrap();
    let address = listener.local_addr().unwrap();
    let tap = std::thread::spawn(move || {
        let (mut host, _) = listener.accept().unwrap();
        let mut agent = TcpStream::connect(server).unwrap();
        let (mut from, mut to) = (agent.try_clone().unwrap(), host.try_clone().unwrap());
        let back = std::thread::spawn(move || {
            let _ = std::io::copy(&mut from, &mut to);
            let _ = to.shutdown(Shutdown::Both);
        });
        let (mut words, mut buffer) = (Vec::new(), [0; 4096]);
        while let Ok(n @ 1..) = host.read(&mut buffer) {
            words.extend_from_slice(&buffer[..n]);
            if agent.write_all(&buffer[..n]).is_err() {
                break;
            }
        }
        let _ = agent.shutdown(Shutdown::Both);
        back.join().unwrap();
        words
    });
    (address, tap)
}

/// A camera that counts how often it was set up.
struct SetUp(Synthetic, Arc<AtomicUsize>);

impl FrameSource for SetUp {
    fn describe(&self) -> String {
        self.0.describe()
    }

    fn configure(&mut self, settings: &Settings) -> Result<Settings, SourceError> {
        self.1.fetch_add(1, Ordering::SeqCst);
        self.0.configure(settings)
    }

    fn next(&mut self) -> Result<Option<PiFrame>, SourceError> {
        self.0.next()
    }
}

#[test]
fn words_that_were_overheard_and_said_again_move_nothing() {
    let n_set_up = Arc::new(AtomicUsize::new(0));
    let camera = SetUp(Synthetic::unpaced(u64::MAX), Arc::clone(&n_set_up));
    let bench = Encrypted::with(Box::new(camera));
    let (address, tap) = tapped(bench.address());
    let reach = Reach::Tls { address: address.to_string(), keys: bench.host_keys() };
    let order = order(Coding::Lossless, RgbDelivery::Live);
    let mut pi = NetworkPi::reached(reach, order, Patience::default());
    pi.prepare().unwrap();
    drop(pi);
    let words = tap.join().unwrap();
    assert_eq!(n_set_up.load(Ordering::SeqCst), 1);
    assert!(
        words.len() > 1_000,
        "a handshake with two certificates, and an order: {}",
        words.len()
    );
    let mut replay = TcpStream::connect(bench.address()).unwrap();
    replay.set_read_timeout(Some(DEADLINE)).unwrap();
    // The agent may close before it has heard everything.
    let _ = replay.write_all(&words);
    let mut heard = Vec::new();
    let _ = replay.read_to_end(&mut heard);
    assert!(heard.len() < 4_096, "its own handshake and an alert: {} bytes", heard.len());
    // The line is closed, so nothing of it is still under way.
    assert_eq!(n_set_up.load(Ordering::SeqCst), 1, "the order was heard once");
    let findings = bench.pi(&bench.host_keys()).check();
    assert_eq!(findings[0].verdict, Verdict::Good, "{findings:?}");
}

#[test]
fn an_older_tls_is_refused_by_name() {
    let bench = Encrypted::new();
    // A client that speaks TLS 1.2 at most: version 3.3, and no list of supported versions behind it.
    let body = [
        [3, 3].as_slice(),
        &[7; 32],
        &[0],
        &[0, 4, 0xc0, 0x2f, 0xc0, 0x2b],
        &[1, 0],
        // Groups (x25519) and signatures (ECDSA and RSA with SHA-256), without which none is heard.
        &[0, 18, 0, 10, 0, 4, 0, 2, 0, 29, 0, 13, 0, 6, 0, 4, 4, 3, 4, 1],
    ]
    .concat();
    let n = body.len() as u8;
    let hello = [[22, 3, 1, 0, n + 4, 1, 0, 0, n].as_slice(), &body].concat();
    let mut old = TcpStream::connect(bench.address()).unwrap();
    old.set_read_timeout(Some(DEADLINE)).unwrap();
    old.write_all(&hello).unwrap();
    let mut heard = Vec::new();
    let _ = old.read_to_end(&mut heard);
    // One record: a fatal alert, protocol_version (RFC 8446, section 6).
    assert_eq!(heard.first().zip(heard.get(5..)), Some((&21, [2, 70].as_slice())), "{heard:?}");
}

#[test]
fn who_fails_again_and_again_is_shut_out_before_any_handshake() {
    let bench = Encrypted::new();
    let others = tempfile::tempdir().unwrap();
    let other = keys::pair(others.path()).unwrap();
    let mut pi = bench.pi(&other.host);
    let said: Vec<String> = (0..20).map(|_| pi.check()[0].description.clone()).collect();
    // The agent's certificate is seen at first, and in the end not even that.
    assert!(said[0].contains("of another pair"), "{said:?}");
    assert!(!said[19].contains("of another pair"), "{said:?}");
}

#[test]
fn the_agent_listens_beyond_this_machine_only_with_keys() {
    let open = Agent::serve("0.0.0.0:0".parse().unwrap(), Box::new(Synthetic::paced()));
    let said = open.unwrap_err();
    assert!(matches!(said, AgentError::NotLoopback { .. }));
    assert!(said.to_string().contains("evrig pair"), "{said}");
    let reach = Reach::Local { address: "192.0.2.1:7766".to_owned() };
    let mut pi =
        NetworkPi::reached(reach, order(Coding::Plain, RgbDelivery::Live), Patience::default());
    let said = pi.check()[0].description.clone();
    assert!(said.contains("not encrypted"), "{said}");
}

/// A connection that speaks for itself.
fn speak(agent: &Agent, words: &[u8]) -> (TcpStream, Vec<u8>) {
    let mut line = TcpStream::connect(agent.address()).unwrap();
    line.set_read_timeout(Some(DEADLINE)).unwrap();
    line.write_all(words).unwrap();
    let mut preamble = vec![0; wire::PREAMBLE_BYTES];
    line.read_exact(&mut preamble).unwrap();
    (line, preamble)
}

fn last_message(mut line: TcpStream) -> Option<Message> {
    let mut bytes = Vec::new();
    let _ = line.read_to_end(&mut bytes);
    let mut decoder = Decoder::default();
    decoder.push(&bytes);
    let mut last = None;
    while let Ok(Some(message)) = decoder.take() {
        last = Some(message);
    }
    last
}

#[test]
fn another_version_is_told_ours_and_let_go() {
    let agent = Agent::serve(LOCAL.parse().unwrap(), Box::new(Synthetic::unpaced(1))).unwrap();
    let (mut line, preamble) = speak(&agent, b"EVRIGPI\0\x01\0\0\0");
    assert_eq!(preamble, wire::preamble());
    assert_eq!(line.read(&mut [0; 1]).unwrap(), 0, "the connection ends");
}

#[test]
fn a_host_of_another_version_says_what_to_do() {
    let listener = std::net::TcpListener::bind(LOCAL).unwrap();
    let address = listener.local_addr().unwrap().to_string();
    let agent = std::thread::spawn(move || {
        let (mut line, _) = listener.accept().unwrap();
        line.write_all(b"EVRIGPI\0\x07\0\0\0").unwrap();
        let _ = line.read_to_end(&mut Vec::new());
    });
    let mut pi = NetworkPi::new(&address, settings(), Patience::default());
    let said = pi.check()[0].description.clone();
    assert!(said.contains("version 7") && said.contains("same evrig"), "{said}");
    agent.join().unwrap();
}

#[test]
fn oversize_and_senseless_messages_are_refused_and_the_camera_is_free_again() {
    let agent = Agent::serve(LOCAL.parse().unwrap(), Box::new(Synthetic::unpaced(1))).unwrap();
    let start = wire::encode(&Message::Start);
    for wrong in
        [[0xff_u8; 16].to_vec(), [&start[..8], b"{not a message}".as_slice(), b" "].concat()]
    {
        let (line, _) = speak(&agent, &[wire::preamble().as_slice(), &wrong].concat());
        let Some(Message::Refused { because }) = last_message(line) else { panic!("no refusal") };
        assert!(because.contains("message 0"), "{because}");
    }
    let (line, _) = speak(&agent, &wire::preamble());
    drop(line);
    let mut pi = NetworkPi::new(&agent.address().to_string(), settings(), Patience::default());
    assert_eq!(pi.check()[0].verdict, Verdict::Good, "the next host waits for the last to leave");
}

#[test]
fn an_agent_that_is_mute_costs_the_host_its_patience_and_no_more() {
    let listener = std::net::TcpListener::bind(LOCAL).unwrap();
    let address = listener.local_addr().unwrap().to_string();
    let patience = Patience { answer: Duration::from_millis(200), ..Patience::default() };
    let folder = tempfile::tempdir().unwrap();
    let keys = keys::pair(folder.path()).unwrap().host;
    for reach in [Reach::Local { address: address.clone() }, Reach::Tls { address, keys }] {
        let order = order(Coding::Plain, RgbDelivery::Live);
        let mut pi = NetworkPi::reached(reach, order, patience);
        assert_eq!(pi.check()[0].verdict, Verdict::Bad);
    }
}
