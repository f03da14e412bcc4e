//! The simulated arm on a pseudo-terminal, for any serial client.

mod follower;
mod shared;

pub use follower::TraceFollower;
pub use shared::ArmClock;

use super::fault::{Fault, FaultKind, Faults};
use super::journal::{RequestJournal, RequestRecord};
use super::options::ArmOptions;
use super::simulated::SimulatedArm;
use evrig_core::time::Span;
use evrig_device::dobot::alarm::Alarms;
use evrig_device::dobot::frame::{ArmFrame, ArmFrameDecoder};
use evrig_device::dobot::id;
use evrig_record::host_clock;
use evrig_session::rig::Pose;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fd::OwnedFd;
use rustix::fs::{Mode, OFlags};
use rustix::io::Errno;
use rustix::pty::OpenptFlags;
use rustix::termios::{OptionalActions, ioctl_tiocnxcl, tcgetattr, tcsetattr};
use shared::{ClockedArm, SharedArm, lock};
use std::io::Write;
use std::os::unix::ffi::OsStringExt;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// Why the simulated arm cannot be started.
#[derive(Debug, thiserror::Error)]
pub enum EmulatorError {
    /// No pseudo-terminal.
    #[error("cannot open a pseudo-terminal for the simulated arm; is /dev/pts mounted?")]
    Pty(#[from] std::io::Error),
    /// The link to the pty cannot be made.
    #[error("cannot make {} a link to the simulated arm's port", path.display())]
    Link {
        /// Path of the link.
        path: PathBuf,
        /// Why not.
        source: std::io::Error,
    },
}

/// A simulated arm on a pseudo-terminal, served by its own thread until it is dropped.
#[derive(Debug)]
pub struct ArmEmulator {
    port: PathBuf,
    link: Option<PathBuf>,
    shared: Arc<SharedArm>,
    thread: Option<std::thread::JoinHandle<()>>,
}

/// State of the arm at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArmState {
    /// Time since power-up.
    pub arm_time: Span,
    /// Pose of the tool by the planner.
    pub planner: Pose,
    /// True pose of the tool.
    pub truth: Pose,
    /// Whether a motion or a wait is under way.
    pub is_busy: bool,
    /// Commands waiting.
    pub n_waiting: usize,
    /// Whether it was homed since power-up.
    pub is_homed: bool,
    /// The active alarms.
    pub alarms: Alarms,
}

/// Longest wait for a byte before the thread looks whether it is to end.
const TICK: Timespec = Timespec { tv_sec: 0, tv_nsec: 20_000_000 };

impl ArmEmulator {
    /// Opens a pty and serves a simulated arm on it.
    ///
    /// # Errors
    /// When the system gives no pty.
    pub fn start(
        options: ArmOptions,
        clock: ArmClock,
        faults: Vec<Fault>,
    ) -> Result<Self, EmulatorError> {
        Self::start_with_journal(options, clock, faults, None)
    }

    /// The same, writing every request as a JSON line to `journal`.
    ///
    /// # Errors
    /// When the system gives no pty.
    pub fn start_with_journal(
        options: ArmOptions,
        clock: ArmClock,
        faults: Vec<Fault>,
        journal: Option<Box<dyn Write + Send>>,
    ) -> Result<Self, EmulatorError> {
        let (line, port) = Pty::open().map_err(std::io::Error::from)?;
        let arm = SimulatedArm::new(options.clone());
        let clocked = ClockedArm { arm, options, clock, powered_up: Instant::now() };
        let shared = Arc::new(SharedArm {
            arm: Mutex::new(clocked),
            faults: Mutex::new(Faults::new(faults)),
            journal: Mutex::new(RequestJournal::new(journal)),
            is_ending: AtomicBool::new(false),
        });
        let served = Arc::clone(&shared);
        let thread = std::thread::Builder::new()
            .name("simulated arm".to_owned())
            .spawn(move || serve(line, &served))?;
        Ok(Self { port, link: None, shared, thread: Some(thread) })
    }

    /// The pty that clients open.
    #[must_use]
    pub fn port(&self) -> &Path {
        &self.port
    }

    /// Makes `path` a symbolic link to the port, in place of an older link; removed with the arm.
    ///
    /// # Errors
    /// When something other than a link exists there, or the directory cannot be written.
    pub fn link(&mut self, path: &Path) -> Result<(), EmulatorError> {
        let failed = |source| EmulatorError::Link { path: path.to_owned(), source };
        if path.symlink_metadata().is_ok_and(|data| data.is_symlink()) {
            std::fs::remove_file(path).map_err(failed)?;
        }
        std::os::unix::fs::symlink(&self.port, path).map_err(failed)?;
        self.link = Some(path.to_owned());
        Ok(())
    }

    /// The arm as it is now.
    #[must_use]
    pub fn state(&self) -> ArmState {
        let mut clocked = lock(&self.shared.arm);
        let now = clocked.now(false);
        clocked.arm.advance(now);
        let arm = &clocked.arm;
        ArmState {
            arm_time: arm.now(),
            planner: arm.planner_pose(),
            truth: arm.true_pose(),
            is_busy: arm.is_busy(),
            n_waiting: arm.n_waiting(),
            is_homed: arm.is_homed(),
            alarms: arm.alarms(),
        }
    }

    /// Follows the true pose of the tool from now on.
    #[must_use]
    pub fn follow(&self) -> TraceFollower {
        TraceFollower::of(&self.shared)
    }

    /// Injects a fault; requests are counted from now.
    pub fn inject(&self, fault: Fault) {
        lock(&self.shared.faults).add(fault);
    }

    /// The requests received so far, the last hundred thousand.
    #[must_use]
    pub fn journal(&self) -> Vec<RequestRecord> {
        lock(&self.shared.journal).lines()
    }
}

impl Drop for ArmEmulator {
    fn drop(&mut self) {
        self.shared.is_ending.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // A panic of the serving thread was already reported by its own hook.
            let _ = thread.join();
        }
        if let Some(link) = &self.link {
            // The link may have been replaced or removed by its user, which is theirs to do.
            let _ = std::fs::remove_file(link);
        }
    }
}

/// Both ends of the line: the arm's own, and the client's kept open so that the
/// arm's end lives on when a client closes.
struct Pty {
    ours: OwnedFd,
    theirs: OwnedFd,
}

impl Pty {
    fn open() -> rustix::io::Result<(Self, PathBuf)> {
        let flags = OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC;
        let ours = rustix::pty::openpt(flags)?;
        rustix::pty::grantpt(&ours)?;
        rustix::pty::unlockpt(&ours)?;
        let name = rustix::pty::ptsname(&ours, Vec::new())?;
        let port = PathBuf::from(std::ffi::OsString::from_vec(name.into_bytes()));
        let open = OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC;
        let theirs = rustix::fs::open(&port, open, Mode::empty())?;
        let mut settings = tcgetattr(&theirs)?;
        settings.make_raw();
        tcsetattr(&theirs, OptionalActions::Now, &settings)?;
        // A client that does not read must not hold up the arm: what does not fit is lost.
        rustix::fs::fcntl_setfl(&ours, OFlags::RDWR | OFlags::NONBLOCK)?;
        Ok((Self { ours, theirs }, port))
    }

    /// Bytes that came, `None` when none did within a tick.
    fn read(&self, buffer: &mut [u8]) -> rustix::io::Result<Option<usize>> {
        let mut fds = [PollFd::new(&self.ours, PollFlags::IN)];
        match poll(&mut fds, Some(&TICK)) {
            Ok(0) | Err(Errno::INTR) => return Ok(None),
            Ok(_) => {}
            Err(error) => return Err(error),
        }
        match rustix::io::read(&self.ours, buffer) {
            Ok(n) => Ok(Some(n)),
            Err(Errno::AGAIN | Errno::INTR) => Ok(None),
            Err(error) => Err(error),
        }
    }

    fn write(&self, bytes: &[u8]) {
        // What a full line does not take is lost, as on a wire that nobody reads.
        let _ = rustix::io::write(&self.ours, bytes);
    }
}

fn serve(line: Pty, shared: &SharedArm) {
    let mut decoder = ArmFrameDecoder::default();
    let mut buffer = [0; 512];
    while !shared.is_ending.load(Ordering::Relaxed) {
        let mut requests = Vec::new();
        match line.read(&mut buffer) {
            Ok(Some(n)) => decoder.push(&buffer[..n], |frame| requests.push(frame)),
            Ok(None) => {
                decoder.give_up(|frame| requests.push(frame));
                // The exclusive mark of a killed client would outlive it, since this end of
                // theirs stays open; on a real port it goes with the last client.
                let _ = ioctl_tiocnxcl(&line.theirs);
            }
            Err(_) => return,
        }
        for request in requests {
            if !take(&line, shared, &request) {
                return;
            }
        }
    }
}

/// Takes one request; false when the cable was pulled.
fn take(line: &Pty, shared: &SharedArm, request: &ArmFrame) -> bool {
    let struck = lock(&shared.faults).strike(request.id());
    let has = |kind: FaultKind| struck.contains(&kind);
    if has(FaultKind::Unplug) {
        return false;
    }
    if has(FaultKind::LostRequest) || has(FaultKind::Silence) {
        return true;
    }
    if has(FaultKind::Garbage) || has(FaultKind::Wedge) {
        let noise: &[u8] =
            if has(FaultKind::Wedge) { &[0xff] } else { b"AT+GMR\r\nOK\r\n\xaa\xaa\x7f" };
        line.write(noise);
        return true;
    }
    let (reply, delay) = answer(shared, request, &struck);
    std::thread::sleep(Duration::from_nanos(delay.as_nanos().max(0).unsigned_abs()));
    if let Some(delay) = struck.iter().find_map(|kind| match kind {
        FaultKind::LateReply(delay) => Some(*delay),
        _ => None,
    }) {
        std::thread::sleep(Duration::from_nanos(delay.as_nanos().unsigned_abs()));
    }
    if let Some(reply) = reply
        && !has(FaultKind::LostReply)
        && !has(FaultKind::PowerCycle)
    {
        send(line, &reply, has(FaultKind::CorruptReply), has(FaultKind::Trickle));
    }
    true
}

fn send(line: &Pty, reply: &ArmFrame, is_corrupt: bool, trickles: bool) {
    let mut bytes = reply.to_bytes();
    if is_corrupt && let Some(last) = bytes.last_mut() {
        *last ^= 0x10;
    }
    if trickles {
        for byte in bytes {
            line.write(&[byte]);
            std::thread::sleep(Duration::from_millis(1));
        }
    } else {
        line.write(&bytes);
    }
}

/// Does the request and notes it; gives the reply and how long it takes.
fn answer(
    shared: &SharedArm,
    request: &ArmFrame,
    struck: &[FaultKind],
) -> (Option<ArmFrame>, Span) {
    let mut clocked = lock(&shared.arm);
    let now = clocked.now(true);
    clocked.arm.advance(now);
    for kind in struck {
        match kind {
            FaultKind::Alarm(alarm) => clocked.arm.raise(*alarm),
            FaultKind::PowerCycle => clocked.power_cycle(),
            _ => {}
        }
    }
    let was_busy = clocked.arm.is_busy();
    let now = clocked.arm.now();
    let reply = clocked.arm.answer(request, now);
    let line = RequestRecord {
        host_ns: host_clock::now().as_nanos(),
        arm_ns: now.as_nanos(),
        id: request.id(),
        name: id::name(request.id()).unwrap_or("UNKNOWN").to_owned(),
        ctrl: request.ctrl().0,
        params: request.params().iter().map(|byte| format!("{byte:02x}")).collect(),
        was_busy,
        is_busy: clocked.arm.is_busy(),
        n_waiting: clocked.arm.n_waiting(),
    };
    lock(&shared.journal).note(line);
    (reply, clocked.options.reply_delay)
}
