//! What the simulated arm answers, request by request.

use super::queue::QueuedTask;
use super::simulated::{SimulatedArm, VERSION};
use evrig_core::time::Span;
use evrig_device::dobot::alarm::Alarms;
use evrig_device::dobot::command::ArmCommand;
use evrig_device::dobot::frame::{ArmFrame, Ctrl};
use evrig_device::dobot::id;

impl SimulatedArm {
    /// Answers a request `now` after power-up; `None` where the firmware stays silent.
    pub fn answer(&mut self, request: &ArmFrame, now: Span) -> Option<ArmFrame> {
        self.advance(now);
        let params = if !request.ctrl().is_write() || request.id() == id::QUEUE_INDEX {
            self.read(request)?
        } else if request.ctrl().is_queued() {
            self.enqueue(request)?
        } else {
            self.do_at_once(request)?;
            Vec::new()
        };
        self.take_turns();
        ArmFrame::new(request.id(), request.ctrl(), params)
    }

    fn read(&self, request: &ArmFrame) -> Option<Vec<u8>> {
        let floats =
            |values: &[f64]| values.iter().flat_map(|v| (*v as f32).to_le_bytes()).collect();
        Some(match request.id() {
            id::DEVICE_SERIAL => [self.options.serial.as_bytes(), &[0]].concat(),
            id::DEVICE_VERSION => VERSION.to_vec(),
            id::DEVICE_TIME => ((self.now.as_micros() / 1_000) as u32).to_le_bytes().to_vec(),
            id::DEVICE_ID => vec![0; 12],
            id::POSE => floats(&[self.xyzr(), self.joints_at(self.now)].concat()),
            id::ALARMS => self.alarms.to_bytes().to_vec(),
            id::HOME_STATUS => vec![u8::from(self.is_homed)],
            id::QUEUE_INDEX => self.queue.last_finished().to_le_bytes().to_vec(),
            id::QUEUE_SPACE if self.options.wide_space => {
                (self.queue.space() as u64).to_le_bytes().to_vec()
            }
            id::QUEUE_SPACE => (self.queue.space() as u32).to_le_bytes().to_vec(),
            other => return self.registers.read(other, request.params()),
        })
    }

    /// Sets a register, as far as the firmware lets it be set.
    pub(super) fn write(&mut self, id: u8, params: &[u8]) {
        self.registers.write(id, params);
        if self.options.clamps {
            self.registers.clamp(id);
        }
    }

    /// Puts a command into the queue: its index, or nothing when there is no place.
    fn enqueue(&mut self, request: &ArmFrame) -> Option<Vec<u8>> {
        let task = self.task(request)?;
        Some(self.queue.push(task).map(u64::to_le_bytes).map_or_else(Vec::new, Vec::from))
    }

    /// The queued command of a written frame; `None` when the firmware does not know it.
    fn task(&self, request: &ArmFrame) -> Option<QueuedTask> {
        let id = request.id();
        if self.registers.knows(id) {
            return Some(QueuedTask::Set { id, params: request.params().to_vec() });
        }
        match ArmCommand::decode(request).ok().flatten() {
            Some(ArmCommand::Circle { .. }) if !self.options.has_circle => None,
            Some(command) => Some(QueuedTask::Do(command)),
            // Known to the documents, without effect on what is simulated here.
            None => simplified(request).map(QueuedTask::Do),
        }
    }

    fn do_at_once(&mut self, request: &ArmFrame) -> Option<()> {
        let QueuedTask::Do(command) = self.task(request)? else {
            self.write(request.id(), request.params());
            return Some(());
        };
        match command {
            ArmCommand::ClearAlarms => self.alarms = Alarms::default(),
            ArmCommand::StartQueue => self.queue.set_started(true),
            ArmCommand::StopQueue => self.queue.set_started(false),
            ArmCommand::ForceStop => {
                self.queue.set_started(false);
                self.break_off();
            }
            ArmCommand::ClearQueue => self.queue.clear(),
            motion => {
                self.break_off();
                self.begin(&motion, None);
            }
        }
        Some(())
    }
}

/// Commands that are taken but act as something simpler: a move with outputs on the way as the
/// move, a trigger or an old clear as nothing that takes time.
fn simplified(request: &ArmFrame) -> Option<ArmCommand> {
    match request.id() {
        id::PTP_WITH_OUTPUT | id::PTP_WITH_RAIL => {
            let plain = ArmFrame::new(id::PTP, Ctrl::QUEUED, request.params().to_vec())?;
            ArmCommand::decode(&plain).ok().flatten()
        }
        id::CP_LASER => {
            let plain = ArmFrame::new(id::CP, Ctrl::QUEUED, request.params().to_vec())?;
            ArmCommand::decode(&plain).ok().flatten()
        }
        id::TRIGGER | id::LOST_STEP | id::RESET_POSE | id::DOWNLOAD_START | id::DOWNLOAD_STOP => {
            Some(ArmCommand::Wait(0))
        }
        _ => None,
    }
}
