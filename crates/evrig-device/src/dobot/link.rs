//! One request, one reply: the way to the arm, direct or through the guard.

use super::command::{ArmCommand, CLEAR_QUEUE_BYTES, FORCE_STOP_BYTES};
use super::frame::{ArmFrame, ArmFrameDecoder, Ctrl};
use evrig_core::time::{HostMonotonic, Span, Stamp};
use evrig_record::host_clock;
use serde::{Deserialize, Serialize};
use serialport::SerialPort;
use std::io::{ErrorKind, Read, Write};
use std::time::Duration;

/// A request and its reply, with the times between which the arm took it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Exchange {
    /// What the arm answered.
    pub reply: ArmFrame,
    /// Before the request was written.
    pub sent: Stamp<HostMonotonic>,
    /// After the reply was complete.
    pub received: Stamp<HostMonotonic>,
    /// Frames that came meanwhile and answer something else: replies given up on earlier.
    pub stale: Vec<ArmFrame>,
}

/// Why a request has no reply.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, thiserror::Error)]
pub enum LinkError {
    /// Nothing that answers it came in time.
    #[error(
        "the arm did not answer `{request}` within {waited} ({} bytes came that were no answer); \
         {}",
        n_noise, silence_remedy(*n_noise)
    )]
    Silent {
        /// What was asked.
        request: String,
        /// For how long.
        waited: Span,
        /// Bytes that belong to no frame, or to frames that answer something else.
        n_noise: u64,
    },
    /// The device is gone.
    #[error(
        "the port of the arm is gone ({because}); is the cable plugged in and the arm switched on?"
    )]
    Gone {
        /// The system's reason.
        because: String,
    },
    /// A stop came in between.
    #[error("the arm was stopped while it was being asked")]
    Stopped,
    /// The guard cannot go on.
    #[error("the process that guards the arm failed: {because}")]
    Guard {
        /// Its text.
        because: String,
    },
}

/// What to do about an arm that does not answer.
fn silence_remedy(n_noise: u64) -> &'static str {
    if n_noise == 0 {
        "check that it is switched on, that no other program uses it and that this is its port"
    } else {
        "something else may be at this port; if it is the arm, press its reset button"
    }
}

impl LinkError {
    /// Silence after a request, named.
    #[must_use]
    pub fn silent(request: &ArmFrame, waited: Span, n_noise: u64) -> Self {
        let name = super::id::name(request.id()).unwrap_or("UNKNOWN");
        Self::Silent { request: format!("{name} ({})", request.id()), waited, n_noise }
    }
}

/// The way to the arm. One request is under way at a time.
pub trait ArmLink: Send {
    /// Sends a request and waits for its reply, `patience` at most.
    ///
    /// # Errors
    /// Silence, a device that is gone, a stop that came in between.
    fn exchange(&mut self, request: &ArmFrame, patience: Span) -> Result<Exchange, LinkError>;

    /// Force stop, then an empty queue. Can be called in any state, as often as one likes.
    ///
    /// # Errors
    /// When the arm did not confirm; the command was sent nevertheless, unless the device is gone.
    fn stop(&mut self) -> Result<(), LinkError>;
}

/// How long the arm gets to confirm a stop.
pub const STOP_PATIENCE: Span = Span::from_micros(400_000);

/// A serial port opened in this process.
pub struct SerialLink {
    port: Box<dyn SerialPort>,
    decoder: ArmFrameDecoder,
}

/// The longest wait between two polls of the break-off condition: short against a round trip
/// that takes some 4 ms.
const SLICE: Duration = Duration::from_millis(2);

impl SerialLink {
    /// Speaks over an open port.
    ///
    /// # Errors
    /// When the port takes no time-out, so that a read could hang.
    pub fn new(mut port: Box<dyn SerialPort>) -> Result<Self, LinkError> {
        port.set_timeout(SLICE).map_err(|error| LinkError::Gone { because: error.to_string() })?;
        Ok(Self { port, decoder: ArmFrameDecoder::default() })
    }

    /// Like [`ArmLink::exchange`], but ends with [`LinkError::Stopped`] as soon as `is_stopped`
    /// returns true, which is polled every two milliseconds.
    ///
    /// # Errors
    /// As [`ArmLink::exchange`].
    pub fn exchange_unless(
        &mut self,
        request: &ArmFrame,
        patience: Span,
        mut is_stopped: impl FnMut() -> bool,
    ) -> Result<Exchange, LinkError> {
        let mut stale = self.drain()?;
        let mut n_noise = self.decoder.n_skipped();
        let sent = host_clock::now();
        self.write(&request.to_bytes())?;
        loop {
            let mut reply = None;
            self.read(|frame| {
                if reply.is_none() && request.is_answered_by(&frame) {
                    reply = Some(frame);
                } else {
                    stale.push(frame);
                }
            })?;
            let received = host_clock::now();
            if let Some(reply) = reply {
                return Ok(Exchange { reply, sent, received, stale });
            }
            if received - sent >= patience {
                self.decoder.give_up(|frame| stale.push(frame));
                n_noise = self.decoder.n_skipped() - n_noise;
                let in_frames: usize = stale.iter().map(|frame| frame.to_bytes().len()).sum();
                return Err(LinkError::silent(request, patience, n_noise + in_frames as u64));
            }
            if is_stopped() {
                return Err(LinkError::Stopped);
            }
        }
    }

    /// Takes in what arrived unasked: late replies and noise.
    fn drain(&mut self) -> Result<Vec<ArmFrame>, LinkError> {
        /// More than a port buffers; a device that talks without end is not waited for.
        const N_READS: usize = 16;
        let mut stale = Vec::new();
        for _ in 0..N_READS {
            if !self.port.bytes_to_read().is_ok_and(|n| n > 0) {
                break;
            }
            self.read(|frame| stale.push(frame))?;
        }
        // Half a frame from before belongs to nothing that is to come.
        self.decoder.give_up(|frame| stale.push(frame));
        Ok(stale)
    }

    /// Writes force stop and clear, without waiting for anything.
    ///
    /// # Errors
    /// When the device is gone.
    pub fn write_stop(&mut self) -> Result<(), LinkError> {
        self.write(&FORCE_STOP_BYTES)?;
        self.write(&CLEAR_QUEUE_BYTES)
    }

    fn write(&mut self, bytes: &[u8]) -> Result<(), LinkError> {
        /// A line at 115200 baud takes 250 bytes in 22 ms.
        const PATIENCE: Span = Span::from_micros(200_000);
        let started = host_clock::now();
        let mut rest = bytes;
        while !rest.is_empty() {
            match self.port.write(rest) {
                Ok(n) => rest = rest.get(n..).unwrap_or_default(),
                Err(error) if is_passing(&error) && host_clock::now() - started < PATIENCE => {}
                Err(error) => return Err(gone(&error)),
            }
        }
        Ok(())
    }

    /// Reads what comes within a slice.
    fn read(&mut self, found: impl FnMut(ArmFrame)) -> Result<(), LinkError> {
        let mut buffer = [0; 256];
        match self.port.read(&mut buffer) {
            Ok(0) => Err(LinkError::Gone { because: "end of file".to_owned() }),
            Ok(n) => {
                self.decoder.push(&buffer[..n], found);
                Ok(())
            }
            Err(error) if is_passing(&error) => Ok(()),
            Err(error) => Err(gone(&error)),
        }
    }
}

fn is_passing(error: &std::io::Error) -> bool {
    matches!(error.kind(), ErrorKind::TimedOut | ErrorKind::WouldBlock | ErrorKind::Interrupted)
}

fn gone(error: &std::io::Error) -> LinkError {
    LinkError::Gone { because: error.to_string() }
}

impl ArmLink for SerialLink {
    fn exchange(&mut self, request: &ArmFrame, patience: Span) -> Result<Exchange, LinkError> {
        self.exchange_unless(request, patience, || false)
    }

    fn stop(&mut self) -> Result<(), LinkError> {
        // Both receive the command before either is waited for; then each is asked again until it
        // confirms, which it may do twice. A lost stop is worse than a double one.
        self.write_stop()?;
        for command in [ArmCommand::ForceStop, ArmCommand::ClearQueue] {
            let request = command.frame(Ctrl::WRITE);
            if self.exchange(&request, STOP_PATIENCE).is_err() {
                self.exchange(&request, STOP_PATIENCE)?;
            }
        }
        Ok(())
    }
}

impl std::fmt::Debug for SerialLink {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "SerialLink at {}", self.port.name().unwrap_or_default())
    }
}
