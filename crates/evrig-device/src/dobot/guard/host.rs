//! Evrig's side of the guard: starting it, speaking through it, stopping the arm from anywhere.

use super::orders::{
    END_LINE, GuardOrder, GuardReport, HALT_LINE, HEARTBEAT, HEARTBEAT_LINE, STOP_LINE, line,
    read_line,
};
use crate::dobot::frame::ArmFrame;
use crate::dobot::link::{ArmLink, Exchange, LinkError, STOP_PATIENCE};
use crate::dobot::port;
use evrig_core::time::Span;
use evrig_record::EmergencyStop;
use rustix::fd::OwnedFd;
use std::fs::File;
use std::io::{BufReader, Write};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::time::Duration;

/// Time the guard gets on top of what the arm gets: to be scheduled, and to end a stop that it is
/// about to confirm. A guard that takes longer is replaced.
const GRACE: Span = Span::from_micros(2_000_000);

/// Stops the arm by one write into the pipe of its guard.
#[derive(Debug, Clone)]
pub struct GuardStop {
    orders: Arc<File>,
}

impl EmergencyStop for GuardStop {
    /// Commands the guard to stop the arm and to forward no further motion. The next request of any
    /// thread fails with [`LinkError::Stopped`], later reads are answered as before.
    fn halt(&self) -> std::io::Result<()> {
        (&*self.orders).write_all(HALT_LINE)
    }
}

impl GuardStop {
    /// Makes every panic of any thread stop the arm before anything else.
    pub fn halt_on_panic(self) {
        let before = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |panic| {
            // A guard that is gone has stopped the arm already.
            let _ = self.halt();
            before(panic);
        }));
    }
}

/// The arm's port behind its guard.
#[derive(Debug)]
pub struct GuardLink {
    port: PathBuf,
    child: Child,
    orders: Option<Arc<File>>,
    reports: Receiver<GuardReport>,
    /// Dropped to end the heartbeat.
    heart: Option<(Sender<()>, std::thread::JoinHandle<()>)>,
    number: u64,
}

impl GuardLink {
    /// Starts `program guard PORT` and waits until it has the port.
    ///
    /// # Errors
    /// When it cannot be started, or cannot open the port.
    pub fn start(program: &Path, port: &Path) -> Result<Self, LinkError> {
        let mut child = Command::new(program)
            .arg("guard")
            .arg(port)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            // Ctrl-C goes to the group of the terminal: it must reach evrig and not the guard.
            .process_group(0)
            .spawn()
            .map_err(|error| failed(format!("cannot start {}: {error}", program.display())))?;
        let (Some(input), Some(output)) = (child.stdin.take(), child.stdout.take()) else {
            return Err(failed("it has no pipes"));
        };
        let orders = Arc::new(File::from(OwnedFd::from(input)));
        let (send, reports) = channel();
        spawn("guard reports", move || {
            let mut output = BufReader::new(output);
            while let Some(report) = read_line(&mut output) {
                if send.send(report).is_err() {
                    return;
                }
            }
        })?;
        let heart = Some(start_heart(Arc::clone(&orders))?);
        let mut link =
            Self { port: port.to_owned(), child, orders: Some(orders), reports, heart, number: 0 };
        match link.next_report(GRACE + GRACE + GRACE)? {
            GuardReport::Open => Ok(link),
            GuardReport::Refused(because) => Err(LinkError::Gone { because }),
            other => Err(failed(format!("it began with {other:?}"))),
        }
    }

    /// What stops the arm from other threads.
    #[must_use]
    pub fn stopper(&self) -> Option<GuardStop> {
        self.orders.clone().map(|orders| GuardStop { orders })
    }

    /// Process id of the guard.
    #[must_use]
    pub fn id(&self) -> u32 {
        self.child.id()
    }

    fn order(&mut self, bytes: &[u8]) -> Result<(), LinkError> {
        let written = self.orders.as_deref().map(|mut orders| orders.write_all(bytes));
        match written {
            Some(Ok(())) => Ok(()),
            Some(Err(error)) => Err(self.without_guard(&error.to_string())),
            None => Err(failed("it was dismissed")),
        }
    }

    fn next_report(&mut self, patience: Span) -> Result<GuardReport, LinkError> {
        match self.reports.recv_timeout(duration(patience)) {
            Ok(report) => Ok(report),
            Err(RecvTimeoutError::Timeout) => {
                // It hangs, so it will not stop the arm: the port must be taken from it. That it
                // is already gone is as good.
                let _ = self.child.kill();
                let _ = self.child.wait();
                Err(self.without_guard(&format!("it was silent for {patience}")))
            }
            Err(RecvTimeoutError::Disconnected) => Err(self.without_guard("it ended")),
        }
    }

    /// The guard died before evrig, which then stops the arm itself.
    fn without_guard(&self, because: &str) -> LinkError {
        let stopped = match port::open(&self.port) {
            Ok(mut link) => link.stop().map_err(|error| error.to_string()),
            Err(error) => Err(error.to_string()),
        };
        match stopped {
            Ok(()) => failed(format!("{because}; the arm was stopped without it")),
            Err(error) => failed(format!(
                "{because}, and the arm could not be stopped without it ({error}): \
                 press the arm's stop button"
            )),
        }
    }
}

impl ArmLink for GuardLink {
    fn exchange(&mut self, request: &ArmFrame, patience: Span) -> Result<Exchange, LinkError> {
        self.number += 1;
        let asked = self.number;
        let order = GuardOrder::Exchange { number: asked, request: request.clone(), patience };
        self.order(&line(&order))?;
        loop {
            // Answers to orders given up earlier and stops ordered by others pass by.
            if let GuardReport::Answer { number, answer } = self.next_report(patience + GRACE)?
                && number == asked
            {
                return answer;
            }
        }
    }

    fn stop(&mut self) -> Result<(), LinkError> {
        self.order(STOP_LINE)?;
        loop {
            // Force stop and clear are each asked twice at most.
            let patience = Span::from_nanos(STOP_PATIENCE.as_nanos() * 4) + GRACE;
            if let GuardReport::Stopped(stopped) = self.next_report(patience)? {
                return stopped;
            }
        }
    }
}

impl Drop for GuardLink {
    fn drop(&mut self) {
        if let Some((beat, thread)) = self.heart.take() {
            drop(beat);
            // A heartbeat that panicked has nothing left to say.
            let _ = thread.join();
        }
        // A `GuardStop` may still hold the pipe open, so the guard gets an order; one that is gone
        // needs none.
        if let Some(orders) = self.orders.take() {
            let _ = (&*orders).write_all(END_LINE);
        }
        while self.reports.recv_timeout(duration(GRACE + GRACE)).is_ok() {}
        if !matches!(self.child.try_wait(), Ok(Some(_))) {
            let reports_closed = matches!(
                self.reports.recv_timeout(duration(GRACE)),
                Err(RecvTimeoutError::Disconnected)
            );
            if reports_closed {
                // It has closed its pipe, so it is about to end: reap it.
                let _ = self.child.wait();
            }
        }
    }
}

fn start_heart(orders: Arc<File>) -> Result<(Sender<()>, std::thread::JoinHandle<()>), LinkError> {
    let (beat, ended) = channel::<()>();
    let thread = spawn("guard heartbeat", move || {
        while ended.recv_timeout(duration(HEARTBEAT)) == Err(RecvTimeoutError::Timeout) {
            if (&*orders).write_all(HEARTBEAT_LINE).is_err() {
                return;
            }
        }
    })?;
    Ok((beat, thread))
}

fn spawn(
    name: &str,
    body: impl FnOnce() + Send + 'static,
) -> Result<std::thread::JoinHandle<()>, LinkError> {
    let builder = std::thread::Builder::new().name(name.to_owned());
    builder.spawn(body).map_err(|error| failed(format!("no thread for it: {error}")))
}

fn failed(because: impl Into<String>) -> LinkError {
    LinkError::Guard { because: because.into() }
}

fn duration(span: Span) -> Duration {
    Duration::from_nanos(span.as_nanos().max(0).unsigned_abs())
}
