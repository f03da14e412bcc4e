//! A complete recording: arm on a pty, event camera from a file or a server, frame camera over TCP.

use evrig::delivery::{Focus, RgbDelivery};
use evrig::device::davis::{NetworkDavis, NetworkDavisTimeouts, ReplayDavis, ReplaySpeed};
use evrig::device::dobot::{ArmClient, ArmTimeouts, Magician, port};
use evrig::device::pi::{AgentAddress, NetworkPi, PiTimeouts};
use evrig::device::stream_server::StreamServer;
use evrig::event::Event;
use evrig::format::aedat4::{Compression, StreamSpec};
use evrig::geometry::Size;
use evrig::pi::agent::{Agent, AgentError, BacklogLimits, Service, Spool};
use evrig::pi::order::CaptureSettings;
use evrig::pi::order::{CaptureOrder, Delivery};
use evrig::pi::source::Synthetic;
use evrig::record::recorder::Recorder;
use evrig::record::{
    Devices, Dwells, Prompts, RecordError, RecordOutcome, RecordRequest, RecordState, StopRequest,
    StopToken, record,
};
use evrig::rig::Rig;
use evrig::session::{Session, SessionStatus, StreamKind, verify};
use evrig::sim::arm::{ArmClock, ArmEmulator, ArmOptions};
use evrig::time::Span;
use evrig::trajectory::{OptionalSegments, Trajectory};
use evrig::units::Hertz;
use std::path::Path;
use std::time::Duration;

const STREET: &str = "tests/data/davis346-street.aedat4";
const N_EVENTS: u64 = 78_830;
const NO_DWELLS: Dwells = Dwells { lead_in: Duration::ZERO, tail: Duration::ZERO };

/// Arm and Pi camera with the values that must outlive them.
struct RecordSetup {
    rig: Rig,
    trajectory: Trajectory,
    emulator: ArmEmulator,
    agent: Agent,
}

impl RecordSetup {
    /// The arm's time advances with each request; the Pi delivers frames as fast as they are taken.
    fn new(n_frames: u64) -> Self {
        let options = ArmOptions { homing: Span::from_micros(100_000), ..ArmOptions::default() };
        let clock = ArmClock::Stepped(Span::from_micros(4_000));
        let camera = Box::new(Synthetic::unpaced(n_frames));
        Self {
            rig: Rig::simulated().unwrap(),
            trajectory: Trajectory::find("circle").unwrap(),
            emulator: ArmEmulator::start(options, clock, Vec::new()).unwrap(),
            agent: Agent::serve("127.0.0.1:0".parse().unwrap(), camera).unwrap(),
        }
    }

    fn devices(&self, davis: Box<dyn Recorder>) -> Devices {
        let patience = ArmTimeouts {
            reply: Span::from_micros(200_000),
            n_tries: 3,
            between_polls: Span::ZERO,
        };
        let client = ArmClient::new(Box::new(port::open(self.emulator.port()).unwrap()), patience);
        let mut arm = Magician::over(client, self.rig.arm.clone());
        arm.home(Span::from_micros(20_000_000)).unwrap();
        let address = self.agent.address().to_string();
        let pi = NetworkPi::local(&address, settings(), PiTimeouts::default());
        Devices { arm: Box::new(arm), recorders: vec![davis, Box::new(pi)] }
    }

    fn record(
        &self,
        out: &Path,
        davis: Box<dyn Recorder>,
        stop: &StopToken,
        watch: &mut dyn FnMut(RecordState, f64),
    ) -> Result<RecordOutcome, RecordError> {
        self.record_with(out, &mut self.devices(davis), stop, watch)
    }

    fn record_with(
        &self,
        out: &Path,
        devices: &mut Devices,
        stop: &StopToken,
        watch: &mut dyn FnMut(RecordState, f64),
    ) -> Result<RecordOutcome, RecordError> {
        let path = self.trajectory.path(&self.rig, OptionalSegments::Included).unwrap();
        let (rig, trajectory) = (&self.rig, &self.trajectory);
        let request = RecordRequest {
            rig,
            trajectory,
            path: &path,
            out,
            dwells: NO_DWELLS,
            prompts: Prompts::default(),
        };
        record(request, devices, stop, watch)
    }
}

fn settings() -> CaptureSettings {
    CaptureSettings {
        size: Size::new(48, 32),
        frame_rate: Hertz(120.0),
        exposure: Span::from_micros(4_000),
        gain: 1.0,
        raw: true,
        rgb: true,
    }
}

fn replay() -> Box<dyn Recorder> {
    Box::new(ReplayDavis::new(Path::new(STREET), ReplaySpeed::Unpaced))
}

fn count(session: &Session, name: &str, kind: StreamKind) -> u64 {
    session.stream(kind, name).unwrap_or_else(|error| panic!("{error}")).count
}

fn assert_verifies(session: &Session) {
    let verification = verify(session).unwrap();
    assert!(verification.holds(), "{:#?}", verification.findings);
}

#[test]
fn a_recorded_session_is_complete_and_verifies() {
    let setup = RecordSetup::new(300);
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("session");
    let mut states = Vec::new();
    let mut watch = |state, _| {
        if states.last() != Some(&state) {
            states.push(state);
        }
    };
    let outcome = setup.record(&out, replay(), &StopToken::default(), &mut watch).unwrap();
    assert_eq!(outcome.cut_short, None);
    let expected = [
        RecordState::Preflight,
        RecordState::StartPose,
        RecordState::Cameras,
        RecordState::LeadIn,
        RecordState::Trajectory,
        RecordState::Tail,
        RecordState::Drain,
        RecordState::Seal,
    ];
    assert_eq!(states, expected);
    let session = Session::open(&out).unwrap();
    assert_verifies(&session);
    let manifest = session.manifest();
    assert_eq!(manifest.status, SessionStatus::Complete);
    assert_eq!(count(&session, "real", StreamKind::Events), N_EVENTS);
    assert_eq!(count(&session, "aps", StreamKind::Frames), 59);
    let pi = &manifest.recording.as_ref().unwrap().devices[1];
    assert_eq!(pi.n_samples + pi.n_dropped, 300, "every frame is written or counted as dropped");
    for (name, kind) in [
        ("raw", StreamKind::Frames),
        ("rgb", StreamKind::Frames),
        ("pi-metadata", StreamKind::Metadata),
    ] {
        assert_eq!(count(&session, name, kind), pi.n_samples, "{name}");
    }
    assert_eq!(session.stream(StreamKind::Frames, "raw").unwrap().size, Some(Size::new(48, 32)));
    // At least five readings before and five after the frames.
    assert!(count(&session, "pi-clock", StreamKind::ClockReadings) >= 10);
    assert!(count(&session, "arm", StreamKind::Poses) > 10);
    let recording = manifest.recording.as_ref().unwrap();
    assert_eq!(recording.rig, setup.rig.text);
    assert_eq!(recording.ended, "complete");
    let journal = std::fs::read_to_string(session.layout().journal()).unwrap();
    assert!(journal.contains("\"trajectory\"") && journal.contains("\"seal\""), "{journal}");
}

#[test]
fn events_are_compressed_as_configured_and_read_back_unchanged() {
    let folder = tempfile::tempdir().unwrap();
    let recorded = ["none", "lz4", "zstd"].map(|word| {
        let mut setup = RecordSetup::new(1);
        let key = |word| format!("compression = \"{word}\"");
        let text = setup.rig.text.replace(&key("none"), &key(word));
        setup.rig = Rig::parse("compressed.toml", &text).unwrap();
        let out = folder.path().join(word);
        setup.record(&out, replay(), &StopToken::default(), &mut |_, _| {}).unwrap();
        let session = Session::open(&out).unwrap();
        assert_verifies(&session);
        let n_bytes = std::fs::metadata(session.layout().davis()).unwrap().len();
        (session.events("real").unwrap().0, n_bytes)
    });
    let [(plain, n_plain), (lz4, n_lz4), (zstd, n_zstd)] = recorded;
    assert_eq!(plain.len() as u64, N_EVENTS);
    assert!(lz4 == plain && zstd == plain);
    assert!(n_zstd < n_lz4 && n_lz4 < n_plain, "{n_plain}, {n_lz4}, {n_zstd} bytes");
}

#[test]
fn a_changed_or_truncated_log_does_not_verify() {
    let setup = RecordSetup::new(100);
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("session");
    setup.record(&out, replay(), &StopToken::default(), &mut |_, _| ()).unwrap();
    let session = Session::open(&out).unwrap();
    let log = session.layout().rig_log();
    let bytes = std::fs::read(&log).unwrap();
    let mut changed = bytes.clone();
    changed[bytes.len() / 2] ^= 0x40;
    for wrong in [changed, bytes[..bytes.len() / 2].to_vec()] {
        std::fs::write(&log, wrong).unwrap();
        assert!(!verify(&session).unwrap().holds());
    }
    std::fs::write(&log, bytes).unwrap();
    assert_verifies(&session);
}

#[test]
fn unplugging_the_event_camera_seals_the_session_as_aborted() {
    let setup = RecordSetup::new(u64::MAX);
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("session");
    let spec = StreamSpec::events(Size::DAVIS346, "DAVIS346_1");
    let mut server = StreamServer::bind("127.0.0.1:0", &spec, Compression::None).unwrap();
    let patience =
        NetworkDavisTimeouts { reconnect: Duration::ZERO, ..NetworkDavisTimeouts::default() };
    let davis = NetworkDavis::new(&server.address().to_string(), patience);
    // One connection for the preflight, one for the recording.
    let server_thread = std::thread::spawn(move || {
        assert!(server.wait_for_clients(2, Duration::from_secs(30)));
        let event = Event { t: 5, x: 1, y: 1, on: true };
        server
            .send_events([event].into_iter().collect::<evrig::event::Events>().as_slice())
            .unwrap();
    });
    let outcome =
        setup.record(&out, Box::new(davis), &StopToken::default(), &mut |_, _| ()).unwrap();
    server_thread.join().unwrap();
    assert!(!outcome.is_asked_for);
    let why = outcome.cut_short.unwrap();
    assert!(why.contains("davis at tcp://"), "{why}");
    let session = Session::open(&out).unwrap();
    assert_verifies(&session);
    assert_eq!(session.manifest().status, SessionStatus::Aborted);
    assert_eq!(count(&session, "real", StreamKind::Events), 1);
    assert!(session.manifest().losses.iter().any(|loss| loss.stream == "davis"));
    assert!(!setup.emulator.state().is_busy, "the arm is at rest");
}

#[test]
fn an_operator_stop_stops_the_arm_and_seals_the_session() {
    let setup = RecordSetup::new(u64::MAX);
    for (kind, is_home) in [(StopRequest::AtOnce, false), (StopRequest::Park, true)] {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("session");
        let stop = StopToken::default();
        let mut watch = |state, _| {
            if state == RecordState::Trajectory {
                stop.request(kind);
            }
        };
        let outcome = setup.record(&out, replay(), &stop, &mut watch).unwrap();
        assert!(outcome.is_asked_for);
        let session = Session::open(&out).unwrap();
        assert_verifies(&session);
        assert_eq!(session.manifest().status, SessionStatus::Aborted);
        let state = setup.emulator.state();
        assert!(!state.is_busy && state.n_waiting == 0);
        let away = state.planner.distance(setup.rig.arm.home).0;
        assert_eq!(away < 0.1, is_home, "{away} mm from home after {kind:?}");
    }
}

#[test]
fn an_absent_agent_is_reported_before_anything_moves_or_is_created() {
    let mut setup = RecordSetup::new(1);
    let address = setup.agent.address();
    setup.agent =
        Agent::serve("127.0.0.1:0".parse().unwrap(), Box::new(Synthetic::unpaced(1))).unwrap();
    let mut devices = setup.devices(replay());
    devices.recorders[1] =
        Box::new(NetworkPi::local(&address.to_string(), settings(), PiTimeouts::default()));
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("session");
    let error =
        setup.record_with(&out, &mut devices, &StopToken::default(), &mut |_, _| ()).unwrap_err();
    assert!(error.to_string().contains("evrig pi"), "{error}");
    assert!(!out.exists());
}

#[test]
fn two_recorders_cannot_use_one_camera() {
    let setup = RecordSetup::new(u64::MAX);
    let address = setup.agent.address().to_string();
    let mut first = NetworkPi::local(&address, settings(), PiTimeouts::default());
    first.prepare().unwrap();
    let mut second = NetworkPi::local(&address, settings(), PiTimeouts::default());
    let message = second.prepare().unwrap_err().to_string();
    assert!(message.contains("another recorder"), "{message}");
}

#[test]
fn rgb_frames_fetched_after_the_take_are_stored_with_their_raw_frames() {
    let mut setup = RecordSetup::new(1);
    let folder = tempfile::tempdir().unwrap();
    let spool = Spool { directory: folder.path().to_owned(), limit_bytes: 1 << 30 };
    let limits = BacklogLimits { memory_bytes: 1 << 20, spool: Some(spool) };
    let service = Service { limits, ..Service::local("127.0.0.1:0".parse().unwrap()) };
    setup.agent = Agent::open(service, Box::new(Synthetic::unpaced(100))).unwrap();
    let reach = AgentAddress::Local { address: setup.agent.address().to_string() };
    let delivery = Delivery { rgb: RgbDelivery::AfterTake, ..Delivery::default() };
    let order = CaptureOrder { settings: settings(), focus: Focus::Once, delivery };
    let mut devices = setup.devices(replay());
    devices.recorders[1] = Box::new(NetworkPi::new(reach, order, PiTimeouts::default()));
    let out = folder.path().join("session");
    setup.record_with(&out, &mut devices, &StopToken::default(), &mut |_, _| ()).unwrap();
    let session = Session::open(&out).unwrap();
    assert_verifies(&session);
    for (name, kind) in [
        ("raw", StreamKind::Frames),
        ("rgb", StreamKind::Frames),
        ("pi-metadata", StreamKind::Metadata),
    ] {
        assert_eq!(count(&session, name, kind), 100, "{name}");
    }
}

#[test]
fn the_agent_without_keys_listens_on_loopback_only() {
    let open = Agent::serve("0.0.0.0:0".parse().unwrap(), Box::new(Synthetic::paced()));
    assert!(matches!(open, Err(AgentError::NotLoopback { .. })));
}
