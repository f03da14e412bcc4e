//! The messages between evrig and the guard: one JSON value a line.

use crate::dobot::frame::ArmFrame;
use crate::dobot::link::{Exchange, LinkError};
use evrig_core::time::Span;
use serde::{Deserialize, Serialize};
use std::io::{BufRead, Read};

/// How often evrig shows that it lives.
pub const HEARTBEAT: Span = Span::from_micros(100_000);

/// A guard that received nothing for so long stops the arm: ten heartbeats, more than a busy
/// machine delays a thread that only writes a line. A host that dies is noticed at once.
pub const HEARTBEAT_LIMIT: Span = Span::from_micros(1_000_000);

/// From evrig to the guard. Each is one write of fewer bytes than a pipe takes in one piece,
/// so several threads may write without a lock.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) enum GuardOrder {
    /// Ask the arm.
    Exchange {
        /// Comes back with the answer.
        number: u64,
        /// The request.
        request: ArmFrame,
        /// How long to wait.
        patience: Span,
    },
    /// Evrig lives.
    Heartbeat,
    /// Stop the arm now; more may be asked of it later.
    Stop,
    /// Stop the arm now and let nothing move it any more.
    Halt,
    /// Evrig is done with the arm: stop it and end.
    End,
}

/// [`GuardOrder::Stop`] ready to be written: nothing is computed or allocated when it counts.
pub(super) const STOP_LINE: &[u8] = b"\"Stop\"\n";
/// [`GuardOrder::Halt`] ready to be written.
pub(super) const HALT_LINE: &[u8] = b"\"Halt\"\n";
/// [`GuardOrder::End`] ready to be written.
pub(super) const END_LINE: &[u8] = b"\"End\"\n";
/// [`GuardOrder::Heartbeat`] ready to be written.
pub(super) const HEARTBEAT_LINE: &[u8] = b"\"Heartbeat\"\n";

/// From the guard to evrig.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) enum GuardReport {
    /// The port is open; orders are taken.
    Open,
    /// The port cannot be opened; the guard exits.
    Refused(String),
    /// The answer to an exchange.
    Answer {
        /// Of the order.
        number: u64,
        /// What came of it.
        answer: Result<Exchange, LinkError>,
    },
    /// The stop command was sent to the arm, with the result.
    Stopped(Result<(), LinkError>),
}

/// The longest line either side takes; the longest it writes is below 8 KiB.
const MAX_LINE: u64 = 1 << 16;

/// The next line as a value; `None` at the end of the pipe, and on a line that is no value,
/// which only a different program would write.
pub(super) fn read_line<T: for<'de> Deserialize<'de>>(input: &mut impl BufRead) -> Option<T> {
    let mut line = Vec::new();
    match input.by_ref().take(MAX_LINE).read_until(b'\n', &mut line) {
        Ok(n) if n > 0 => serde_json::from_slice(&line).ok(),
        _ => None,
    }
}

/// A value as one line.
pub(super) fn line(value: &impl Serialize) -> Vec<u8> {
    // These types always have a JSON form; an empty line would be no value and end the pipe.
    let mut bytes = serde_json::to_vec(value).unwrap_or_default();
    bytes.push(b'\n');
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dobot::frame::{Ctrl, MAX_PARAMS};

    #[test]
    fn the_ready_made_lines_are_the_encoded_orders() {
        assert_eq!(line(&GuardOrder::Stop), STOP_LINE);
        assert_eq!(line(&GuardOrder::Halt), HALT_LINE);
        assert_eq!(line(&GuardOrder::End), END_LINE);
        assert_eq!(line(&GuardOrder::Heartbeat), HEARTBEAT_LINE);
    }

    #[test]
    fn the_longest_order_fits_into_one_piece_of_a_pipe() {
        const PIPE_BUF: usize = 4096;
        let request = ArmFrame::new(255, Ctrl(255), vec![255; MAX_PARAMS]).unwrap();
        let patience = Span::from_nanos(i64::MIN);
        let order = GuardOrder::Exchange { number: u64::MAX, request, patience };
        let bytes = line(&order);
        assert!(bytes.len() < PIPE_BUF, "{} bytes", bytes.len());
        assert_eq!(read_line(&mut &bytes[..]), Some(order));
    }

    #[test]
    fn a_frame_that_no_wire_carries_is_refused() {
        let text = format!(
            "{{\"Exchange\":{{\"number\":1,\"request\":[1,0,{:?}],\"patience\":1}}}}",
            vec![0; 249]
        );
        assert_eq!(read_line::<GuardOrder>(&mut text.as_bytes()), None);
    }
}
