//! A camera behind TCP: one connection a stream, each with its deadlines, each taken up again.

use super::streams::{describe, spec};
use evrig_format::aedat4::{PayloadKind, ReadError, Reader, StreamSpec};
use evrig_record::Finding;
use evrig_record::recorder::{
    PreparedRecorder, Recorder, RecorderError, RecorderMonitor, RecorderSample, RecorderTally,
    SampleSender, host_time,
};
use std::io::{ErrorKind, Read};
use std::net::{Shutdown, TcpStream, ToSocketAddrs};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// How long is waited for what.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NetworkDavisTimeouts {
    /// For a connection and its header.
    pub connect: Duration,
    /// Without a byte, after which a connection counts as half-open and is made anew.
    pub silence: Duration,
    /// For a lost server to come back before the device counts as lost.
    pub reconnect: Duration,
    /// For what is still under way when a recording ends.
    pub drain: Duration,
}

impl Default for NetworkDavisTimeouts {
    fn default() -> Self {
        Self {
            connect: Duration::from_secs(3),
            silence: Duration::from_secs(5),
            reconnect: Duration::from_secs(10),
            drain: Duration::from_millis(300),
        }
    }
}

/// Between two attempts to connect.
const BETWEEN_ATTEMPTS: Duration = Duration::from_millis(100);

type Connection = (Reader<TcpStream>, TcpStream, StreamSpec);

/// A DAVIS346 behind a server.
#[derive(Debug)]
pub struct NetworkDavis {
    addresses: Vec<String>,
    patience: NetworkDavisTimeouts,
    monitor: Arc<RecorderMonitor>,
    /// Connections made while preparing, in the order of the addresses.
    ready: Vec<Connection>,
    /// The sockets in use, to break them off.
    sockets: Arc<Mutex<Vec<Option<TcpStream>>>>,
    threads: Vec<JoinHandle<()>>,
}

/// One stream's place in the whole.
#[derive(Debug, Clone)]
struct StreamConnection {
    address: String,
    number: u32,
    spec: StreamSpec,
    patience: NetworkDavisTimeouts,
    sockets: Arc<Mutex<Vec<Option<TcpStream>>>>,
}

impl NetworkDavis {
    /// Will connect to `HOST:PORT`, or several with commas between them, one a stream.
    #[must_use]
    pub fn new(addresses: &str, patience: NetworkDavisTimeouts) -> Self {
        Self {
            addresses: addresses.split(',').map(|address| address.trim().to_owned()).collect(),
            patience,
            monitor: Arc::default(),
            ready: Vec::new(),
            sockets: Arc::default(),
            threads: Vec::new(),
        }
    }

    fn stop(&mut self) {
        self.monitor.end();
        let sockets = self.sockets.lock().unwrap_or_else(PoisonError::into_inner);
        for socket in sockets.iter().flatten() {
            // It may be closed from the other side already.
            let _ = socket.shutdown(Shutdown::Both);
        }
        drop(sockets);
        for thread in self.threads.drain(..) {
            // A panic there was reported by its own hook.
            let _ = thread.join();
        }
        self.ready.clear();
    }
}

impl Recorder for NetworkDavis {
    fn name(&self) -> &'static str {
        "davis"
    }

    fn check(&mut self) -> Vec<Finding> {
        let look = |address: &String| match connect(address, self.patience) {
            Ok((_, _, spec)) => Finding::good(
                "davis",
                format!("{address} serves {} of {}", spec.kind.identifier(), spec.source),
            ),
            Err(error) => Finding::bad("davis", error.to_string()),
        };
        self.addresses.iter().map(look).collect()
    }

    fn prepare(&mut self) -> Result<PreparedRecorder, RecorderError> {
        self.ready.clear();
        for address in &self.addresses {
            self.ready.push(connect(address, self.patience)?);
        }
        let streams: Vec<_> = self.ready.iter().map(|(_, _, spec)| spec.clone()).collect();
        Ok(PreparedRecorder { description: describe(&self.addresses.join(","), &streams), streams })
    }

    fn start(&mut self, outlet: SampleSender) -> Result<(), RecorderError> {
        let ready = std::mem::take(&mut self.ready);
        if ready.is_empty() {
            return Err(failed(&self.addresses.join(","), "it was not prepared"));
        }
        let mut sockets = self.sockets.lock().unwrap_or_else(PoisonError::into_inner);
        *sockets = ready.iter().map(|(_, socket, _)| socket.try_clone().ok()).collect();
        drop(sockets);
        for (number, (reader, _, spec)) in ready.into_iter().enumerate() {
            let line = StreamConnection {
                address: self.addresses[number].clone(),
                number: number as u32,
                spec,
                patience: self.patience,
                sockets: Arc::clone(&self.sockets),
            };
            let address = line.address.clone();
            let work = move |outlet: &SampleSender, monitor: &RecorderMonitor| {
                line.record(reader, outlet, monitor)
            };
            let thread = self.monitor.spawn("davis", outlet.clone(), work);
            self.threads.push(thread.map_err(|error| failed(&address, error))?);
        }
        let patience = self.patience.silence;
        if self.monitor.wait_for_first(patience)? {
            return Ok(());
        }
        let because = format!("connected, but no packet came within {patience:?}");
        Err(failed(&self.addresses.join(","), because))
    }

    fn progress(&mut self) -> Result<RecorderTally, RecorderError> {
        self.monitor.progress()
    }

    fn finish(&mut self) -> Result<RecorderTally, RecorderError> {
        // What the server has sent by now arrives within the time to drain; it never ends by
        // itself.
        let n_lines = self.threads.len();
        self.monitor.wait(self.patience.drain, |state| state.n_running == n_lines);
        self.stop();
        self.monitor.progress()
    }

    fn abort(&mut self) {
        self.stop();
    }
}

impl Drop for NetworkDavis {
    fn drop(&mut self) {
        self.stop();
    }
}

impl StreamConnection {
    /// Reads until the recording ends or the server stays away.
    fn record(
        &self,
        mut reader: Reader<TcpStream>,
        outlet: &SampleSender,
        monitor: &RecorderMonitor,
    ) -> Result<(), RecorderError> {
        let mut last_packet = Instant::now();
        loop {
            let why = loop {
                match reader.next() {
                    Some(Ok(packet)) => {
                        last_packet = Instant::now();
                        let (stream, arrived) = (self.number, host_time());
                        let content = packet.content;
                        monitor.offer(outlet, RecorderSample::Packet { stream, arrived, content });
                    }
                    Some(Err(ReadError::Io { source, .. })) if is_silence(&source) => {
                        break format!("not a byte within {:?}", self.patience.silence);
                    }
                    Some(Err(error)) => break error.to_string(),
                    None => break "the server closed the connection".to_owned(),
                }
            };
            let lost = reader.losses();
            if !lost.is_none() {
                let text = format!("{}: {lost:?}", self.address);
                monitor.change(|state| state.tally.gaps.push(text));
            }
            if monitor.is_ending() {
                self.report_silence(last_packet, monitor);
                return Ok(());
            }
            let since = Instant::now();
            let again = self.reconnect(monitor).map_err(|error| {
                let because = format!("{why}, and then: {}", error.because);
                RecorderError { because, ..error }
            })?;
            let Some(again) = again else { return Ok(()) };
            let away_s = since.elapsed().as_secs_f64();
            let gap = format!("{}: away for {away_s:.3} s ({why})", self.address);
            monitor.change(|state| state.tally.gaps.push(gap));
            reader = again;
        }
    }

    /// A wire that died shortly before the end is not yet known to be dead. A scene in which
    /// nothing happens looks the same, so this is reported and nothing more.
    fn report_silence(&self, last_packet: Instant, monitor: &RecorderMonitor) {
        let silence = last_packet.elapsed();
        if silence > self.patience.silence / 2 + self.patience.drain {
            let seconds = silence.as_secs_f64();
            let text = format!("{}: nothing came in the last {seconds:.1} s", self.address);
            monitor.change(|state| state.tally.gaps.push(text));
        }
    }

    /// Tries until the server is back with the same stream; none when the recording ends meanwhile.
    fn reconnect(
        &self,
        monitor: &RecorderMonitor,
    ) -> Result<Option<Reader<TcpStream>>, RecorderError> {
        let deadline = Instant::now() + self.patience.reconnect;
        loop {
            if monitor.is_ending() {
                return Ok(None);
            }
            let again = connect(&self.address, self.patience).and_then(|(reader, socket, spec)| {
                if spec != self.spec {
                    let because = format!("expected {:?}, it now serves {spec:?}", self.spec);
                    return Err(failed(&self.address, because));
                }
                Ok((reader, socket))
            });
            match again {
                Ok((reader, socket)) => {
                    let mut sockets = self.sockets.lock().unwrap_or_else(PoisonError::into_inner);
                    sockets[self.number as usize] = Some(socket);
                    return Ok(Some(reader));
                }
                Err(error) if Instant::now() >= deadline => return Err(error),
                Err(_) => monitor.wait(BETWEEN_ATTEMPTS, |_| !monitor.is_ending()),
            }
        }
    }
}

/// Whether a read ended because nothing came in its time.
fn is_silence(error: &std::io::Error) -> bool {
    matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut)
}

/// Connects and reads the header.
fn connect(address: &str, patience: NetworkDavisTimeouts) -> Result<Connection, RecorderError> {
    let fail = |because: String| failed(address, because);
    let resolved = address.to_socket_addrs().map_err(|error| fail(error.to_string()))?;
    let mut refused = "the name has no address".to_owned();
    for target in resolved {
        match TcpStream::connect_timeout(&target, patience.connect) {
            Ok(socket) => return begin(address, socket, patience),
            Err(error) => refused = error.to_string(),
        }
    }
    Err(fail(refused))
}

fn begin(
    address: &str,
    socket: TcpStream,
    patience: NetworkDavisTimeouts,
) -> Result<Connection, RecorderError> {
    let fail = |error: std::io::Error| failed(address, error);
    socket.set_read_timeout(Some(patience.connect)).map_err(fail)?;
    let other = socket.try_clone().map_err(fail)?;
    let reader = Reader::from_stream(socket, address).map_err(|error| match error {
        ReadError::Io { source, .. } if is_silence(&source) => {
            failed(address, format!("connected, but no header came within {:?}", patience.connect))
        }
        error => failed(address, error),
    })?;
    // The two handles are one socket: from here on silence has its own measure.
    other.set_read_timeout(Some(patience.silence)).map_err(fail)?;
    let known =
        reader.streams().iter().find(|stream| !matches!(stream.kind, PayloadKind::Other(_)));
    let spec = known.map(spec).ok_or_else(|| failed(address, "it serves no stream evrig knows"))?;
    Ok((reader, other, spec))
}

fn failed(address: &str, because: impl ToString) -> RecorderError {
    RecorderError {
        device: format!("davis at tcp://{address}"),
        because: because.to_string(),
        remedy: "start dv-runtime (or `evrig emulate davis`) there, or correct davis.transport",
    }
}

/// A reader must be movable to the thread that reads.
const _: fn() = || {
    fn is_send<T: Send + Read>() {}
    is_send::<TcpStream>();
};
