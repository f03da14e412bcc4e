//! The agent: serves a camera to one host at a time.

use super::read_clocks;
use super::source::{FrameSource, SourceError};
use super::wire::{self, Decoder, Message, PREAMBLE_BYTES, WireError};
use std::io::{self, Read, Write};
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

/// Frames kept while the network is slower than the camera; the next are dropped and counted.
const RING_FRAMES: usize = 64;
/// A host asks for the clock every second: one that is silent for so long is gone.
const HOST_SILENCE: Duration = Duration::from_secs(10);
/// How long the host may take no byte.
const HOST_BUSY: Duration = Duration::from_secs(10);

/// Why the agent does not serve.
#[derive(Debug, thiserror::Error)]
pub enum AgentError {
    /// Everyone on the network could listen in.
    #[error(
        "{address} can be reached from outside, and the wire is not encrypted; listen at 127.0.0.1 and carry it further with `ssh -L`"
    )]
    NotLoopback {
        /// Where it was to listen.
        address: SocketAddr,
    },
    /// The address is taken.
    #[error("cannot listen at {address}: {source}; is another agent running there?")]
    Listen {
        /// Where.
        address: SocketAddr,
        /// The system's reason.
        source: io::Error,
    },
}

/// Why a connection ended early.
#[derive(Debug, thiserror::Error)]
enum Lost {
    #[error(transparent)]
    Wire(#[from] WireError),
    #[error(transparent)]
    Io(#[from] io::Error),
    #[error(transparent)]
    Source(#[from] SourceError),
}

type Camera = Arc<Mutex<Box<dyn FrameSource>>>;

/// An agent that serves until it is dropped.
#[derive(Debug)]
pub struct Agent {
    address: SocketAddr,
    is_ending: Arc<AtomicBool>,
    sockets: Arc<Mutex<Vec<TcpStream>>>,
    acceptor: Option<JoinHandle<()>>,
}

impl Agent {
    /// Serves a camera at an address of the loopback interface.
    ///
    /// # Errors
    /// When the address is another, or taken.
    pub fn serve(address: SocketAddr, camera: Box<dyn FrameSource>) -> Result<Self, AgentError> {
        if !address.ip().is_loopback() {
            return Err(AgentError::NotLoopback { address });
        }
        let failed = |source| AgentError::Listen { address, source };
        let listener = TcpListener::bind(address).map_err(failed)?;
        let bound = listener.local_addr().map_err(failed)?;
        let is_ending = Arc::new(AtomicBool::new(false));
        let sockets: Arc<Mutex<Vec<TcpStream>>> = Arc::default();
        let (ending, known) = (Arc::clone(&is_ending), Arc::clone(&sockets));
        let acceptor = std::thread::Builder::new()
            .name("pi agent".to_owned())
            .spawn(move || accept(&listener, &Arc::new(Mutex::new(camera)), &ending, &known))
            .map_err(failed)?;
        Ok(Self { address: bound, is_ending, sockets, acceptor: Some(acceptor) })
    }

    /// Where it listens.
    #[must_use]
    pub const fn address(&self) -> SocketAddr {
        self.address
    }
}

impl Drop for Agent {
    fn drop(&mut self) {
        self.is_ending.store(true, Ordering::Relaxed);
        for socket in lock(&self.sockets).drain(..) {
            // It may be closed from the other side already.
            let _ = socket.shutdown(Shutdown::Both);
        }
        // The acceptor waits in `accept`: a connection of our own lets it look up.
        let _ = TcpStream::connect_timeout(&self.address, HOST_BUSY);
        if let Some(acceptor) = self.acceptor.take() {
            let _ = acceptor.join();
        }
    }
}

fn lock<T: ?Sized>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    // What is locked here is whole between any two statements.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

fn accept(
    listener: &TcpListener,
    camera: &Camera,
    is_ending: &AtomicBool,
    sockets: &Mutex<Vec<TcpStream>>,
) {
    let is_busy = Arc::new(AtomicBool::new(false));
    for socket in listener.incoming() {
        if is_ending.load(Ordering::Relaxed) {
            return;
        }
        let Ok(mut socket) = socket else { continue };
        if is_busy.swap(true, Ordering::AcqRel) {
            let because = "another recorder uses this camera; end that recording first".to_owned();
            // A client that does not wait for the refusal needs none.
            let _ = socket
                .write_all(&wire::preamble())
                .and_then(|()| socket.write_all(&wire::encode(&Message::Refused { because })));
            continue;
        }
        if let Ok(copy) = socket.try_clone() {
            let mut sockets = lock(sockets);
            sockets.clear();
            sockets.push(copy);
        }
        let (camera, busy) = (Arc::clone(camera), Arc::clone(&is_busy));
        let started = std::thread::Builder::new().name("pi host".to_owned()).spawn(move || {
            let host = Arc::new(Mutex::new(socket));
            if let Err(lost) = converse(&host, &camera) {
                // The host may be gone, which is then the reason; else it learns it here.
                let _ = send(&host, &Message::Refused { because: lost.to_string() });
            }
            busy.store(false, Ordering::Release);
        });
        if started.is_err() {
            is_busy.store(false, Ordering::Release);
        }
    }
}

fn send(host: &Mutex<TcpStream>, message: &Message) -> io::Result<()> {
    lock(host).write_all(&wire::encode(message))
}

/// Answers one host until it leaves.
fn converse(host: &Arc<Mutex<TcpStream>>, camera: &Camera) -> Result<(), Lost> {
    let mut from_host = lock(host).try_clone()?;
    from_host.set_nodelay(true)?;
    from_host.set_read_timeout(Some(HOST_SILENCE))?;
    from_host.set_write_timeout(Some(HOST_BUSY))?;
    lock(host).write_all(&wire::preamble())?;
    let mut preamble = [0; PREAMBLE_BYTES];
    from_host.read_exact(&mut preamble)?;
    wire::check_preamble(&preamble)?;
    let what = lock(camera).describe();
    send(host, &Message::Hello { camera: format!("{what}, evrig {}", env!("CARGO_PKG_VERSION")) })?;
    let mut decoder = Decoder::default();
    let mut buffer = [0; 4096];
    let mut stream: Option<Stream> = None;
    loop {
        while let Some(message) = decoder.take()? {
            match message {
                Message::Configure(_) | Message::Start if stream.is_some() => {
                    // The camera belongs to the frames under way.
                    let because = "frames are flowing; stop them first".to_owned();
                    send(host, &Message::Refused { because })?;
                }
                Message::Configure(settings) => {
                    let settings = lock(camera).configure(&settings)?;
                    send(host, &Message::Configured(settings))?;
                }
                Message::Start => stream = Some(Stream::start(host, camera)?),
                Message::AskClock => send(host, &Message::Clock(read_clocks()))?,
                Message::Stop => {
                    let (n_sent, n_dropped) = stream.take().map_or((0, 0), Stream::stop);
                    send(host, &Message::Stopped { n_sent, n_dropped })?;
                }
                _ => {}
            }
        }
        match from_host.read(&mut buffer)? {
            0 => return Ok(()),
            n => decoder.push(&buffer[..n]),
        }
    }
}

#[derive(Debug, Default)]
struct Counters {
    is_ending: AtomicBool,
    n_sent: AtomicU64,
    n_dropped: AtomicU64,
}

/// Frames under way: one thread takes them, one sends them.
struct Stream {
    counters: Arc<Counters>,
    threads: Vec<JoinHandle<()>>,
}

impl Stream {
    fn start(host: &Arc<Mutex<TcpStream>>, camera: &Camera) -> io::Result<Self> {
        let counters: Arc<Counters> = Arc::default();
        let (ring, frames) = sync_channel::<Message>(RING_FRAMES);
        let (camera, its, its_host) = (Arc::clone(camera), Arc::clone(&counters), Arc::clone(host));
        let take = std::thread::Builder::new().name("pi camera".to_owned()).spawn(move || {
            let mut camera = lock(&camera);
            while !its.is_ending.load(Ordering::Relaxed) {
                if let Err(error) = capture(&mut **camera, &ring, &its) {
                    let _ = send(&its_host, &Message::Refused { because: error.to_string() });
                    return;
                }
            }
        })?;
        let mut stream = Self { counters: Arc::clone(&counters), threads: vec![take] };
        let host = Arc::clone(host);
        stream.threads.push(std::thread::Builder::new().name("pi sender".to_owned()).spawn(
            move || {
                for frame in frames {
                    if send(&host, &frame).is_err() {
                        counters.is_ending.store(true, Ordering::Relaxed);
                        return;
                    }
                    counters.n_sent.fetch_add(1, Ordering::Relaxed);
                }
            },
        )?);
        Ok(stream)
    }

    /// Takes no more frames, sends those in the ring, and counts.
    fn stop(mut self) -> (u64, u64) {
        self.end();
        let count = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
        (count(&self.counters.n_sent), count(&self.counters.n_dropped))
    }

    fn end(&mut self) {
        self.counters.is_ending.store(true, Ordering::Relaxed);
        for thread in self.threads.drain(..) {
            // A panic there was reported by its own hook.
            let _ = thread.join();
        }
    }
}

impl Drop for Stream {
    fn drop(&mut self) {
        self.end();
    }
}

fn capture(
    camera: &mut dyn FrameSource,
    ring: &SyncSender<Message>,
    counters: &Counters,
) -> Result<(), SourceError> {
    let Some(mut frame) = camera.next()? else { return Ok(()) };
    frame.metadata.n_dropped = counters.n_dropped.load(Ordering::Relaxed);
    match ring.try_send(Message::Frame(Box::new(frame))) {
        Ok(()) => {}
        Err(TrySendError::Full(_)) => {
            counters.n_dropped.fetch_add(1, Ordering::Relaxed);
        }
        Err(TrySendError::Disconnected(_)) => counters.is_ending.store(true, Ordering::Relaxed),
    }
    Ok(())
}
