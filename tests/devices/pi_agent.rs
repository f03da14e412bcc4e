//! The agent of the Pi's camera and its host: keys, unpaired clients, limits and delivery of
//! frames.

use evrig::delivery::{Coding, Focus, RgbDelivery};
use evrig::device::pi::{AgentAddress, NetworkPi, PiTimeouts, pairing};
use evrig::geometry::Size;
use evrig::pi::agent::{Agent, AgentError, BacklogLimits, Service, Spool};
use evrig::pi::keys::Keys;
use evrig::pi::order::{CaptureOrder, CaptureSettings, Delivery};
use evrig::pi::source::{FrameSource, SourceError, Synthetic};
use evrig::pi::wire::{self, Message, MessageDecoder};
use evrig::pi_camera::PiFrame;
use evrig::record::Verdict;
use evrig::record::recorder::{Received, Recorder, RecorderSample, SampleReceiver, channel};
use evrig::time::Span;
use evrig::units::Hertz;
use std::io::{Read, Write};
use std::net::{Shutdown, SocketAddr, TcpStream};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel as signal};
use std::time::Duration;

/// Longer than any operation here.
const DEADLINE: Duration = Duration::from_secs(60);
const LOCAL: &str = "127.0.0.1:0";

fn settings() -> CaptureSettings {
    CaptureSettings {
        size: Size::new(64, 48),
        frame_rate: Hertz(120.0),
        exposure: Span::from_micros(4_000),
        gain: 1.0,
        raw: true,
        rgb: true,
    }
}

fn order(coding: Coding, rgb: RgbDelivery) -> CaptureOrder {
    CaptureOrder { settings: settings(), focus: Focus::Once, delivery: Delivery { coding, rgb } }
}

fn local(agent: &Agent) -> AgentAddress {
    AgentAddress::Local { address: agent.address().to_string() }
}

/// A camera that ends after a number of frames and signals when the last one was taken.
struct FiniteSource {
    inner: Synthetic,
    n_left: u64,
    ended: Sender<()>,
}

fn counted(n_frames: u64) -> (Box<dyn FrameSource>, Receiver<()>) {
    let (ended, end) = signal();
    (Box::new(FiniteSource { inner: Synthetic::unpaced(n_frames), n_left: n_frames, ended }), end)
}

impl FrameSource for FiniteSource {
    fn describe(&self) -> String {
        self.inner.describe()
    }

    fn configure(&mut self, settings: &CaptureSettings) -> Result<CaptureSettings, SourceError> {
        self.inner.configure(settings)
    }

    fn next(&mut self) -> Result<Option<PiFrame>, SourceError> {
        let frame = self.inner.next()?;
        // The previous frame is stored or dropped once the next is requested.
        if frame.is_some() {
            self.n_left -= 1;
        } else if self.n_left == 0 {
            let _ = self.ended.send(());
        }
        Ok(frame)
    }
}

fn take_all(inlet: &SampleReceiver) -> Vec<RecorderSample> {
    let mut samples = Vec::new();
    loop {
        match inlet.take(DEADLINE) {
            Received::Sample(sample) => samples.push(sample),
            Received::Nothing => panic!("the recorder neither delivered nor ended"),
            Received::Closed => return samples,
        }
    }
}

/// Records until the camera has no more frames; returns every sample and the recorder's tally.
fn record(
    pi: &mut NetworkPi,
    end: &Receiver<()>,
) -> (Vec<RecorderSample>, evrig::record::recorder::RecorderTally) {
    let (outlet, inlet) = channel(1 << 30);
    pi.prepare().unwrap();
    pi.start(outlet).unwrap();
    end.recv_timeout(DEADLINE).unwrap();
    let tally = pi.finish().unwrap();
    (take_all(&inlet), tally)
}

/// Compares the samples of a frame with the synthetic camera's pattern.
fn assert_images(frame: &PiFrame, has_raw: bool, has_rgb: bool) {
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

fn frames(samples: &[RecorderSample]) -> Vec<&PiFrame> {
    let frames = samples.iter().filter_map(|sample| match sample {
        RecorderSample::Frame { frame, .. } => Some(&**frame),
        _ => None,
    });
    frames.collect()
}

fn spool(folder: &Path, memory_bytes: usize) -> BacklogLimits {
    let spool = Spool { directory: folder.to_owned(), limit_bytes: 1 << 30 };
    BacklogLimits { memory_bytes, spool: Some(spool) }
}

fn serve(limits: BacklogLimits, camera: Box<dyn FrameSource>) -> Agent {
    let service = Service { limits, ..Service::local(LOCAL.parse().unwrap()) };
    Agent::open(service, camera).unwrap()
}

#[test]
fn with_a_spool_no_frame_is_lost_however_slow_the_network_is() {
    let folder = tempfile::tempdir().unwrap();
    let (camera, end) = counted(500);
    let agent = serve(spool(folder.path(), 1), camera);
    let mut pi = NetworkPi::new(
        local(&agent),
        order(Coding::Lossless, RgbDelivery::Live),
        PiTimeouts::default(),
    );
    let (samples, tally) = record(&mut pi, &end);
    let frames = frames(&samples);
    assert_eq!((frames.len(), tally.n_samples, tally.n_dropped), (500, 500, 0));
    for (k, frame) in frames.iter().enumerate() {
        assert_eq!(frame.metadata.sequence, k as u64, "in order");
        assert_images(frame, true, true);
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn rgb_after_the_take_arrives_late_and_complete() {
    let folder = tempfile::tempdir().unwrap();
    let (camera, end) = counted(100);
    let agent = serve(spool(folder.path(), 1 << 20), camera);
    for coding in [Coding::Plain, Coding::Lossless] {
        let order = order(coding, RgbDelivery::AfterTake);
        let mut pi = NetworkPi::new(local(&agent), order, PiTimeouts::default());
        if coding == Coding::Lossless {
            // The first take used all frames of the camera.
            assert!(pi.prepare().is_ok());
            continue;
        }
        let (samples, _) = record(&mut pi, &end);
        let live = frames(&samples);
        assert_eq!(live.len(), 100);
        live.iter().for_each(|frame| assert_images(frame, true, false));
        let first_late = samples
            .iter()
            .position(|sample| matches!(sample, RecorderSample::LateRgb { .. }))
            .unwrap();
        let is_live = |sample: &RecorderSample| matches!(sample, RecorderSample::Frame { .. });
        assert!(!samples[first_late..].iter().any(is_live), "late frames come after the live ones");
        let mut n_late = 0;
        for sample in &samples[first_late..] {
            if let RecorderSample::LateRgb { frame, .. } = sample {
                assert_images(frame, false, true);
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
    let mut pi = NetworkPi::new(local(&agent), order, PiTimeouts::default());
    pi.prepare().unwrap();
    let (outlet, _inlet) = channel(1 << 20);
    let message = pi.start(outlet).unwrap_err().to_string();
    assert!(message.contains("--spool DIR"), "{message}");
}

#[test]
fn every_nth_rgb_frame_arrives_with_its_raw_frame() {
    let (camera, end) = counted(50);
    let agent = serve(BacklogLimits { memory_bytes: 1 << 28, spool: None }, camera);
    let order = order(Coding::Lossless, RgbDelivery::Every(4));
    let mut pi = NetworkPi::new(local(&agent), order, PiTimeouts::default());
    let (samples, _) = record(&mut pi, &end);
    let frames = frames(&samples);
    assert_eq!(frames.len(), 50);
    for frame in frames {
        assert_images(frame, true, frame.metadata.sequence % 4 == 0);
    }
}

#[test]
fn both_clocks_of_the_pi_are_read_before_during_and_after_a_take() {
    let (camera, end) = counted(20);
    let agent = serve(BacklogLimits { memory_bytes: 1 << 28, spool: None }, camera);
    let mut pi = NetworkPi::local(&agent.address().to_string(), settings(), PiTimeouts::default());
    let (samples, _) = record(&mut pi, &end);
    let mut n = 0;
    for sample in &samples {
        if let RecorderSample::Clock(reading) = sample {
            let raw = reading.pi_raw.unwrap();
            assert!(reading.pi.boottime_before <= reading.pi.boottime_after);
            assert!(raw.monotonic_raw_before <= raw.monotonic_raw_after);
            assert!(reading.asked.monotonic <= reading.answered.monotonic);
            n += 1;
        }
    }
    assert!(n >= 10, "{n}");
    let is_note = |sample: &RecorderSample| matches!(sample, RecorderSample::Note { text, .. } if text.contains("clock after the take"));
    assert!(samples.iter().any(is_note));
}

struct TlsSetup {
    agent: Agent,
    folder: tempfile::TempDir,
}

impl TlsSetup {
    fn new() -> Self {
        Self::with(Box::new(Synthetic::unpaced(u64::MAX)))
    }

    fn with(camera: Box<dyn FrameSource>) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let pair = pairing::pair(folder.path()).unwrap();
        let keys = Some(Keys::read(&pair.agent).unwrap());
        let service = Service { keys, ..Service::local("0.0.0.0:0".parse().unwrap()) };
        let agent = Agent::open(service, camera).unwrap();
        Self { agent, folder }
    }

    fn address(&self) -> SocketAddr {
        SocketAddr::from(([127, 0, 0, 1], self.agent.address().port()))
    }

    fn pi(&self, keys: &Path) -> NetworkPi {
        let reach =
            AgentAddress::Tls { address: self.address().to_string(), keys: keys.to_owned() };
        let order = order(Coding::Lossless, RgbDelivery::Live);
        NetworkPi::new(reach, order, PiTimeouts::default())
    }

    fn host_keys(&self) -> std::path::PathBuf {
        self.folder.path().join("host")
    }
}

#[test]
fn a_paired_host_records_over_tls() {
    let setup = TlsSetup::new();
    let mut pi = setup.pi(&setup.host_keys());
    let findings = pi.check();
    assert!(findings.iter().all(|finding| finding.verdict == Verdict::Good), "{findings:?}");
    assert!(findings[1].description.contains("Mbit/s"), "{findings:?}");
    pi.prepare().unwrap();
    let (outlet, inlet) = channel(1 << 30);
    pi.start(outlet).unwrap();
    for _ in 0..20 {
        assert!(matches!(inlet.take(DEADLINE), Received::Sample(_)));
    }
    assert!(pi.finish().unwrap().n_samples > 0);
}

#[test]
fn unpaired_clients_get_nothing_and_cannot_lock_out_the_paired_host() {
    let setup = TlsSetup::new();
    let others = tempfile::tempdir().unwrap();
    let other = pairing::pair(others.path()).unwrap();
    let message = setup.pi(&other.host).check()[0].description.clone();
    assert!(message.contains("of another pair"), "{message}");
    // Without TLS and with random bytes: no data of the camera is sent.
    for bytes in [wire::preamble().to_vec(), vec![0x5a; 300], Vec::new()] {
        let mut client = TcpStream::connect(setup.address()).unwrap();
        client.set_read_timeout(Some(DEADLINE)).unwrap();
        client.write_all(&bytes).unwrap();
        let _ = client.shutdown(Shutdown::Write);
        let mut received = Vec::new();
        let _ = client.read_to_end(&mut received);
        assert!(received.len() < 16, "at most a TLS alert, not {received:?}");
    }
    let findings = setup.pi(&setup.host_keys()).check();
    assert_eq!(findings[0].verdict, Verdict::Good, "{findings:?}");
}

/// A proxy that records the data of the host; returns its address and, once closed, the data.
fn recording_proxy(server: SocketAddr) -> (SocketAddr, std::thread::JoinHandle<Vec<u8>>) {
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
        let (mut sent, mut buffer) = (Vec::new(), [0; 4096]);
        while let Ok(n @ 1..) = host.read(&mut buffer) {
            sent.extend_from_slice(&buffer[..n]);
            if agent.write_all(&buffer[..n]).is_err() {
                break;
            }
        }
        let _ = agent.shutdown(Shutdown::Both);
        back.join().unwrap();
        sent
    });
    (address, tap)
}

/// A camera that counts how often it was configured.
struct ConfigureCounter(Synthetic, Arc<AtomicUsize>);

impl FrameSource for ConfigureCounter {
    fn describe(&self) -> String {
        self.0.describe()
    }

    fn configure(&mut self, settings: &CaptureSettings) -> Result<CaptureSettings, SourceError> {
        self.1.fetch_add(1, Ordering::SeqCst);
        self.0.configure(settings)
    }

    fn next(&mut self) -> Result<Option<PiFrame>, SourceError> {
        self.0.next()
    }
}

#[test]
fn a_replayed_connection_has_no_effect() {
    let n_configured = Arc::new(AtomicUsize::new(0));
    let camera = ConfigureCounter(Synthetic::unpaced(u64::MAX), Arc::clone(&n_configured));
    let setup = TlsSetup::with(Box::new(camera));
    let (address, tap) = recording_proxy(setup.address());
    let reach = AgentAddress::Tls { address: address.to_string(), keys: setup.host_keys() };
    let order = order(Coding::Lossless, RgbDelivery::Live);
    let mut pi = NetworkPi::new(reach, order, PiTimeouts::default());
    pi.prepare().unwrap();
    drop(pi);
    let sent = tap.join().unwrap();
    assert_eq!(n_configured.load(Ordering::SeqCst), 1);
    assert!(sent.len() > 1_000, "a handshake with two certificates, and an order: {}", sent.len());
    let mut replay = TcpStream::connect(setup.address()).unwrap();
    replay.set_read_timeout(Some(DEADLINE)).unwrap();
    // The agent may close before it has read everything.
    let _ = replay.write_all(&sent);
    let mut received = Vec::new();
    let _ = replay.read_to_end(&mut received);
    assert!(received.len() < 4_096, "its own handshake and an alert: {} bytes", received.len());
    // The connection is closed, so nothing is pending.
    assert_eq!(n_configured.load(Ordering::SeqCst), 1, "the order was executed once");
    let findings = setup.pi(&setup.host_keys()).check();
    assert_eq!(findings[0].verdict, Verdict::Good, "{findings:?}");
}

#[test]
fn an_older_tls_version_is_refused_with_its_alert() {
    let setup = TlsSetup::new();
    // A client of TLS 1.2 at most: version 3.3 without the extension for supported versions.
    let body = [
        [3, 3].as_slice(),
        &[7; 32],
        &[0],
        &[0, 4, 0xc0, 0x2f, 0xc0, 0x2b],
        &[1, 0],
        // Required extensions: groups (x25519) and signatures (ECDSA and RSA with SHA-256).
        &[0, 18, 0, 10, 0, 4, 0, 2, 0, 29, 0, 13, 0, 6, 0, 4, 4, 3, 4, 1],
    ]
    .concat();
    let n = body.len() as u8;
    let hello = [[22, 3, 1, 0, n + 4, 1, 0, 0, n].as_slice(), &body].concat();
    let mut old = TcpStream::connect(setup.address()).unwrap();
    old.set_read_timeout(Some(DEADLINE)).unwrap();
    old.write_all(&hello).unwrap();
    let mut received = Vec::new();
    let _ = old.read_to_end(&mut received);
    // One record: a fatal alert, protocol_version (RFC 8446, section 6).
    assert_eq!(
        received.first().zip(received.get(5..)),
        Some((&21, [2, 70].as_slice())),
        "{received:?}"
    );
}

#[test]
fn clients_that_fail_repeatedly_are_refused_before_any_handshake() {
    let setup = TlsSetup::new();
    let others = tempfile::tempdir().unwrap();
    let other = pairing::pair(others.path()).unwrap();
    let mut pi = setup.pi(&other.host);
    let message: Vec<String> = (0..20).map(|_| pi.check()[0].description.clone()).collect();
    // The first clients get the agent's certificate, the last ones not even that.
    assert!(message[0].contains("of another pair"), "{message:?}");
    assert!(!message[19].contains("of another pair"), "{message:?}");
}

#[test]
fn the_agent_listens_on_other_interfaces_only_with_keys() {
    let open = Agent::serve("0.0.0.0:0".parse().unwrap(), Box::new(Synthetic::paced()));
    let message = open.unwrap_err();
    assert!(matches!(message, AgentError::NotLoopback { .. }));
    assert!(message.to_string().contains("evrig pair"), "{message}");
    let reach = AgentAddress::Local { address: "192.0.2.1:7766".to_owned() };
    let mut pi =
        NetworkPi::new(reach, order(Coding::Plain, RgbDelivery::Live), PiTimeouts::default());
    let message = pi.check()[0].description.clone();
    assert!(message.contains("not encrypted"), "{message}");
}

/// Sends bytes over a plain connection; returns it and the agent's preamble.
fn send_plain(agent: &Agent, bytes: &[u8]) -> (TcpStream, Vec<u8>) {
    let mut line = TcpStream::connect(agent.address()).unwrap();
    line.set_read_timeout(Some(DEADLINE)).unwrap();
    line.write_all(bytes).unwrap();
    let mut preamble = vec![0; wire::PREAMBLE_BYTES];
    line.read_exact(&mut preamble).unwrap();
    (line, preamble)
}

fn last_message(mut line: TcpStream) -> Option<Message> {
    let mut bytes = Vec::new();
    let _ = line.read_to_end(&mut bytes);
    let mut decoder = MessageDecoder::default();
    decoder.push(&bytes);
    let mut last = None;
    while let Ok(Some(message)) = decoder.take() {
        last = Some(message);
    }
    last
}

#[test]
fn a_client_of_another_version_gets_our_version_and_is_disconnected() {
    let agent = Agent::serve(LOCAL.parse().unwrap(), Box::new(Synthetic::unpaced(1))).unwrap();
    let (mut line, preamble) = send_plain(&agent, b"EVRIGPI\0\x01\0\0\0");
    assert_eq!(preamble, wire::preamble());
    assert_eq!(line.read(&mut [0; 1]).unwrap(), 0, "the connection ends");
}

#[test]
fn an_agent_of_another_version_is_refused_with_the_remedy() {
    let listener = std::net::TcpListener::bind(LOCAL).unwrap();
    let address = listener.local_addr().unwrap().to_string();
    let agent = std::thread::spawn(move || {
        let (mut line, _) = listener.accept().unwrap();
        line.write_all(b"EVRIGPI\0\x07\0\0\0").unwrap();
        let _ = line.read_to_end(&mut Vec::new());
    });
    let mut pi = NetworkPi::local(&address, settings(), PiTimeouts::default());
    let message = pi.check()[0].description.clone();
    assert!(message.contains("version 7") && message.contains("same evrig"), "{message}");
    agent.join().unwrap();
}

#[test]
fn oversized_and_malformed_messages_are_refused_and_the_camera_is_released() {
    let agent = Agent::serve(LOCAL.parse().unwrap(), Box::new(Synthetic::unpaced(1))).unwrap();
    let start = wire::encode(&Message::Start);
    for wrong in
        [[0xff_u8; 16].to_vec(), [&start[..8], b"{not a message}".as_slice(), b" "].concat()]
    {
        let (line, _) = send_plain(&agent, &[wire::preamble().as_slice(), &wrong].concat());
        let Some(Message::Refused { because }) = last_message(line) else { panic!("no refusal") };
        assert!(because.contains("message 0"), "{because}");
    }
    let (line, _) = send_plain(&agent, &wire::preamble());
    drop(line);
    let mut pi = NetworkPi::local(&agent.address().to_string(), settings(), PiTimeouts::default());
    assert_eq!(pi.check()[0].verdict, Verdict::Good, "the camera is available to the next host");
}

#[test]
fn a_silent_agent_is_given_up_after_the_timeout() {
    let listener = std::net::TcpListener::bind(LOCAL).unwrap();
    let address = listener.local_addr().unwrap().to_string();
    let patience = PiTimeouts { answer: Duration::from_millis(200), ..PiTimeouts::default() };
    let folder = tempfile::tempdir().unwrap();
    let keys = pairing::pair(folder.path()).unwrap().host;
    for reach in
        [AgentAddress::Local { address: address.clone() }, AgentAddress::Tls { address, keys }]
    {
        let order = order(Coding::Plain, RgbDelivery::Live);
        let mut pi = NetworkPi::new(reach, order, patience);
        assert_eq!(pi.check()[0].verdict, Verdict::Bad);
    }
}
