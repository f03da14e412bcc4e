//! The arm's command queue: never overfilled, no command queued twice.
//!
//! A queued command may not be repeated blindly: when its reply was lost it was done, and would
//! be done again. The index of the next command distinguishes a lost reply from a lost request.

use super::client::{ArmClient, ArmClientError};
use super::command::{ArmCommand, read};
use super::frame::{ArmFrame, Ctrl};
use super::link::LinkError;
use super::{id, reply};
use evrig_core::time::Span;
use evrig_record::host_clock;

impl ArmClient {
    /// Stops and empties the queue, starts it again and finds out where it counts.
    ///
    /// # Errors
    /// No answer, alarms, or an index that cannot be found out.
    pub fn begin(&mut self) -> Result<(), ArmClientError> {
        self.stop()?;
        self.set(&ArmCommand::StartQueue)?;
        self.anchor()
    }

    /// Queues a wait of no time, which may be repeated, to learn the queue's index.
    fn anchor(&mut self) -> Result<(), ArmClientError> {
        self.look_for_space()?;
        let exchange = self.ask(&ArmCommand::Wait(0).frame(Ctrl::QUEUED))?;
        let because = "it answers a command in the queue with no index";
        let index = reply::queued_index(&exchange.reply)?
            .ok_or(ArmClientError::Rejected { command: "WAIT", because })?;
        self.last_index = Some(index);
        // Lost tries may have taken places too.
        self.space = 0;
        Ok(())
    }

    fn look_for_space(&mut self) -> Result<(), ArmClientError> {
        self.space = reply::queue_space(&self.value(id::QUEUE_SPACE)?)?;
        self.depth = self.depth.max(self.space);
        Ok(())
    }

    /// Queues a command and returns its index. Waits for a free place, `deadline` at most. The
    /// index of the next command distinguishes a lost reply from a lost request, so that nothing is
    /// queued twice.
    ///
    /// # Errors
    /// No free place in time, a refusal, or an unexplained silence (the arm is then stopped).
    pub fn enqueue(&mut self, command: &ArmCommand, deadline: Span) -> Result<u64, ArmClientError> {
        self.wait_for_space(command, deadline)?;
        if self.last_index.is_none() {
            self.anchor()?;
        }
        for _ in 0..self.patience.n_tries {
            let request = command.frame(Ctrl::QUEUED);
            match self.link.exchange(&request, self.patience.reply) {
                Ok(exchange) => return self.accept(command, &exchange.reply),
                Err(LinkError::Silent { .. }) => {
                    if let Some(index) = self.find_again(command, &request)? {
                        return Ok(index);
                    }
                }
                Err(error) => return Err(error.into()),
            }
        }
        Err(LinkError::silent(&command.frame(Ctrl::QUEUED), self.patience.reply, 0).into())
    }

    /// Whether the queue is known to take another command without asking.
    pub(super) const fn knows_of_room(&self) -> bool {
        self.space > 0
    }

    /// Whether the queue was empty when it was last asked.
    pub(super) const fn is_empty(&self) -> bool {
        self.space >= self.depth
    }

    /// Whether the queue takes another command, asked only when that is not known.
    ///
    /// # Errors
    /// No answer, or a short one.
    pub fn has_room(&mut self) -> Result<bool, ArmClientError> {
        if self.space == 0 {
            self.look_for_space()?;
        }
        Ok(self.space > 0)
    }

    fn wait_for_space(
        &mut self,
        command: &ArmCommand,
        deadline: Span,
    ) -> Result<(), ArmClientError> {
        let started = host_clock::now();
        while self.space == 0 {
            self.look_for_space()?;
            if self.space > 0 {
                break;
            }
            self.refuse_alarms()?;
            if host_clock::now() - started >= deadline {
                let because = "it stayed full";
                return Err(ArmClientError::Rejected { command: name(command), because });
            }
            self.pause();
        }
        Ok(())
    }

    fn accept(&mut self, command: &ArmCommand, reply: &ArmFrame) -> Result<u64, ArmClientError> {
        let because = "it answered without an index";
        let index = reply::queued_index(reply)?
            .ok_or(ArmClientError::Rejected { command: name(command), because })?;
        self.last_index = Some(index);
        self.space = self.space.saturating_sub(1);
        Ok(index)
    }

    /// After silence: the index if the command was queued, `None` if it never arrived.
    fn find_again(
        &mut self,
        command: &ArmCommand,
        request: &ArmFrame,
    ) -> Result<Option<u64>, ArmClientError> {
        // Replies come in order: a late one comes before the answer to this question.
        let fence = self.ask(&read(id::QUEUE_INDEX))?;
        if let Some(late) = fence.stale.iter().find(|frame| request.is_answered_by(frame)) {
            return self.accept(command, late).map(Some);
        }
        // Both queued or both lost: the next index shows which. Without an answer it is unknown.
        let before = self.last_index;
        let probe = ArmCommand::Wait(0).frame(Ctrl::QUEUED);
        let found = match self.link.exchange(&probe, self.patience.reply) {
            Ok(exchange) => reply::queued_index(&exchange.reply)?,
            Err(LinkError::Silent { .. }) => None,
            Err(error) => return Err(error.into()),
        };
        let jump = found.zip(before).map(|(found, before)| found.wrapping_sub(before));
        self.space = 0;
        match (jump, found) {
            (Some(1), found) => {
                self.last_index = found;
                Ok(None)
            }
            (Some(2), Some(found)) => {
                self.last_index = Some(found);
                Ok(Some(found.wrapping_sub(1)))
            }
            _ => {
                self.stop()?;
                Err(ArmClientError::Uncertain { command: name(command) })
            }
        }
    }
}

fn name(command: &ArmCommand) -> &'static str {
    id::name(command.id()).unwrap_or("UNKNOWN")
}
