//! The guard's side: takes orders, owns the port, stops the arm before it goes.

use super::orders::{HEARTBEAT_LIMIT, Order, Report, line, read_line};
use crate::dobot::frame::Frame;
use crate::dobot::link::{Exchange, Link, LinkError, SerialLink};
use crate::dobot::port;
use evrig_core::time::{HostMonotonic, Span, Stamp};
use evrig_record::host_clock;
use std::collections::VecDeque;
use std::io::{BufReader, Read, Write};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, TryRecvError, channel};
use std::time::Duration;

/// Why the guard's work ended. The arm was told to stop in every case but the first.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Ended {
    /// The port could not be opened.
    NotBegun(String),
    /// Evrig closed the pipe or died.
    HostGone,
    /// Evrig hangs or was suspended.
    HeartbeatLate,
}

/// Serves orders from `input` until evrig is gone. `is_signalled` is set when someone wants
/// the guard itself to end: it then stops the arm, and stays for what evrig may ask.
pub fn serve(
    path: &Path,
    input: impl Read + Send + 'static,
    output: impl Write,
    is_signalled: &AtomicBool,
) -> Ended {
    let mut output = output;
    let link = match port::open(path) {
        Ok(link) => link,
        Err(error) => {
            let text = error.to_string();
            // Whether it is heard makes no difference: the arm was not touched.
            let _ = output.write_all(&line(&Report::Refused(text.clone())));
            return Ended::NotBegun(text);
        }
    };
    let orders = listen(input);
    let heard = host_clock::now();
    let mut guard = Guard {
        path,
        link,
        orders,
        waiting: VecDeque::new(),
        output,
        is_signalled,
        heard,
        is_stopped: false,
        owes_stop: false,
        is_halted: false,
        is_halt_untold: false,
    };
    let ended = guard.run();
    guard.stop_and_report();
    guard.pay_before_going();
    ended
}

/// How long a guard without a host goes on trying to reach an arm whose port is gone: a pulled
/// cable is plugged in again within seconds, and the arm runs its queue on meanwhile.
const UNPAID: Span = Span::from_micros(10_000_000);

/// Reads orders in a thread, so that waiting for one never keeps another from being heard.
fn listen(input: impl Read + Send + 'static) -> Receiver<Order> {
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
    orders: Receiver<Order>,
    /// Orders heard during an exchange.
    waiting: VecDeque<Order>,
    output: W,
    is_signalled: &'a AtomicBool,
    /// When evrig was last heard.
    heard: Stamp<HostMonotonic>,
    is_stopped: bool,
    /// Whether a stop did not get through and is still to be said.
    owes_stop: bool,
    /// Set by a halt: nothing moves the arm any more.
    is_halted: bool,
    /// Whether whoever waits for the arm still has to learn of the halt.
    is_halt_untold: bool,
}

impl<W: Write> Guard<'_, W> {
    fn run(&mut self) -> Ended {
        /// How late a missing heartbeat or a signal is noticed at most.
        const TICK: Duration = Duration::from_millis(20);
        if !self.report(&Report::Open) {
            return Ended::HostGone;
        }
        loop {
            let order = match self.waiting.pop_front() {
                Some(order) => Ok(order),
                None => self.orders.recv_timeout(TICK),
            };
            let is_heard = match order {
                Ok(order) => {
                    self.heard = host_clock::now();
                    self.obey(order)
                }
                Err(RecvTimeoutError::Timeout) => {
                    self.pay();
                    true
                }
                Err(RecvTimeoutError::Disconnected) => return Ended::HostGone,
            };
            if !is_heard {
                return Ended::HostGone;
            }
            if self.is_signalled.swap(false, Ordering::Relaxed) && !self.halt() {
                return Ended::HostGone;
            }
            if is_late(self.heard) {
                return Ended::HeartbeatLate;
            }
        }
    }

    /// Does what is ordered; false when evrig no longer listens.
    fn obey(&mut self, order: Order) -> bool {
        match order {
            Order::Heartbeat => true,
            Order::Stop => self.stop_and_report(),
            Order::Halt => self.halt(),
            // Reads go on behind a halt, but the first one tells of it: it may be the look of
            // someone who waits for a motion that will never end.
            Order::Exchange { number, request, .. }
                if self.is_halt_untold || self.is_halted && request.ctrl().is_write() =>
            {
                self.is_halt_untold = false;
                self.report(&Report::Answer { number, answer: Err(LinkError::Stopped) })
            }
            Order::Exchange { number, request, patience } => {
                self.is_stopped = false;
                let answer = self.exchange(&request, patience);
                self.report(&Report::Answer { number, answer })
            }
        }
    }

    /// Asks the arm; a stop, a signal, a closed pipe or a late heartbeat ends the waiting.
    fn exchange(&mut self, request: &Frame, patience: Span) -> Result<Exchange, LinkError> {
        let Self { link, orders, waiting, is_signalled, heard, .. } = self;
        link.exchange_unless(request, patience, || {
            loop {
                match orders.try_recv() {
                    Ok(order) => {
                        *heard = host_clock::now();
                        waiting.push_back(order);
                    }
                    Err(TryRecvError::Empty) => break,
                    Err(TryRecvError::Disconnected) => return true,
                }
            }
            waiting.iter().any(|order| matches!(order, Order::Stop | Order::Halt))
                || is_signalled.load(Ordering::Relaxed)
                || is_late(*heard)
        })
    }

    /// Stops the arm for good; false when evrig no longer listens.
    fn halt(&mut self) -> bool {
        self.is_halted = true;
        self.is_halt_untold = true;
        self.stop_and_report()
    }

    /// Stops the arm; false when evrig no longer listens.
    fn stop_and_report(&mut self) -> bool {
        let stopped = self.link.stop();
        self.is_stopped = true;
        self.owes_stop = stopped.is_err();
        self.report(&Report::Stopped(stopped))
    }

    /// Says a stop that did not get through, over the port as it is now.
    fn pay(&mut self) {
        if self.owes_stop
            && let Ok(link) = port::open(self.path)
        {
            self.link = link;
            self.owes_stop = self.link.stop().is_err();
        }
    }

    fn pay_before_going(&mut self) {
        let started = host_clock::now();
        while self.owes_stop && host_clock::now() - started < UNPAID {
            std::thread::sleep(Duration::from_millis(50));
            self.pay();
        }
    }

    fn report(&mut self, report: &Report) -> bool {
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

fn is_late(heard: Stamp<HostMonotonic>) -> bool {
    host_clock::now() - heard > HEARTBEAT_LIMIT
}
