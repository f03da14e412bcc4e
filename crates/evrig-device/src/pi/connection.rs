//! One connection to an agent, seen from the host.

use evrig_core::units::BytesPerSecond;
use evrig_pi::keys::Keys;
use evrig_pi::order::{CaptureOrder, CaptureSettings};
use evrig_pi::wire::{self, MAX_PROBE_BYTES, Message, MessageDecoder, PREAMBLE_BYTES};
use evrig_record::recorder::{RecorderError, host_time};
use evrig_session::ClockExchange;
use rustls::{ClientConnection, StreamOwned};
use serde_json::{Value, json};
use std::fmt;
use std::io::{self, ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpStream, ToSocketAddrs};
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// The timeout of one read.
const POLL_INTERVAL: Duration = Duration::from_millis(50);
/// The agent may have to start its camera's program first, which takes a Pi some seconds.
const HELLO: Duration = Duration::from_secs(15);
/// A probe of the link ends after so long, whatever has come by then.
const PROBE: Duration = Duration::from_secs(2);

/// How an agent is reached.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum AgentAddress {
    /// On this machine, or through a tunnel that ends here; nothing is encrypted.
    Local {
        /// `HOST:PORT`.
        address: String,
    },
    /// Anywhere, encrypted, each side proving itself.
    Tls {
        /// `HOST:PORT`.
        address: String,
        /// The directory with this side's keys.
        keys: PathBuf,
    },
}

impl AgentAddress {
    fn address(&self) -> &str {
        match self {
            Self::Local { address } | Self::Tls { address, .. } => address,
        }
    }

    pub(super) fn failed(&self, because: impl ToString) -> RecorderError {
        let remedy = "start `evrig pi` there, or correct pi.transport";
        RecorderError { device: format!("pi at {self}"), because: because.to_string(), remedy }
    }

    /// The agent answered and refused.
    pub(super) fn refused(&self, because: String) -> RecorderError {
        RecorderError { device: format!("pi at {self}"), because, remedy: "mend that on the Pi" }
    }
}

impl fmt::Display for AgentAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let scheme = if matches!(self, Self::Local { .. }) { "tcp" } else { "tls" };
        write!(f, "{scheme}://{}", self.address())
    }
}

#[derive(Debug)]
enum Socket {
    Plain(TcpStream),
    Tls(Box<StreamOwned<ClientConnection, TcpStream>>),
}

impl Socket {
    fn tcp(&self) -> &TcpStream {
        match self {
            Self::Plain(socket) => socket,
            Self::Tls(stream) => &stream.sock,
        }
    }

    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        match self {
            Self::Plain(socket) => socket.read(buffer),
            Self::Tls(stream) => stream.read(buffer),
        }
    }

    fn write_all(&mut self, bytes: &[u8]) -> io::Result<()> {
        match self {
            Self::Plain(socket) => socket.write_all(bytes),
            Self::Tls(stream) => stream.write_all(bytes).and_then(|()| stream.flush()),
        }
    }
}

/// One connection.
#[derive(Debug)]
pub(super) struct AgentConnection {
    pub(super) agent: AgentAddress,
    socket: Socket,
    decoder: MessageDecoder,
    buffer: Vec<u8>,
}

impl AgentConnection {
    /// Connects, authenticates both sides, compares versions, and receives the camera's
    /// description.
    pub(super) fn connect(
        agent: &AgentAddress,
        patience: Duration,
    ) -> Result<(Self, String), RecorderError> {
        let deadline = Instant::now() + patience;
        let socket = connect(agent, patience)?;
        let socket = match agent {
            AgentAddress::Local { .. } => Socket::Plain(socket),
            AgentAddress::Tls { keys, .. } => {
                let keys = Keys::read(keys).and_then(Keys::client);
                let (config, name) = keys.map_err(|error| agent.failed(error))?;
                let connection = ClientConnection::new(config, name);
                let mut connection = connection.map_err(|error| agent.failed(error))?;
                let mut socket = socket;
                shake_hands(&mut connection, &mut socket, deadline)
                    .map_err(|error| agent.failed(in_words(&error)))?;
                Socket::Tls(Box::new(StreamOwned::new(connection, socket)))
            }
        };
        let (decoder, buffer) = (MessageDecoder::default(), vec![0; 1 << 16]);
        let mut connection = Self { agent: agent.clone(), socket, decoder, buffer };
        connection.exchange_preambles(deadline)?;
        match connection.receive(patience.max(HELLO))? {
            Message::Hello { camera } => Ok((connection, camera)),
            other => Err(connection.unexpected("its camera", &other)),
        }
    }

    fn exchange_preambles(&mut self, deadline: Instant) -> Result<(), RecorderError> {
        let io = |error: &io::Error| self.agent.failed(in_words(error));
        self.socket.write_all(&wire::preamble()).map_err(|error| io(&error))?;
        let mut preamble = [0; PREAMBLE_BYTES];
        let mut n = 0;
        while n < PREAMBLE_BYTES {
            match self.socket.read(&mut preamble[n..]) {
                Ok(0) => {
                    let because = "it closed the connection before its first word; too many \
                        failed tries, or keys of another pair";
                    return Err(self.agent.failed(because));
                }
                Ok(read) => n += read,
                Err(error) if is_tick(&error) && Instant::now() < deadline => {}
                Err(error) => return Err(io(&error)),
            }
        }
        wire::check_preamble(&preamble).map_err(|error| self.agent.failed(error))
    }

    /// Another handle of the socket, to end the connection from elsewhere.
    pub(super) fn handle(&self) -> Option<TcpStream> {
        self.socket.tcp().try_clone().ok()
    }

    pub(super) fn send(&mut self, message: &Message) -> Result<(), RecorderError> {
        let sent = self.socket.write_all(&wire::encode(message));
        sent.map_err(|error| self.agent.failed(in_words(&error)))
    }

    /// The next message, waited for in ticks; none when a tick brought nothing whole.
    pub(super) fn look(&mut self) -> Result<Option<Message>, RecorderError> {
        let next = self.decoder.take().map_err(|error| self.agent.failed(error))?;
        if next.is_some() {
            return Ok(next);
        }
        match self.socket.read(&mut self.buffer) {
            Ok(0) => Err(self.agent.failed("the agent closed the connection")),
            Ok(n) => {
                self.decoder.push(&self.buffer[..n]);
                self.decoder.take().map_err(|error| self.agent.failed(error))
            }
            Err(error) if is_tick(&error) => Ok(None),
            Err(error) => Err(self.agent.failed(in_words(&error))),
        }
    }

    pub(super) fn receive(&mut self, patience: Duration) -> Result<Message, RecorderError> {
        let deadline = Instant::now() + patience;
        loop {
            match self.look()? {
                Some(Message::Refused { because }) => return Err(self.agent.refused(because)),
                Some(message) => return Ok(message),
                None if Instant::now() >= deadline => {
                    return Err(self.agent.failed(format!("no answer within {patience:?}")));
                }
                None => {}
            }
        }
    }

    /// Orders frames; returns the settings read back, and the descriptions of camera and clock.
    pub(super) fn configure(
        &mut self,
        order: &CaptureOrder,
        patience: Duration,
    ) -> Result<(CaptureSettings, Value), RecorderError> {
        self.send(&Message::Configure(order.clone()))?;
        match self.receive(patience)? {
            Message::Configured { settings, description } => {
                let clock = self.ask_discipline(patience)?;
                Ok((settings, json!({ "camera": description, "clock": clock })))
            }
            other => Err(self.unexpected("its settings", &other)),
        }
    }

    pub(super) fn ask_discipline(&mut self, patience: Duration) -> Result<Value, RecorderError> {
        self.send(&Message::AskDiscipline)?;
        match self.receive(patience)? {
            Message::Discipline(discipline) => Ok(json!(discipline)),
            other => Err(self.unexpected("what keeps its clock right", &other)),
        }
    }

    pub(super) fn ask_clock(&mut self, patience: Duration) -> Result<ClockExchange, RecorderError> {
        let asked = host_time();
        self.send(&Message::AskClock)?;
        match self.receive(patience)? {
            Message::Clock(reading) => Ok(ClockExchange {
                asked,
                pi: reading.boot,
                pi_raw: Some(reading.raw),
                answered: host_time(),
            }),
            other => Err(self.unexpected("its clocks", &other)),
        }
    }

    /// How fast the link is, by bytes sent for that; the connection is used up by it.
    pub(super) fn probe(mut self, patience: Duration) -> Result<BytesPerSecond, RecorderError> {
        let n_bytes = MAX_PROBE_BYTES;
        self.send(&Message::Probe { n_bytes })?;
        let mut began: Option<Instant> = None;
        let (mut n_come, mut n_timed) = (0, 0);
        let mut last = Instant::now();
        while n_come < n_bytes && began.is_none_or(|began| began.elapsed() < PROBE) {
            match self.receive(patience)? {
                Message::Filler(bytes) if !bytes.is_empty() => {
                    n_come += bytes.len();
                    // The first is on the way for an unknown time; it starts the watch.
                    if began.is_some() {
                        n_timed += bytes.len();
                    }
                    began.get_or_insert_with(Instant::now);
                    last = Instant::now();
                }
                other => return Err(self.unexpected("filler", &other)),
            }
        }
        let seconds = began.map_or(0.0, |began| (last - began).as_secs_f64());
        Ok(BytesPerSecond(n_timed as f64 / seconds.max(1e-6)))
    }

    pub(super) fn unexpected(&self, expected: &str, found: &Message) -> RecorderError {
        let name = format!("{found:?}");
        let name = name.split(['(', ' ', '{']).next().unwrap_or_default();
        self.agent.failed(format!("expected {expected}, the agent sent {name}"))
    }
}

fn connect(agent: &AgentAddress, patience: Duration) -> Result<TcpStream, RecorderError> {
    let fail = |because: String| agent.failed(because);
    let resolved: Vec<SocketAddr> =
        agent.address().to_socket_addrs().map_err(|error| fail(error.to_string()))?.collect();
    let mut found = Err(fail("the name has no address".to_owned()));
    for target in &resolved {
        if matches!(agent, AgentAddress::Local { .. }) && !target.ip().is_loopback() {
            let because = format!(
                "{target} is another machine, and tcp:// is not encrypted; use tls:// with the \
                 keys of `evrig pair`"
            );
            return Err(fail(because));
        }
        found =
            TcpStream::connect_timeout(target, patience).map_err(|error| fail(error.to_string()));
        if found.is_ok() {
            break;
        }
    }
    let socket = found?;
    let set = socket.set_nodelay(true).and_then(|()| {
        socket.set_write_timeout(Some(patience))?;
        socket.set_read_timeout(Some(POLL_INTERVAL))
    });
    set.map_err(|error| fail(error.to_string()))?;
    Ok(socket)
}

/// The TLS handshake within its deadline, however slow the other side.
fn shake_hands(
    connection: &mut ClientConnection,
    socket: &mut TcpStream,
    deadline: Instant,
) -> io::Result<()> {
    while connection.is_handshaking() {
        if Instant::now() >= deadline {
            return Err(io::Error::new(ErrorKind::TimedOut, "no TLS handshake in time"));
        }
        while connection.wants_write() {
            connection.write_tls(socket)?;
        }
        if connection.is_handshaking() && connection.wants_read() {
            match connection.read_tls(socket) {
                Ok(0) => {
                    let because = "it closed the connection during the TLS handshake";
                    return Err(io::Error::new(ErrorKind::UnexpectedEof, because));
                }
                Ok(_) => {
                    connection.process_new_packets().map_err(io::Error::other)?;
                }
                Err(error) if is_tick(&error) => {}
                Err(error) => return Err(error),
            }
        }
    }
    while connection.wants_write() {
        connection.write_tls(socket)?;
    }
    Ok(())
}

fn is_tick(error: &io::Error) -> bool {
    matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted)
}

/// What TLS found, and what to do about it.
fn in_words(error: &io::Error) -> String {
    let inner = error.get_ref().and_then(|inner| inner.downcast_ref::<rustls::Error>());
    let what = match inner {
        Some(rustls::Error::InvalidCertificate(_)) => {
            "the agent's keys are of another pair; copy the `agent` half of this pair to the Pi"
        }
        Some(rustls::Error::AlertReceived(_)) => {
            "the agent refused our keys; both halves must be of one `evrig pair`"
        }
        Some(rustls::Error::InvalidMessage(_)) => {
            "no TLS there; the agent was started without --keys"
        }
        _ => return error.to_string(),
    };
    format!("{what} ({error})")
}
