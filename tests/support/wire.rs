//! A TCP wire between two programs that fails on demand.

use std::io::{ErrorKind, Read, Write};
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, AtomicU8, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::Duration;

/// What a wire does with what the server sends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Fault {
    /// Hands it on.
    None,
    /// Closes every connection and takes no new one.
    Unplugged,
    /// Keeps it.
    Silent,
    /// Hands on a trickle.
    Slow,
    /// Hands on other bytes.
    Garbage,
    /// Closes every connection once, and takes new ones.
    Restarted,
}

impl Fault {
    const ALL: [Self; 6] =
        [Self::None, Self::Unplugged, Self::Silent, Self::Slow, Self::Garbage, Self::Restarted];
}

#[derive(Debug, Default)]
struct Shared {
    fault: AtomicU8,
    is_ending: AtomicBool,
    sockets: Mutex<Vec<TcpStream>>,
}

impl Shared {
    fn fault(&self) -> Fault {
        Fault::ALL[usize::from(self.fault.load(Ordering::SeqCst))]
    }

    fn close_all(&self) {
        for socket in self.sockets.lock().unwrap().drain(..) {
            let _ = socket.shutdown(Shutdown::Both);
        }
    }
}

/// A wire to a server.
#[derive(Debug)]
pub struct Wire {
    address: SocketAddr,
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

const TICK: Duration = Duration::from_millis(5);
const TRICKLE: usize = 200;

impl Wire {
    pub fn to(server: SocketAddr) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        let shared: Arc<Shared> = Arc::default();
        let its = Arc::clone(&shared);
        let thread = std::thread::spawn(move || {
            for client in listener.incoming() {
                if its.is_ending.load(Ordering::SeqCst) {
                    return;
                }
                let Ok(client) = client else { continue };
                if its.fault() == Fault::Unplugged {
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

    pub fn set(&self, fault: Fault) {
        self.shared.fault.store(fault as u8, Ordering::SeqCst);
        if matches!(fault, Fault::Unplugged | Fault::Restarted) {
            self.shared.close_all();
        }
    }
}

impl Wire {
    /// Hands everything on again.
    pub fn set_back(&self) {
        self.shared.fault.store(Fault::None as u8, Ordering::SeqCst);
    }
}

impl Drop for Wire {
    fn drop(&mut self) {
        self.shared.is_ending.store(true, Ordering::SeqCst);
        self.shared.close_all();
        // The acceptor waits for a connection: this is the last.
        let _ = TcpStream::connect(self.address);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// Hands bytes on both ways until one side closes.
fn join(client: TcpStream, server: TcpStream, shared: &Arc<Shared>) {
    let again = |socket: &TcpStream| socket.try_clone().unwrap();
    shared.sockets.lock().unwrap().extend([again(&client), again(&server)]);
    let (up_from, up_to) = (again(&client), again(&server));
    let (its, others) = (Arc::clone(shared), Arc::clone(shared));
    std::thread::spawn(move || pump(up_from, up_to, &its, false));
    std::thread::spawn(move || pump(server, client, &others, true));
}

fn pump(mut from: TcpStream, mut to: TcpStream, shared: &Shared, can_fail: bool) {
    from.set_read_timeout(Some(TICK)).unwrap();
    let mut buffer = vec![0; 1 << 16];
    let mut state = 0x9e37_79b9_u32;
    while !shared.is_ending.load(Ordering::SeqCst) {
        let fault = if can_fail { shared.fault() } else { Fault::None };
        if fault == Fault::Silent {
            std::thread::sleep(TICK);
            continue;
        }
        let room = if fault == Fault::Slow { TRICKLE } else { buffer.len() };
        let n = match from.read(&mut buffer[..room]) {
            Ok(0) => break,
            Ok(n) => n,
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {
                continue;
            }
            Err(_) => break,
        };
        if fault == Fault::Garbage {
            for byte in &mut buffer[..n] {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                *byte = (state >> 24) as u8;
            }
        }
        if fault == Fault::Slow {
            std::thread::sleep(TICK);
        }
        if to.write_all(&buffer[..n]).is_err() {
            break;
        }
    }
    let _ = from.shutdown(Shutdown::Both);
    let _ = to.shutdown(Shutdown::Both);
}
