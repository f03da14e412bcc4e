//! A server of one stream as AEDAT4 over TCP, as dv-processing's `NetworkReader` reads it.

use evrig_core::event::EventSlice;
use evrig_core::frame::Frame;
use evrig_core::time::Davis;
use evrig_format::aedat4::{Compression, Content, StreamSpec, WriteError, Writer};
use std::io::Write;
use std::net::{SocketAddr, TcpListener, TcpStream, ToSocketAddrs};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

/// Writes held for a client that is slow to read; what does not fit is dropped for it and counted.
const CLIENT_WRITES: usize = 256;
/// How long a client may take no byte before it is let go.
const CLIENT_PATIENCE: Duration = Duration::from_secs(5);

/// Why a stream cannot be served.
#[derive(Debug, thiserror::Error)]
pub enum StreamServerError {
    /// The address cannot be listened at.
    #[error("cannot listen at {address}: {source}; choose another port, or 0 for any")]
    Listen {
        /// Where.
        address: String,
        /// The system's reason.
        source: std::io::Error,
    },
    /// What was to be served cannot be written as AEDAT4.
    #[error(transparent)]
    Encode(#[from] WriteError),
}

/// Bytes that the encoder wrote since they were last taken.
#[derive(Debug, Clone, Default)]
struct Tap(Arc<Mutex<Vec<u8>>>);

impl Tap {
    fn drain(&self) -> Vec<u8> {
        std::mem::take(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

impl Write for Tap {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

#[derive(Debug, Default)]
struct StreamClients {
    is_ending: AtomicBool,
    n_dropped: AtomicU64,
    clients: Mutex<Clients>,
    joined: Condvar,
}

#[derive(Debug, Default)]
struct Clients {
    writes: Vec<SyncSender<Arc<[u8]>>>,
    threads: Vec<JoinHandle<()>>,
    n_joined: u64,
}

impl StreamClients {
    fn lock(&self) -> MutexGuard<'_, Clients> {
        self.clients.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Serves one stream to any number of clients until it is dropped.
#[derive(Debug)]
pub struct StreamServer {
    address: SocketAddr,
    tap: Tap,
    writer: Writer<Tap>,
    shared: Arc<StreamClients>,
    acceptor: Option<JoinHandle<()>>,
}

impl StreamServer {
    /// Listens at an address for clients that want the stream.
    ///
    /// # Errors
    /// When the address is taken or not of this machine.
    pub fn bind(
        address: impl ToSocketAddrs + std::fmt::Debug,
        stream: &StreamSpec,
        compression: Compression,
    ) -> Result<Self, StreamServerError> {
        let named = format!("{address:?}");
        let fail = |source| StreamServerError::Listen { address: named.clone(), source };
        let listener = TcpListener::bind(address).map_err(fail)?;
        let address = listener.local_addr().map_err(fail)?;
        let tap = Tap::default();
        let name = address.to_string();
        let writer =
            Writer::to_stream(tap.clone(), &name, compression, std::slice::from_ref(stream))?;
        let header: Arc<[u8]> = tap.drain().into();
        let shared: Arc<StreamClients> = Arc::default();
        let its = Arc::clone(&shared);
        let acceptor = std::thread::Builder::new()
            .name("davis server".to_owned())
            .spawn(move || accept(&listener, &header, &its))
            .map_err(fail)?;
        Ok(Self { address, tap, writer, shared, acceptor: Some(acceptor) })
    }

    /// Where it listens.
    #[must_use]
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Waits until so many clients have connected since the beginning; false when they did not
    /// come.
    #[must_use]
    pub fn wait_for_clients(&self, n: u64, patience: Duration) -> bool {
        let missing = |clients: &mut Clients| clients.n_joined < n;
        let waited = self.shared.joined.wait_timeout_while(self.shared.lock(), patience, missing);
        waited.unwrap_or_else(PoisonError::into_inner).0.n_joined >= n
    }

    /// Packets sent so far.
    #[must_use]
    pub const fn n_packets(&self) -> u64 {
        self.writer.n_packets()
    }

    /// Writes that some client was too slow for.
    #[must_use]
    pub fn n_dropped(&self) -> u64 {
        self.shared.n_dropped.load(Ordering::Relaxed)
    }

    /// Sends events to everyone connected.
    ///
    /// # Errors
    /// When the stream carries no events or they cannot be written.
    pub fn send_events(&mut self, events: EventSlice<'_>) -> Result<(), StreamServerError> {
        self.writer.write_events(0, events)?;
        self.broadcast();
        Ok(())
    }

    /// Sends a packet to everyone connected.
    ///
    /// # Errors
    /// When the stream carries something else or it cannot be written.
    pub fn send(&mut self, content: &Content) -> Result<(), StreamServerError> {
        content.write(&mut self.writer, 0)?;
        self.broadcast();
        Ok(())
    }

    /// Sends a frame to everyone connected.
    ///
    /// # Errors
    /// When the stream carries no frames or it cannot be written.
    pub fn send_frame(&mut self, frame: &Frame<Davis>) -> Result<(), StreamServerError> {
        self.writer.write_frame(0, frame)?;
        self.broadcast();
        Ok(())
    }

    fn broadcast(&self) {
        let bytes: Arc<[u8]> = self.tap.drain().into();
        self.shared.lock().writes.retain(|client| match client.try_send(Arc::clone(&bytes)) {
            Ok(()) => true,
            Err(TrySendError::Full(_)) => {
                self.shared.n_dropped.fetch_add(1, Ordering::Relaxed);
                true
            }
            Err(TrySendError::Disconnected(_)) => false,
        });
    }
}

impl Drop for StreamServer {
    fn drop(&mut self) {
        self.shared.is_ending.store(true, Ordering::Relaxed);
        // The acceptor waits in `accept`: a connection of our own lets it look up.
        let _ = TcpStream::connect_timeout(&self.address, CLIENT_PATIENCE);
        if let Some(acceptor) = self.acceptor.take() {
            let _ = acceptor.join();
        }
        let threads = {
            let mut clients = self.shared.lock();
            clients.writes.clear();
            std::mem::take(&mut clients.threads)
        };
        for thread in threads {
            // Ends once what is queued was sent, or the client took nothing for its patience.
            let _ = thread.join();
        }
    }
}

fn accept(listener: &TcpListener, header: &Arc<[u8]>, shared: &Arc<StreamClients>) {
    for socket in listener.incoming() {
        if shared.is_ending.load(Ordering::Relaxed) {
            return;
        }
        // A client that is gone before it was served is none.
        let Ok(socket) = socket else { continue };
        let (writes, queued) = sync_channel(CLIENT_WRITES);
        if writes.try_send(Arc::clone(header)).is_err() {
            continue;
        }
        let started = std::thread::Builder::new()
            .name("davis client".to_owned())
            .spawn(move || feed(socket, &queued));
        if let Ok(thread) = started {
            let mut clients = shared.lock();
            clients.threads.retain(|thread| !thread.is_finished());
            clients.writes.push(writes);
            clients.threads.push(thread);
            clients.n_joined += 1;
            shared.joined.notify_all();
        }
    }
}

fn feed(mut socket: TcpStream, queued: &Receiver<Arc<[u8]>>) {
    let _ = socket.set_nodelay(true);
    if socket.set_write_timeout(Some(CLIENT_PATIENCE)).is_err() {
        return;
    }
    for bytes in queued {
        if socket.write_all(&bytes).is_err() {
            return;
        }
    }
}
