//! The agent: serves a camera to one host at a time.
//!
//! Without keys it listens on the loopback interface only. With keys, everything before the proof
//! that the other side has the pair's other half is bounded: how many may be at it at a time, how
//! long each may take, and how often one address may fail.

mod backlog;
mod connection;
mod frame_stream;
mod gate;
mod writer;

pub use backlog::{BacklogLimits, Spool};

use super::keys::Keys;
use super::source::FrameSource;
use connection::AgentState;
use gate::Gate;
use rustls::ServerConfig;
use std::io;
use std::net::SocketAddr;
use std::sync::{Arc, Mutex};
use std::time::Duration;
use tokio::net::{TcpListener, TcpStream};
use tokio::runtime::Runtime;
use tokio::sync::Semaphore;
use tokio_rustls::TlsAcceptor;
use writer::{AgentStream, ConnectionError, SharedCamera};

/// Bytes that wait for the network in memory, before the spool or the drop.
const MEMORY_BYTES: usize = 64 << 20;
/// For the TLS handshake and the preamble.
const HANDSHAKE: Duration = Duration::from_secs(5);
/// Connections that may be in their handshake at a time; further ones wait in the system's queue.
const N_HANDSHAKES: usize = 8;
/// For the tasks under way when the agent ends.
const ENDING: Duration = Duration::from_secs(2);

/// Why the agent does not serve.
#[derive(Debug, thiserror::Error)]
pub enum AgentError {
    /// Everyone on the network could listen in.
    #[error(
        "{address} can be reached from outside: that needs keys; make them with `evrig pair` and \
         give their directory as --keys, or listen at 127.0.0.1"
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
    /// The keys do not work.
    #[error(transparent)]
    Keys(#[from] super::keys::KeysError),
}

/// Where and how an agent serves.
#[derive(Debug)]
pub struct Service {
    /// Where it listens.
    pub address: SocketAddr,
    /// What it proves itself with, and lets only the other half in.
    pub keys: Option<Keys>,
    /// What may wait for a network that is slower than the camera.
    pub limits: BacklogLimits,
}

impl Service {
    /// On the loopback interface: without keys, without a spool.
    #[must_use]
    pub const fn local(address: SocketAddr) -> Self {
        let limits = BacklogLimits { memory_bytes: MEMORY_BYTES, spool: None };
        Self { address, keys: None, limits }
    }
}

/// An agent that serves until it is dropped.
#[derive(Debug)]
pub struct Agent {
    address: SocketAddr,
    runtime: Option<Runtime>,
}

impl Agent {
    /// Serves a camera at an address of the loopback interface.
    ///
    /// # Errors
    /// When the address is another, or taken.
    pub fn serve(address: SocketAddr, camera: Box<dyn FrameSource>) -> Result<Self, AgentError> {
        Self::open(Service::local(address), camera)
    }

    /// Serves a camera.
    ///
    /// # Errors
    /// When the address is beyond loopback and there are no keys, or it is taken.
    pub fn open(service: Service, camera: Box<dyn FrameSource>) -> Result<Self, AgentError> {
        let address = service.address;
        if service.keys.is_none() && !address.ip().is_loopback() {
            return Err(AgentError::NotLoopback { address });
        }
        let tls = service.keys.map(Keys::server).transpose()?;
        let failed = |source| AgentError::Listen { address, source };
        let runtime = tokio::runtime::Builder::new_multi_thread()
            .worker_threads(2)
            .thread_name("pi agent")
            .enable_all()
            .build()
            .map_err(failed)?;
        let listener = runtime.block_on(TcpListener::bind(address)).map_err(failed)?;
        let bound = listener.local_addr().map_err(failed)?;
        let camera: SharedCamera = Arc::new(Mutex::new(camera));
        let shared = Arc::new(AgentState::new(camera, service.limits));
        runtime.spawn(accept(listener, tls, shared));
        Ok(Self { address: bound, runtime: Some(runtime) })
    }

    /// Where it listens.
    #[must_use]
    pub const fn address(&self) -> SocketAddr {
        self.address
    }
}

impl Drop for Agent {
    fn drop(&mut self) {
        if let Some(runtime) = self.runtime.take() {
            runtime.shutdown_timeout(ENDING);
        }
    }
}

async fn accept(listener: TcpListener, tls: Option<Arc<ServerConfig>>, shared: Arc<AgentState>) {
    let gate = Arc::new(Gate::default());
    let places = Arc::new(Semaphore::new(N_HANDSHAKES));
    loop {
        let Ok(place) = Arc::clone(&places).acquire_owned().await else { return };
        let Ok((socket, from)) = listener.accept().await else {
            // Out of descriptors, say: the next try must not be a busy loop.
            tokio::time::sleep(Duration::from_millis(100)).await;
            continue;
        };
        if !gate.admits(from.ip()) {
            continue;
        }
        let (tls, shared, gate) = (tls.clone(), Arc::clone(&shared), Arc::clone(&gate));
        tokio::spawn(async move {
            let greeted = tokio::time::timeout(HANDSHAKE, greet(socket, tls)).await;
            drop(place);
            match greeted {
                Ok(Ok(line)) => shared.converse(line).await,
                // An unauthenticated client receives nothing but the TLS alert.
                Ok(Err(_)) | Err(_) => gate.failed(from.ip()),
            }
        });
    }
}

/// Proves who is who, where that is asked for, and compares versions.
async fn greet(
    socket: TcpStream,
    tls: Option<Arc<ServerConfig>>,
) -> Result<Box<dyn AgentStream>, ConnectionError> {
    socket.set_nodelay(true)?;
    let mut line: Box<dyn AgentStream> = match tls {
        None => Box::new(socket),
        Some(config) => Box::new(TlsAcceptor::from(config).accept(socket).await?),
    };
    connection::exchange_preambles(&mut line).await?;
    Ok(line)
}
