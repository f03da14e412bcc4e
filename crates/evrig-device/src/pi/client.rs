//! The host's side: the Pi's camera as a recorder.

use super::budget;
use super::line::{Line, Reach};
use evrig_core::pi_camera::PiFrame;
use evrig_pi::order::{Delivery, Focus, Order};
use evrig_pi::wire::{Message, Settings, TakeTally};
use evrig_record::Finding;
use evrig_record::recorder::{
    Account, Outlet, Prepared, Recorder, RecorderError, Sample, Tally, host_time,
};
use evrig_session::{ClockExchange, HostTime};
use std::net::{Shutdown, TcpStream};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// How long is waited for what.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Patience {
    /// For a connection, and for each answer.
    pub answer: Duration,
    /// Without a byte while frames flow, after which the agent counts as gone.
    pub silence: Duration,
    /// Until the camera is set up, its lens focused.
    pub configure: Duration,
    /// For the frames that still wait on the Pi when the recording ends, beside the time that
    /// their bytes take at a megabyte a second.
    pub drain: Duration,
}

impl Default for Patience {
    fn default() -> Self {
        Self {
            answer: Duration::from_secs(3),
            silence: Duration::from_secs(5),
            configure: Duration::from_secs(20),
            drain: Duration::from_secs(60),
        }
    }
}

/// Clock readings before and after the frames; the shortest exchange of several is the best.
const CLOCK_READINGS: usize = 5;
/// Between clock readings while frames flow.
const CLOCK_EVERY: Duration = Duration::from_secs(1);
/// A network that carries less while the Pi's spool is fetched counts as dead.
const SLOWEST_BYTES_PER_S: u64 = 1_000_000;

/// The Pi's camera behind its agent.
#[derive(Debug)]
pub struct NetworkPi {
    reach: Reach,
    order: Order,
    patience: Patience,
    ready: Option<(Line, Vec<ClockExchange>)>,
    socket: Option<TcpStream>,
    account: Arc<Account>,
    thread: Option<JoinHandle<()>>,
}

impl NetworkPi {
    /// Will connect to the agent at `HOST:PORT` of this machine, without encryption.
    #[must_use]
    pub fn new(address: &str, settings: Settings, patience: Patience) -> Self {
        let order = Order { settings, focus: Focus::default(), delivery: Delivery::default() };
        Self::reached(Reach::Local { address: address.to_owned() }, order, patience)
    }

    /// Will connect to an agent.
    #[must_use]
    pub fn reached(reach: Reach, order: Order, patience: Patience) -> Self {
        Self {
            reach,
            order,
            patience,
            ready: None,
            socket: None,
            account: Arc::default(),
            thread: None,
        }
    }

    fn failed(&self, because: impl ToString) -> RecorderError {
        self.reach.failed(because)
    }

    fn stop(&mut self) {
        self.account.end();
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
        let answer = self.patience.answer;
        let (line, camera) = match Line::connect(&self.reach, answer) {
            Ok(connected) => connected,
            Err(error) => return vec![Finding::bad("pi", error.to_string())],
        };
        let found = Finding::good("pi", format!("{}: {camera}", self.reach));
        let network = match line.probe(answer) {
            Ok(link) => budget::finding(&self.order, link),
            Err(error) => Finding::bad("network", error.to_string()),
        };
        vec![found, network]
    }

    fn prepare(&mut self) -> Result<Prepared, RecorderError> {
        let (mut line, camera) = Line::connect(&self.reach, self.patience.answer)?;
        let (held, says) = line.configure(&self.order, self.patience.configure)?;
        let asked = &self.order.settings;
        if held.size != asked.size || (held.raw, held.rgb) != (asked.raw, asked.rgb) {
            return Err(self.failed(format!("asked for {asked:?}, it set {held:?}")));
        }
        let mut readings = Vec::new();
        for _ in 0..CLOCK_READINGS {
            readings.push(line.ask_clock(self.patience.answer)?);
        }
        self.socket = line.handle();
        self.ready = Some((line, readings));
        let says = serde_json::json!({
            "source": self.reach.to_string(), "camera": camera, "asked": self.order, "set": held,
            "says": says,
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
        let patience = self.patience;
        let work = move |outlet: &Outlet, account: &Account| line.record(outlet, account, patience);
        let thread = self.account.spawn("pi", outlet, work);
        self.thread = Some(thread.map_err(|error| self.failed(error))?);
        if self.account.wait_for_first(patience.silence)? {
            return Ok(());
        }
        Err(self.failed("no frame came"))
    }

    fn progress(&mut self) -> Result<Tally, RecorderError> {
        self.account.progress()
    }

    fn finish(&mut self) -> Result<Tally, RecorderError> {
        self.account.end();
        self.join();
        self.stop();
        self.account.progress()
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

impl Line {
    /// Takes frames until the recording ends, then what is left, then the clocks again.
    fn record(
        &mut self,
        outlet: &Outlet,
        account: &Account,
        patience: Patience,
    ) -> Result<(), RecorderError> {
        let mut heard = Instant::now();
        let mut clock_asked: Option<HostTime> = None;
        let mut last_asked = Instant::now();
        let mut drained_by: Option<Instant> = None;
        loop {
            if drained_by.is_none() && account.is_ending() {
                self.send(&Message::Stop)?;
                drained_by = Some(Instant::now() + patience.drain);
            }
            if drained_by.is_none() && clock_asked.is_none() && last_asked.elapsed() >= CLOCK_EVERY
            {
                clock_asked = Some(host_time());
                last_asked = Instant::now();
                self.send(&Message::AskClock)?;
            }
            if drained_by.is_some_and(|limit| Instant::now() >= limit) {
                return Err(self.reach.failed("the frames that wait there did not come in time"));
            }
            let Some(message) = self.look()? else {
                let limit = if drained_by.is_some() { patience.drain } else { patience.silence };
                if heard.elapsed() >= limit {
                    return Err(self.reach.failed(format!("not a byte within {limit:?}")));
                }
                continue;
            };
            heard = Instant::now();
            match message {
                Message::Frame(frame) => {
                    account.offer(outlet, Sample::Frame { arrived: host_time(), frame });
                }
                Message::LateRgb(frame) => deliver_late(outlet, account, frame),
                Message::Clock(reading) => {
                    if let Some(asked) = clock_asked.take() {
                        let (pi, pi_raw) = (reading.boot, Some(reading.raw));
                        let reading = ClockExchange { asked, pi, pi_raw, answered: host_time() };
                        let _ = outlet.offer(Sample::Clock(reading));
                    }
                }
                Message::Draining { n_bytes, .. } => {
                    let seconds = Duration::from_secs(n_bytes / SLOWEST_BYTES_PER_S);
                    drained_by = drained_by.map(|limit| limit + seconds);
                }
                Message::Stopped(tally) => {
                    account.change(|state| count(&mut state.tally, &tally));
                    break;
                }
                Message::Refused { because } => return Err(self.reach.refused(because)),
                other => return Err(self.unexpected("a frame", &other)),
            }
        }
        for _ in 0..CLOCK_READINGS {
            let reading = self.ask_clock(patience.answer)?;
            let _ = outlet.offer(Sample::Clock(reading));
        }
        let text = format!("pi: clock after the take: {}", self.ask_discipline(patience.answer)?);
        let _ = outlet.offer(Sample::Note { at: host_time(), text });
        Ok(())
    }
}

/// Takes the agent's account of a take over into the recorder's.
fn count(tally: &mut Tally, take: &TakeTally) {
    tally.n_dropped += take.n_dropped;
    if take.n_late_dropped > 0 {
        let n = take.n_late_dropped;
        tally.gaps.push(format!("{n} RGB pictures had no room in the Pi's spool"));
    }
}

/// Late pictures can wait for the disk: the agent keeps them until they are taken.
fn deliver_late(outlet: &Outlet, account: &Account, frame: Box<PiFrame>) {
    if !outlet.put(Sample::LateRgb { arrived: host_time(), frame }) {
        account.change(|state| {
            if state.tally.gaps.is_empty() {
                state.tally.gaps.push("the writer ended before the late RGB pictures".to_owned());
            }
        });
    }
}
