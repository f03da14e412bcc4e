//! The simulated DAVIS as a server: AEDAT4 over TCP, one stream a port.

use super::live::LiveWorld;
use super::progress::TwinProgress;
use super::world::{DAVIS_STEP, DavisPacket, DavisTwin};
use evrig_core::time::Span;
use evrig_device::stream_server::{StreamServer, StreamServerError};
use evrig_format::aedat4::{Compression, StreamSpec};
use evrig_session::rig::Rig;
use std::net::SocketAddr;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;

/// The name of the camera in its streams.
pub const SOURCE: &str = "DAVIS346_SIM";
/// The twin needs the tool's speed slightly beyond the time it renders.
const BEYOND: Span = Span::from_micros(2_000);
/// Polling interval.
const TICK: Duration = Duration::from_millis(4);

/// The streams of the simulated DAVIS: events, frames if the rig has them, inertial samples.
#[must_use]
pub fn streams(rig: &Rig) -> Vec<StreamSpec> {
    let size = rig.davis.camera.size;
    let frames = rig.davis.aps.then(|| StreamSpec::frames(size, SOURCE));
    let events = [StreamSpec::events(size, SOURCE)];
    events.into_iter().chain(frames).chain([StreamSpec::imu(SOURCE)]).collect()
}

/// A simulated DAVIS that serves until it is dropped.
#[derive(Debug)]
pub struct DavisServer {
    addresses: Vec<SocketAddr>,
    progress: TwinProgress,
    thread: Option<JoinHandle<()>>,
}

impl DavisServer {
    /// Serves its streams, each at a port of its own from `address` on (0 for any). The camera is
    /// switched on by [`TwinProgress::begin`].
    ///
    /// # Errors
    /// When an address is taken.
    pub fn serve(live: Arc<LiveWorld>, address: SocketAddr) -> Result<Self, StreamServerError> {
        let streams = streams(live.world().rig());
        let mut servers = Vec::new();
        for (number, stream) in streams.iter().enumerate() {
            let mut at = address;
            if at.port() != 0 {
                at.set_port(at.port().saturating_add(number as u16));
            }
            servers.push(StreamServer::bind(at, stream, Compression::None)?);
        }
        let addresses: Vec<_> = servers.iter().map(StreamServer::address).collect();
        let progress = TwinProgress::default();
        let its = progress.clone();
        let thread = std::thread::Builder::new()
            .name("simulated davis".to_owned())
            .spawn(move || run(&live, &mut servers, &its))
            .map_err(|source| StreamServerError::Listen { address: address.to_string(), source })?;
        Ok(Self { addresses, progress, thread: Some(thread) })
    }

    /// Where the streams are, in the order of [`streams`].
    #[must_use]
    pub fn addresses(&self) -> &[SocketAddr] {
        &self.addresses
    }

    /// Its progress.
    #[must_use]
    pub fn progress(&self) -> &TwinProgress {
        &self.progress
    }
}

impl Drop for DavisServer {
    fn drop(&mut self) {
        self.progress.end();
        if let Some(thread) = self.thread.take() {
            // A panic there was reported by its own hook.
            let _ = thread.join();
        }
    }
}

fn run(live: &LiveWorld, servers: &mut [StreamServer], progress: &TwinProgress) {
    let mut twin: Option<DavisTwin> = None;
    loop {
        let now = progress.look();
        if now.is_ending {
            return;
        }
        let Some(begun) = now.begun else {
            progress.wait(TICK);
            continue;
        };
        let twin = twin.get_or_insert_with(|| DavisTwin::new(Arc::clone(live.world()), begun));
        let end = twin.position() + DAVIS_STEP;
        let is_over = live.closed_at().is_some_and(|closed_at| twin.position() >= closed_at);
        if is_over || end + BEYOND > live.known_until() {
            progress.wait(TICK);
            continue;
        }
        let packet = twin.next_packet();
        // What a server cannot encode is not of this camera; there is nobody to report it to.
        let _ = send(servers, packet, live.world().rig().davis.aps);
        let n_sent = servers.iter().map(StreamServer::n_packets).sum();
        progress.change(|twin| {
            twin.position = end;
            twin.n_sent = n_sent;
        });
    }
}

fn send(
    servers: &mut [StreamServer],
    packet: DavisPacket,
    has_frames: bool,
) -> Result<(), StreamServerError> {
    for (stream, content) in packet.contents(has_frames) {
        if let Some(server) = servers.get_mut(stream as usize) {
            server.send(&content)?;
        }
    }
    Ok(())
}
