//! The host's side: the Pi's camera as a recorder.

use super::wire::{self, Decoder, Message, PREAMBLE_BYTES, Settings};
use crate::device::Finding;
use crate::device::recorder::{
    Outlet, Prepared, Recorder, RecorderError, Sample, Tally, host_time,
};
use crate::session::{ClockExchange, HostTime};
use std::io::{ErrorKind, Read, Write};
use std::net::{Shutdown, TcpStream, ToSocketAddrs};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// How long is waited for what.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Patience {
    /// For a connection, and for each answer.
    pub answer: Duration,
    /// Without a byte while frames flow, after which the agent counts as gone.
    pub silence: Duration,
    /// For the frames still in the agent's ring when the recording ends.
    pub drain: Duration,
}

impl Default for Patience {
    fn default() -> Self {
        Self {
            answer: Duration::from_secs(3),
            silence: Duration::from_secs(5),
            drain: Duration::from_secs(60),
        }
    }
}

/// Clock readings before and after the frames; the shortest exchange of several is the best.
const CLOCK_READINGS: usize = 5;
/// Between clock readings while frames flow.
const CLOCK_EVERY: Duration = Duration::from_secs(1);
/// A read waits so long before it looks up.
const TICK: Duration = Duration::from_millis(50);

/// The Pi's camera behind its agent.
#[derive(Debug)]
pub struct NetworkPi {
    address: String,
    settings: Settings,
    patience: Patience,
    ready: Option<(Line, Vec<ClockExchange>)>,
    socket: Option<TcpStream>,
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

#[derive(Debug, Default)]
struct Shared {
    is_ending: AtomicBool,
    state: Mutex<State>,
    changed: Condvar,
}

#[derive(Debug, Default)]
struct State {
    tally: Tally,
    failed: Option<RecorderError>,
    is_running: bool,
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, State> {
        // Counters and words: whole between any two statements.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn change(&self, change: impl FnOnce(&mut State)) {
        change(&mut self.lock());
        self.changed.notify_all();
    }

    fn progress(&self) -> Result<Tally, RecorderError> {
        let state = self.lock();
        state.failed.clone().map_or_else(|| Ok(state.tally.clone()), Err)
    }
}

impl NetworkPi {
    /// Will connect to the agent at `HOST:PORT`.
    #[must_use]
    pub fn new(address: &str, settings: Settings, patience: Patience) -> Self {
        Self {
            address: address.to_owned(),
            settings,
            patience,
            ready: None,
            socket: None,
            shared: Arc::default(),
            thread: None,
        }
    }

    fn failed(&self, because: impl ToString) -> RecorderError {
        failed(&self.address, because)
    }

    fn stop(&mut self) {
        self.shared.is_ending.store(true, Ordering::Relaxed);
        if let Some(socket) = &self.socket {
            // It may be closed from the other side already.
            let _ = socket.shutdown(Shutdown::Both);
        }
        self.join();
        self.ready = None;
    }

    fn join(&mut self) {
        if let Some(thread) = self.thread.take() {
            // A panic there was reported by its own hook.
            let _ = thread.join();
        }
    }
}

impl Recorder for NetworkPi {
    fn name(&self) -> &'static str {
        "pi"
    }

    fn check(&mut self) -> Vec<Finding> {
        vec![match Line::connect(&self.address, self.patience) {
            Ok((_, camera)) => Finding::good("pi", format!("{}: {camera}", self.address)),
            Err(error) => Finding::bad("pi", error.to_string()),
        }]
    }

    fn prepare(&mut self) -> Result<Prepared, RecorderError> {
        let (mut line, camera) = Line::connect(&self.address, self.patience)?;
        line.send(&Message::Configure(self.settings.clone()))?;
        let held = match line.receive(self.patience.answer)? {
            Message::Configured(held) => held,
            other => return Err(line.unexpected("its settings", &other)),
        };
        if held.size != self.settings.size
            || (held.raw, held.rgb) != (self.settings.raw, self.settings.rgb)
        {
            return Err(self.failed(format!("asked for {:?}, it set {held:?}", self.settings)));
        }
        let mut readings = Vec::new();
        for _ in 0..CLOCK_READINGS {
            readings.push(line.ask_clock(self.patience.answer)?);
        }
        self.socket = line.socket.try_clone().ok();
        self.ready = Some((line, readings));
        let says = serde_json::json!({
            "source": self.address, "camera": camera, "asked": self.settings, "set": held,
        });
        Ok(Prepared { says, streams: Vec::new() })
    }

    fn start(&mut self, outlet: Outlet) -> Result<(), RecorderError> {
        let Some((mut line, readings)) = self.ready.take() else {
            return Err(self.failed("it was not prepared"));
        };
        line.send(&Message::Start)?;
        for reading in readings {
            let _ = outlet.offer(Sample::Clock(reading));
        }
        self.shared.lock().is_running = true;
        let (shared, patience) = (Arc::clone(&self.shared), self.patience);
        let thread = std::thread::Builder::new().name("pi".to_owned()).spawn(move || {
            let ended = line.record(&outlet, &shared, patience);
            shared.change(|state| {
                state.failed = ended.err();
                state.is_running = false;
            });
        });
        self.thread = Some(thread.map_err(|error| self.failed(error))?);
        let is_waiting = |state: &mut State| state.tally.n_samples == 0 && state.is_running;
        let waited = self.shared.changed.wait_timeout_while(
            self.shared.lock(),
            self.patience.silence,
            is_waiting,
        );
        let state = waited.unwrap_or_else(PoisonError::into_inner).0;
        match &state.failed {
            Some(error) => Err(error.clone()),
            None if state.tally.n_samples == 0 => Err(self.failed("no frame came")),
            None => Ok(()),
        }
    }

    fn progress(&mut self) -> Result<Tally, RecorderError> {
        self.shared.progress()
    }

    fn finish(&mut self) -> Result<Tally, RecorderError> {
        self.shared.is_ending.store(true, Ordering::Relaxed);
        self.join();
        self.stop();
        self.shared.progress()
    }

    fn abort(&mut self) {
        self.stop();
    }
}

impl Drop for NetworkPi {
    fn drop(&mut self) {
        self.stop();
    }
}

/// One connection.
#[derive(Debug)]
struct Line {
    address: String,
    socket: TcpStream,
    decoder: Decoder,
    buffer: Vec<u8>,
}

impl Line {
    /// Connects, compares versions, and hears what camera there is.
    fn connect(address: &str, patience: Patience) -> Result<(Self, String), RecorderError> {
        let fail = |because: String| failed(address, because);
        let resolved = address.to_socket_addrs().map_err(|error| fail(error.to_string()))?;
        let mut found = Err(fail("the name has no address".to_owned()));
        for target in resolved {
            found = TcpStream::connect_timeout(&target, patience.answer)
                .map_err(|error| fail(error.to_string()));
            if found.is_ok() {
                break;
            }
        }
        let mut socket = found?;
        let io = |error: std::io::Error| failed(address, error);
        socket.set_nodelay(true).map_err(io)?;
        socket.set_write_timeout(Some(patience.answer)).map_err(io)?;
        socket.set_read_timeout(Some(patience.answer)).map_err(io)?;
        let mut preamble = [0; PREAMBLE_BYTES];
        socket.write_all(&wire::preamble()).map_err(io)?;
        socket.read_exact(&mut preamble).map_err(io)?;
        wire::check_preamble(&preamble).map_err(|error| failed(address, error))?;
        socket.set_read_timeout(Some(TICK)).map_err(io)?;
        let address = address.to_owned();
        let mut line =
            Self { address, socket, decoder: Decoder::default(), buffer: vec![0; 1 << 16] };
        match line.receive(patience.answer)? {
            Message::Hello { camera } => Ok((line, camera)),
            other => Err(line.unexpected("its camera", &other)),
        }
    }

    fn send(&mut self, message: &Message) -> Result<(), RecorderError> {
        let sent = self.socket.write_all(&wire::encode(message));
        sent.map_err(|error| failed(&self.address, error))
    }

    /// The next message, waited for in ticks; none when a tick brought nothing whole.
    fn look(&mut self) -> Result<Option<Message>, RecorderError> {
        let next = self.decoder.take().map_err(|error| failed(&self.address, error))?;
        if next.is_some() {
            return Ok(next);
        }
        match self.socket.read(&mut self.buffer) {
            Ok(0) => Err(failed(&self.address, "the agent closed the connection")),
            Ok(n) => {
                self.decoder.push(&self.buffer[..n]);
                self.decoder.take().map_err(|error| failed(&self.address, error))
            }
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {
                Ok(None)
            }
            Err(error) => Err(failed(&self.address, error)),
        }
    }

    fn receive(&mut self, patience: Duration) -> Result<Message, RecorderError> {
        let deadline = Instant::now() + patience;
        loop {
            match self.look()? {
                Some(Message::Refused { because }) => return Err(failed(&self.address, because)),
                Some(message) => return Ok(message),
                None if Instant::now() >= deadline => {
                    return Err(failed(&self.address, format!("no answer within {patience:?}")));
                }
                None => {}
            }
        }
    }

    fn ask_clock(&mut self, patience: Duration) -> Result<ClockExchange, RecorderError> {
        let asked = host_time();
        self.send(&Message::AskClock)?;
        match self.receive(patience)? {
            Message::Clock(pi) => Ok(ClockExchange { asked, pi, answered: host_time() }),
            other => Err(self.unexpected("its clocks", &other)),
        }
    }

    fn unexpected(&self, expected: &str, found: &Message) -> RecorderError {
        let name = format!("{found:?}");
        let name = name.split(['(', ' ', '{']).next().unwrap_or_default();
        failed(&self.address, format!("expected {expected}, the agent said {name}"))
    }

    /// Takes frames until the recording ends, then what is left, then the clocks again.
    fn record(
        &mut self,
        outlet: &Outlet,
        shared: &Shared,
        patience: Patience,
    ) -> Result<(), RecorderError> {
        let mut heard = Instant::now();
        let mut clock_asked: Option<HostTime> = None;
        let mut last_asked = Instant::now();
        let mut stopping: Option<Instant> = None;
        loop {
            if stopping.is_none() && shared.is_ending.load(Ordering::Relaxed) {
                self.send(&Message::Stop)?;
                stopping = Some(Instant::now());
            }
            if stopping.is_none() && clock_asked.is_none() && last_asked.elapsed() >= CLOCK_EVERY {
                clock_asked = Some(host_time());
                last_asked = Instant::now();
                self.send(&Message::AskClock)?;
            }
            let Some(message) = self.look()? else {
                let limit = if stopping.is_some() { patience.drain } else { patience.silence };
                if heard.elapsed() >= limit {
                    return Err(failed(&self.address, format!("not a byte within {limit:?}")));
                }
                continue;
            };
            heard = Instant::now();
            match message {
                Message::Frame(frame) => deliver(outlet, shared, frame),
                Message::Clock(pi) => {
                    if let Some(asked) = clock_asked.take() {
                        let reading = ClockExchange { asked, pi, answered: host_time() };
                        let _ = outlet.offer(Sample::Clock(reading));
                    }
                }
                Message::Stopped { n_dropped, .. } => {
                    shared.change(|state| state.tally.n_dropped += n_dropped);
                    break;
                }
                Message::Refused { because } => return Err(failed(&self.address, because)),
                other => return Err(self.unexpected("a frame", &other)),
            }
            if stopping.is_some_and(|since| since.elapsed() >= patience.drain) {
                let because = format!("frames still come {:?} after the stop", patience.drain);
                return Err(failed(&self.address, because));
            }
        }
        for _ in 0..CLOCK_READINGS {
            let reading = self.ask_clock(patience.answer)?;
            let _ = outlet.offer(Sample::Clock(reading));
        }
        Ok(())
    }
}

fn deliver(outlet: &Outlet, shared: &Shared, frame: Box<crate::session::PiFrame>) {
    let is_taken = outlet.offer(Sample::Frame { arrived: host_time(), frame });
    shared.change(|state| {
        let tally = &mut state.tally;
        *(if is_taken { &mut tally.n_samples } else { &mut tally.n_dropped }) += 1;
    });
}

fn failed(address: &str, because: impl ToString) -> RecorderError {
    RecorderError {
        device: format!("pi at tcp://{address}"),
        because: because.to_string(),
        remedy: "start `evrig pi` there, or correct pi.transport",
    }
}
