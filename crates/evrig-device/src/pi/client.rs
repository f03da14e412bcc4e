//! The host's side: the Pi's camera as a recorder.

use super::budget;
use super::connection::{AgentAddress, AgentConnection};
use evrig_core::pi_camera::PiFrame;
use evrig_pi::order::{CaptureOrder, CaptureSettings, Delivery, Focus};
use evrig_pi::wire::{Message, TakeTally};
use evrig_record::Finding;
use evrig_record::recorder::{
    PreparedRecorder, Recorder, RecorderError, RecorderMonitor, RecorderSample, RecorderTally,
    SampleSender, host_time,
};
use evrig_session::{ClockExchange, HostTime};
use std::net::{Shutdown, TcpStream};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// How long is waited for what.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PiTimeouts {
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

impl Default for PiTimeouts {
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
    agent: AgentAddress,
    order: CaptureOrder,
    timeouts: PiTimeouts,
    ready: Option<(AgentConnection, Vec<ClockExchange>)>,
    socket: Option<TcpStream>,
    monitor: Arc<RecorderMonitor>,
    thread: Option<JoinHandle<()>>,
}

impl NetworkPi {
    /// Will connect to the agent at `HOST:PORT` of this machine, without encryption.
    #[must_use]
    pub fn local(address: &str, settings: CaptureSettings, timeouts: PiTimeouts) -> Self {
        let order =
            CaptureOrder { settings, focus: Focus::default(), delivery: Delivery::default() };
        Self::new(AgentAddress::Local { address: address.to_owned() }, order, timeouts)
    }

    /// Will connect to an agent.
    #[must_use]
    pub fn new(agent: AgentAddress, order: CaptureOrder, timeouts: PiTimeouts) -> Self {
        Self {
            agent,
            order,
            timeouts,
            ready: None,
            socket: None,
            monitor: Arc::default(),
            thread: None,
        }
    }

    fn failed(&self, because: impl ToString) -> RecorderError {
        self.agent.failed(because)
    }

    fn stop(&mut self) {
        self.monitor.end();
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
        let answer = self.timeouts.answer;
        let (connection, camera) = match AgentConnection::connect(&self.agent, answer) {
            Ok(connected) => connected,
            Err(error) => return vec![Finding::bad("pi", error.to_string())],
        };
        let found = Finding::good("pi", format!("{}: {camera}", self.agent));
        let network = match connection.probe(answer) {
            Ok(link) => budget::finding(&self.order, link),
            Err(error) => Finding::bad("network", error.to_string()),
        };
        vec![found, network]
    }

    fn prepare(&mut self) -> Result<PreparedRecorder, RecorderError> {
        let (mut connection, camera) = AgentConnection::connect(&self.agent, self.timeouts.answer)?;
        let (held, reported) = connection.configure(&self.order, self.timeouts.configure)?;
        let asked = &self.order.settings;
        if held.size != asked.size || (held.raw, held.rgb) != (asked.raw, asked.rgb) {
            return Err(self.failed(format!(
                "asked for {} (raw {}, RGB {}), it set {} (raw {}, RGB {})",
                asked.size, asked.raw, asked.rgb, held.size, held.raw, held.rgb
            )));
        }
        let mut readings = Vec::new();
        for _ in 0..CLOCK_READINGS {
            readings.push(connection.ask_clock(self.timeouts.answer)?);
        }
        self.socket = connection.handle();
        self.ready = Some((connection, readings));
        let description = serde_json::json!({
            "source": self.agent.to_string(), "camera": camera, "asked": self.order, "set": held,
            "reported": reported,
        });
        Ok(PreparedRecorder { description, streams: Vec::new() })
    }

    fn start(&mut self, outlet: SampleSender) -> Result<(), RecorderError> {
        let Some((mut connection, readings)) = self.ready.take() else {
            return Err(self.failed("it was not prepared"));
        };
        connection.send(&Message::Start)?;
        for reading in readings {
            let _ = outlet.offer(RecorderSample::Clock(reading));
        }
        let timeouts = self.timeouts;
        let work = move |outlet: &SampleSender, monitor: &RecorderMonitor| {
            connection.record(outlet, monitor, timeouts)
        };
        let thread = self.monitor.spawn("pi", outlet, work);
        self.thread = Some(thread.map_err(|error| self.failed(error))?);
        if self.monitor.wait_for_first(timeouts.silence)? {
            return Ok(());
        }
        Err(self.failed("no frame came"))
    }

    fn progress(&mut self) -> Result<RecorderTally, RecorderError> {
        self.monitor.progress()
    }

    fn finish(&mut self) -> Result<RecorderTally, RecorderError> {
        self.monitor.end();
        self.join();
        self.stop();
        self.monitor.progress()
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

impl AgentConnection {
    /// Takes frames until the recording ends, then what is left, then the clocks again.
    fn record(
        &mut self,
        outlet: &SampleSender,
        monitor: &RecorderMonitor,
        timeouts: PiTimeouts,
    ) -> Result<(), RecorderError> {
        let mut last_answer = Instant::now();
        let mut clock_asked: Option<HostTime> = None;
        let mut last_asked = Instant::now();
        let mut drained_by: Option<Instant> = None;
        loop {
            if drained_by.is_none() && monitor.is_ending() {
                self.send(&Message::Stop)?;
                drained_by = Some(Instant::now() + timeouts.drain);
            }
            if drained_by.is_none() && clock_asked.is_none() && last_asked.elapsed() >= CLOCK_EVERY
            {
                clock_asked = Some(host_time());
                last_asked = Instant::now();
                self.send(&Message::AskClock)?;
            }
            if drained_by.is_some_and(|limit| Instant::now() >= limit) {
                return Err(self.agent.failed("the frames that wait there did not come in time"));
            }
            let Some(message) = self.look()? else {
                let limit = if drained_by.is_some() { timeouts.drain } else { timeouts.silence };
                if last_answer.elapsed() >= limit {
                    return Err(self.agent.failed(format!("not a byte within {limit:?}")));
                }
                continue;
            };
            last_answer = Instant::now();
            match message {
                Message::Frame(frame) => {
                    monitor.offer(outlet, RecorderSample::Frame { arrived: host_time(), frame });
                }
                Message::LateRgb(frame) => deliver_late(outlet, monitor, frame),
                Message::Clock(reading) => {
                    if let Some(asked) = clock_asked.take() {
                        let (pi, pi_raw) = (reading.boot, Some(reading.raw));
                        let reading = ClockExchange { asked, pi, pi_raw, answered: host_time() };
                        let _ = outlet.offer(RecorderSample::Clock(reading));
                    }
                }
                Message::Draining { n_bytes, .. } => {
                    let seconds = Duration::from_secs(n_bytes / SLOWEST_BYTES_PER_S);
                    drained_by = drained_by.map(|limit| limit + seconds);
                }
                Message::Stopped(tally) => {
                    monitor.change(|state| count(&mut state.tally, &tally));
                    break;
                }
                Message::Refused { because } => return Err(self.agent.refused(because)),
                other => return Err(self.unexpected("a frame", &other)),
            }
        }
        for _ in 0..CLOCK_READINGS {
            let reading = self.ask_clock(timeouts.answer)?;
            let _ = outlet.offer(RecorderSample::Clock(reading));
        }
        let text = format!("pi: clock after the take: {}", self.ask_discipline(timeouts.answer)?);
        let _ = outlet.offer(RecorderSample::Note { at: host_time(), text });
        Ok(())
    }
}

/// Takes the agent's monitor of a take over into the recorder's.
fn count(tally: &mut RecorderTally, take: &TakeTally) {
    tally.n_dropped += take.n_dropped;
    if take.n_late_dropped > 0 {
        let n = take.n_late_dropped;
        tally.gaps.push(format!("{n} RGB frames did not fit into the Pi's spool"));
    }
}

/// Late images can wait for the disk: the agent keeps them until they are taken.
fn deliver_late(outlet: &SampleSender, monitor: &RecorderMonitor, frame: Box<PiFrame>) {
    if !outlet.put(RecorderSample::LateRgb { arrived: host_time(), frame }) {
        monitor.change(|state| {
            if state.tally.gaps.is_empty() {
                state.tally.gaps.push("the writer ended before the delayed RGB frames".to_owned());
            }
        });
    }
}
