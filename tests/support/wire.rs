//! A TCP proxy between two programs that fails on demand.

use std::io::{ErrorKind, Read, Write};
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, AtomicU8, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::Duration;

/// What the proxy does with the data of the server.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum WireFault {
    /// Forwards it.
    None,
    /// Closes every connection and accepts none.
    Unplugged,
    /// Forwards nothing.
    Silent,
    /// Forwards it slowly.
    Slow,
    /// Forwards random bytes.
    Garbage,
    /// Closes every connection once and accepts new ones.
    Restarted,
}

impl WireFault {
    const ALL: [Self; 6] =
        [Self::None, Self::Unplugged, Self::Silent, Self::Slow, Self::Garbage, Self::Restarted];
}

#[derive(Debug, Default)]
struct WireState {
    fault: AtomicU8,
    is_ending: AtomicBool,
    sockets: Mutex<Vec<TcpStream>>,
}

impl WireState {
    fn fault(&self) -> WireFault {
        WireFault::ALL[usize::from(self.fault.load(Ordering::SeqCst))]
    }

    fn close_all(&self) {
        for socket in self.sockets.lock().unwrap().drain(..) {
            let _ = socket.shutdown(Shutdown::Both);
        }
    }
}

/// A proxy to a server.
#[derive(Debug)]
pub struct FaultyWire {
    address: SocketAddr,
    shared: Arc<WireState>,
    thread: Option<JoinHandle<()>>,
}

const TICK: Duration = Duration::from_millis(5);
/// Bytes per read while the connection is slow.
const SLOW_BYTES: usize = 200;

impl FaultyWire {
    pub fn to(server: SocketAddr) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        let shared: Arc<WireState> = Arc::default();
        let its = Arc::clone(&shared);
        let thread = std::thread::spawn(move || {
            for client in listener.incoming() {
                if its.is_ending.load(Ordering::SeqCst) {
                    return;
                }
                let Ok(client) = client else { continue };
                if its.fault() == WireFault::Unplugged {
                    continue;
                }
                let Ok(upstream) = TcpStream::connect(server) else { continue };
                join(client, upstream, &its);
            }
        });
        Self { address, shared, thread: Some(thread) }
    }

    pub fn address(&self) -> String {
        self.address.to_string()
    }

    pub fn set(&self, fault: WireFault) {
        self.shared.fault.store(fault as u8, Ordering::SeqCst);
        if matches!(fault, WireFault::Unplugged | WireFault::Restarted) {
            self.shared.close_all();
        }
    }

    /// Forwards everything again.
    pub fn set_back(&self) {
        self.shared.fault.store(WireFault::None as u8, Ordering::SeqCst);
    }
}

impl Drop for FaultyWire {
    fn drop(&mut self) {
        self.shared.is_ending.store(true, Ordering::SeqCst);
        self.shared.close_all();
        // Wakes the acceptor, which waits for a connection.
        let _ = TcpStream::connect(self.address);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// Forwards bytes in both directions until one side closes.
fn join(client: TcpStream, server: TcpStream, shared: &Arc<WireState>) {
    let again = |socket: &TcpStream| socket.try_clone().unwrap();
    shared.sockets.lock().unwrap().extend([again(&client), again(&server)]);
    let (up_from, up_to) = (again(&client), again(&server));
    let (its, others) = (Arc::clone(shared), Arc::clone(shared));
    std::thread::spawn(move || pump(up_from, up_to, &its, false));
    std::thread::spawn(move || pump(server, client, &others, true));
}

fn pump(mut from: TcpStream, mut to: TcpStream, shared: &WireState, can_fail: bool) {
    from.set_read_timeout(Some(TICK)).unwrap();
    let mut buffer = vec![0; 1 << 16];
    let mut state = 0x9e37_79b9_u32;
    while !shared.is_ending.load(Ordering::SeqCst) {
        let fault = if can_fail { shared.fault() } else { WireFault::None };
        if fault == WireFault::Silent {
            std::thread::sleep(TICK);
            continue;
        }
        let n_max = if fault == WireFault::Slow { SLOW_BYTES } else { buffer.len() };
        let n = match from.read(&mut buffer[..n_max]) {
            Ok(0) => break,
            Ok(n) => n,
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {
                continue;
            }
            Err(_) => break,
        };
        if fault == WireFault::Garbage {
            for byte in &mut buffer[..n] {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                *byte = (state >> 24) as u8;
            }
        }
        if fault == WireFault::Slow {
            std::thread::sleep(TICK);
        }
        if to.write_all(&buffer[..n]).is_err() {
            break;
        }
    }
    let _ = from.shutdown(Shutdown::Both);
    let _ = to.shutdown(Shutdown::Both);
}
