//! The client: what evrig asks of the arm, one request at a time, every wait with an end.

use super::alarm::Alarms;
use super::command::{ArmCommand, read};
use super::fields::Malformed;
use super::frame::{ArmFrame, Ctrl};
use super::link::{ArmLink, Exchange, LinkError};
use super::{id, reply};
use evrig_core::time::Span;
use evrig_record::PoseReading;
use evrig_record::host_clock;
use evrig_session::rig::{Joints, Pose};
use serde::Serialize;

/// Why the arm did not do what was asked.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ArmClientError {
    /// No answer, or no device.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// An answer that does not fit the question.
    #[error("the arm's answer makes no sense: {0}; is this a Magician?")]
    Malformed(#[from] Malformed),
    /// Alarms are set.
    #[error("the arm has stopped with {alarms}")]
    Alarmed {
        /// Which.
        alarms: Alarms,
    },
    /// The arm does not know where its base is.
    #[error("the arm was switched on and not homed since; clear the table and home it")]
    NotHomed,
    /// The queue refused a command although it had a free place, or never had one.
    #[error("the arm's queue did not take `{command}` ({because})")]
    Rejected {
        /// Which.
        command: &'static str,
        /// The reason.
        because: &'static str,
    },
    /// Whether a command was queued is unknown; the arm was stopped.
    #[error(
        "replies to `{command}` and to what was sent to find it again were lost; whether it was \
         queued is unknown, so the arm was stopped: check the cable"
    )]
    Uncertain {
        /// Which.
        command: &'static str,
    },
    /// A command did not end in time.
    #[error(
        "command {index} of the queue did not end within {waited} (the arm is at command \
         {current}); check whether the arm is blocked"
    )]
    Late {
        /// Which.
        index: u64,
        /// The last that ended.
        current: u64,
        /// How long was waited.
        waited: Span,
    },
    /// A parameter reads back as something else.
    #[error("{what} was set to {set:?}, the arm reads back {found:?}; its firmware limits it")]
    ReadBack {
        /// Which.
        what: &'static str,
        /// What was set.
        set: String,
        /// What came back.
        found: String,
    },
}

/// Who the arm is.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Identity {
    /// Its name.
    pub name: String,
    /// Its serial number; empty when the firmware returns none.
    pub serial: String,
    /// Its firmware.
    pub firmware: String,
}

/// How long things may take.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ArmTimeouts {
    /// A reply.
    pub reply: Span,
    /// Reads and settings that change nothing when repeated: how often they are tried.
    pub n_tries: u32,
    /// Between two polls of a command's end.
    pub between_polls: Span,
}

impl Default for ArmTimeouts {
    fn default() -> Self {
        Self {
            reply: Span::from_micros(400_000),
            n_tries: 3,
            between_polls: Span::from_micros(20_000),
        }
    }
}

/// The arm's request-reply protocol over a link.
pub struct ArmClient {
    pub(super) link: Box<dyn ArmLink>,
    pub(super) patience: ArmTimeouts,
    /// Free places in the queue, as far as is known.
    pub(super) space: u64,
    /// The most free places ever seen.
    pub(super) depth: u64,
    /// Index of the command queued last.
    pub(super) last_index: Option<u64>,
    /// Whether clearing alarms clears the power-up bit, which is then meaningful.
    is_reset_telling: bool,
}

impl ArmClient {
    /// Speaks over a link.
    #[must_use]
    pub fn new(link: Box<dyn ArmLink>, patience: ArmTimeouts) -> Self {
        Self { link, patience, space: 0, depth: 0, last_index: None, is_reset_telling: true }
    }

    /// How long things may take.
    #[must_use]
    pub const fn patience(&self) -> ArmTimeouts {
        self.patience
    }

    /// Asks what may be asked twice.
    pub(super) fn ask(&mut self, request: &ArmFrame) -> Result<Exchange, ArmClientError> {
        let mut tries = 1;
        loop {
            match self.link.exchange(request, self.patience.reply) {
                Ok(exchange) => return Ok(exchange),
                Err(LinkError::Silent { .. }) if tries < self.patience.n_tries => tries += 1,
                Err(error) => return Err(error.into()),
            }
        }
    }

    pub(super) fn value(&mut self, id: u8) -> Result<ArmFrame, ArmClientError> {
        Ok(self.ask(&read(id))?.reply)
    }

    /// The `N` floats of a parameter.
    ///
    /// # Errors
    /// No answer, or a short one.
    pub fn floats<const N: usize>(&mut self, id: u8) -> Result<[f32; N], ArmClientError> {
        Ok(reply::floats(&self.value(id)?)?)
    }

    /// Does at once what may be done twice: settings, starting and stopping the queue.
    ///
    /// # Errors
    /// No answer.
    pub fn set(&mut self, command: &ArmCommand) -> Result<(), ArmClientError> {
        self.ask(&command.frame(Ctrl::WRITE)).map(|_| ())
    }

    /// Name, serial number, firmware.
    ///
    /// # Errors
    /// No answer to name or version. A firmware without a serial number is no error.
    pub fn identify(&mut self) -> Result<Identity, ArmClientError> {
        let firmware = reply::version(&self.value(id::DEVICE_VERSION)?)?.to_string();
        let name = reply::text(&self.value(id::DEVICE_NAME)?);
        let serial = match self.value(id::DEVICE_SERIAL) {
            Ok(reply) => reply::text(&reply),
            Err(ArmClientError::Link(LinkError::Silent { .. })) => String::new(),
            Err(error) => return Err(error),
        };
        Ok(Identity { name, serial, firmware })
    }

    /// Where the planner is.
    ///
    /// # Errors
    /// No answer, or a short one.
    pub fn pose(&mut self) -> Result<PoseReading, ArmClientError> {
        let exchange = self.ask(&read(id::POSE))?;
        let values = reply::pose(&exchange.reply)?;
        Ok(PoseReading {
            pose: Pose::from_mm_deg(values.xyzr.map(f64::from)),
            joints: Joints::from_deg(values.joints.map(f64::from)),
            asked: exchange.sent,
            answered: exchange.received,
        })
    }

    /// The alarms that are set.
    ///
    /// # Errors
    /// No answer, or a short one.
    pub fn alarms(&mut self) -> Result<Alarms, ArmClientError> {
        Ok(reply::alarms(&self.value(id::ALARMS)?)?)
    }

    /// Clears the alarms and reads those left; some firmwares do not answer the clearing.
    ///
    /// # Errors
    /// No answer to the second question, or alarms that came back.
    pub fn clear_alarms(&mut self) -> Result<(), ArmClientError> {
        let clear = ArmCommand::ClearAlarms.frame(Ctrl::WRITE);
        match self.link.exchange(&clear, self.patience.reply) {
            Ok(_) | Err(LinkError::Silent { .. }) => {}
            Err(error) => return Err(error.into()),
        }
        let alarms = self.alarms()?;
        self.is_reset_telling = !alarms.is_fresh_from_power_up();
        self.refuse(alarms)
    }

    /// Looks for anything that keeps the arm from moving well.
    ///
    /// # Errors
    /// No answer, alarms that are set, or an arm that was switched on and not homed since.
    pub fn refuse_alarms(&mut self) -> Result<(), ArmClientError> {
        let alarms = self.alarms()?;
        self.refuse(alarms)
    }

    fn refuse(&self, alarms: Alarms) -> Result<(), ArmClientError> {
        if alarms.has_fault() {
            Err(ArmClientError::Alarmed { alarms })
        } else if alarms.is_fresh_from_power_up() && self.is_reset_telling {
            Err(ArmClientError::NotHomed)
        } else {
            Ok(())
        }
    }

    /// Force stop and an empty queue, in any state.
    ///
    /// # Errors
    /// When the arm did not confirm.
    pub fn stop(&mut self) -> Result<(), ArmClientError> {
        self.space = 0;
        self.last_index = None;
        Ok(self.link.stop()?)
    }

    /// Index of the command that ended last.
    ///
    /// # Errors
    /// No answer, or a short one.
    pub fn finished_index(&mut self) -> Result<u64, ArmClientError> {
        Ok(reply::index(&self.value(id::QUEUE_INDEX)?)?)
    }

    /// Waits until the command `index` has ended, asking for the pose at every poll and
    /// handing it to `seen`.
    ///
    /// # Errors
    /// Alarms, silence, or `deadline` passed.
    pub fn wait_for(
        &mut self,
        index: u64,
        deadline: Span,
        seen: &mut dyn FnMut(&PoseReading),
    ) -> Result<(), ArmClientError> {
        let started = host_clock::now();
        loop {
            seen(&self.pose()?);
            let current = self.finished_index()?;
            if has_reached(current, index) {
                return Ok(());
            }
            self.refuse_alarms()?;
            let waited = host_clock::now() - started;
            if waited >= deadline {
                return Err(ArmClientError::Late { index, current, waited });
            }
            self.pause();
        }
    }

    /// Sleeps until the next poll.
    pub(super) fn pause(&self) {
        let nanos = self.patience.between_polls.as_nanos().max(0).unsigned_abs();
        std::thread::sleep(std::time::Duration::from_nanos(nanos));
    }

    /// Homing; ends at `home`. The arm sweeps its base: everything must be out of its way.
    ///
    /// # Errors
    /// Alarms, silence, or `deadline` passed.
    pub fn home(&mut self, home: Pose, deadline: Span) -> Result<(), ArmClientError> {
        self.begin()?;
        self.set(&ArmCommand::HomeParams(home.to_mm_deg().map(|value| value as f32)))?;
        let index = self.enqueue(&ArmCommand::Home, deadline)?;
        self.wait_for(index, deadline, &mut |_| ())
    }
}

/// Whether the command `index` has ended when `current` is the last that did. The counter may
/// wrap and reads as -1 before the first command on some firmwares.
pub(super) fn has_reached(current: u64, index: u64) -> bool {
    current.wrapping_sub(index) < 1 << 63
}

impl std::fmt::Debug for ArmClient {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "ArmClient with queue index {:?} and {} places", self.last_index, self.space)
    }
}
