//! The guard's side: takes orders, owns the port, stops the arm before it goes.

use super::orders::{GuardOrder, GuardReport, HEARTBEAT_LIMIT, line, read_line};
use crate::dobot::frame::ArmFrame;
use crate::dobot::link::{ArmLink, Exchange, LinkError, SerialLink};
use crate::dobot::port;
use evrig_core::time::{HostMonotonic, Span, Stamp};
use evrig_record::{GuardEnd, host_clock};
use std::collections::VecDeque;
use std::io::{BufReader, Read, Write};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, TryRecvError, channel};
use std::time::Duration;

/// Serves orders from `input` until evrig is gone. `is_signalled` is set when someone wants
/// the guard itself to end: it then stops the arm, and stays for what evrig may ask.
pub fn serve(
    path: &Path,
    input: impl Read + Send + 'static,
    output: impl Write,
    is_signalled: &AtomicBool,
) -> GuardEnd {
    let mut output = output;
    let link = match port::open(path) {
        Ok(link) => link,
        Err(error) => {
            let text = error.to_string();
            // The report may be lost: the arm was not touched.
            let _ = output.write_all(&line(&GuardReport::Refused(text.clone())));
            return GuardEnd::NotBegun(text);
        }
    };
    let orders = listen(input);
    let last_heartbeat = host_clock::now();
    let mut guard = Guard {
        path,
        link,
        orders,
        waiting: VecDeque::new(),
        output,
        is_signalled,
        last_heartbeat,
        is_stopped: false,
        is_stop_pending: false,
        is_halted: false,
        is_halt_unreported: false,
    };
    let ended = guard.run();
    guard.stop_and_report();
    guard.retry_stop_until_limit();
    ended
}

/// How long a guard without a host goes on trying to reach an arm whose port is gone: a pulled
/// cable is plugged in again within seconds, and the arm runs its queue on meanwhile.
const UNREACHABLE_LIMIT: Span = Span::from_micros(10_000_000);

/// Reads orders in a thread, so that an exchange under way does not delay a stop.
fn listen(input: impl Read + Send + 'static) -> Receiver<GuardOrder> {
    let (send, orders) = channel();
    let reader = move || {
        let mut input = BufReader::new(input);
        while let Some(order) = read_line(&mut input) {
            if send.send(order).is_err() {
                return;
            }
        }
    };
    // Without a thread the channel closes at once, and the guard ends as it does without a host.
    let _ = std::thread::Builder::new().name("orders".to_owned()).spawn(reader);
    orders
}

struct Guard<'a, W: Write> {
    path: &'a Path,
    link: SerialLink,
    orders: Receiver<GuardOrder>,
    /// Orders received during an exchange.
    waiting: VecDeque<GuardOrder>,
    output: W,
    is_signalled: &'a AtomicBool,
    /// When evrig last sent something.
    last_heartbeat: Stamp<HostMonotonic>,
    is_stopped: bool,
    /// Whether a stop failed and has to be repeated.
    is_stop_pending: bool,
    /// Set by a halt: nothing moves the arm any more.
    is_halted: bool,
    /// Whether the next request has to report the halt.
    is_halt_unreported: bool,
}

impl<W: Write> Guard<'_, W> {
    fn run(&mut self) -> GuardEnd {
        /// How late a missing heartbeat or a signal is noticed at most.
        const POLL_INTERVAL: Duration = Duration::from_millis(20);
        if !self.report(&GuardReport::Open) {
            return GuardEnd::HostGone;
        }
        loop {
            let order = match self.waiting.pop_front() {
                Some(order) => Ok(order),
                None => self.orders.recv_timeout(POLL_INTERVAL),
            };
            let is_heard = match order {
                Ok(order) => {
                    self.last_heartbeat = host_clock::now();
                    self.execute(order)
                }
                Err(RecvTimeoutError::Timeout) => {
                    self.retry_stop();
                    true
                }
                Err(RecvTimeoutError::Disconnected) => return GuardEnd::HostGone,
            };
            if !is_heard {
                return GuardEnd::HostGone;
            }
            if self.is_signalled.swap(false, Ordering::Relaxed) && !self.halt() {
                return GuardEnd::HostGone;
            }
            if is_late(self.last_heartbeat) {
                return GuardEnd::HeartbeatLate;
            }
        }
    }

    /// Does what is ordered; false when evrig no longer listens or is done.
    fn execute(&mut self, order: GuardOrder) -> bool {
        match order {
            GuardOrder::Heartbeat => true,
            GuardOrder::End => false,
            GuardOrder::Stop => self.stop_and_report(),
            GuardOrder::Halt => self.halt(),
            // Reads go on behind a halt, but the first one reports it: it may be from
            // someone who waits for a motion that will never end.
            GuardOrder::Exchange { number, request, .. }
                if self.is_halt_unreported || self.is_halted && request.ctrl().is_write() =>
            {
                self.is_halt_unreported = false;
                self.report(&GuardReport::Answer { number, answer: Err(LinkError::Stopped) })
            }
            GuardOrder::Exchange { number, request, patience } => {
                self.is_stopped = false;
                let answer = self.exchange(&request, patience);
                self.report(&GuardReport::Answer { number, answer })
            }
        }
    }

    /// Asks the arm; a stop, a signal, a closed pipe or a late heartbeat ends the waiting.
    fn exchange(&mut self, request: &ArmFrame, patience: Span) -> Result<Exchange, LinkError> {
        let Self { link, orders, waiting, is_signalled, last_heartbeat, .. } = self;
        link.exchange_unless(request, patience, || {
            loop {
                match orders.try_recv() {
                    Ok(order) => {
                        *last_heartbeat = host_clock::now();
                        waiting.push_back(order);
                    }
                    Err(TryRecvError::Empty) => break,
                    Err(TryRecvError::Disconnected) => return true,
                }
            }
            waiting
                .iter()
                .any(|order| matches!(order, GuardOrder::Stop | GuardOrder::Halt | GuardOrder::End))
                || is_signalled.load(Ordering::Relaxed)
                || is_late(*last_heartbeat)
        })
    }

    /// Stops the arm for good; false when evrig no longer listens.
    fn halt(&mut self) -> bool {
        self.is_halted = true;
        self.is_halt_unreported = true;
        self.stop_and_report()
    }

    /// Stops the arm; false when evrig no longer listens.
    fn stop_and_report(&mut self) -> bool {
        let stopped = self.link.stop();
        self.is_stopped = true;
        self.is_stop_pending = stopped.is_err();
        self.report(&GuardReport::Stopped(stopped))
    }

    /// Repeats a stop command that failed, over the port as it is now.
    fn retry_stop(&mut self) {
        if self.is_stop_pending
            && let Ok(link) = port::open(self.path)
        {
            self.link = link;
            self.is_stop_pending = self.link.stop().is_err();
        }
    }

    fn retry_stop_until_limit(&mut self) {
        let started = host_clock::now();
        while self.is_stop_pending && host_clock::now() - started < UNREACHABLE_LIMIT {
            std::thread::sleep(Duration::from_millis(50));
            self.retry_stop();
        }
    }

    fn report(&mut self, report: &GuardReport) -> bool {
        self.output.write_all(&line(report)).and_then(|()| self.output.flush()).is_ok()
    }
}

impl<W: Write> Drop for Guard<'_, W> {
    fn drop(&mut self) {
        // Only a panic of the guard itself comes here with the arm not stopped.
        if !self.is_stopped {
            let _ = self.link.write_stop();
        }
    }
}

fn is_late(last_heartbeat: Stamp<HostMonotonic>) -> bool {
    host_clock::now() - last_heartbeat > HEARTBEAT_LIMIT
}
