//! The simulated arm's command queue: places, indexes, what has finished.

use evrig_device::dobot::command::ArmCommand;
use std::collections::VecDeque;

/// Something that waits for its turn.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum QueuedTask {
    /// A command that moves, waits or homes.
    Do(ArmCommand),
    /// A parameter or a pin that changes when its turn comes.
    Set {
        /// Which.
        id: u8,
        /// To what.
        params: Vec<u8>,
    },
}

/// A task and its index.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct QueueEntry {
    /// Number of the command since power-up.
    pub(super) index: u64,
    /// What it is.
    pub(super) task: QueuedTask,
}

/// The queue. It holds `depth` commands at most, the running one not counted.
#[derive(Debug, Clone)]
pub(super) struct CommandQueue {
    waiting: VecDeque<QueueEntry>,
    depth: usize,
    last_given: u64,
    last_finished: u64,
    is_started: bool,
}

impl CommandQueue {
    /// An empty queue that is not started; the first command gets index `start` + 1.
    #[must_use]
    pub(super) const fn new(depth: usize, start: u64) -> Self {
        Self {
            waiting: VecDeque::new(),
            depth,
            last_given: start,
            last_finished: start,
            is_started: false,
        }
    }

    /// Takes a task in and gives it its index; `None` when the queue is full.
    pub(super) fn push(&mut self, task: QueuedTask) -> Option<u64> {
        if self.space() == 0 {
            return None;
        }
        self.last_given = self.last_given.wrapping_add(1);
        self.waiting.push_back(QueueEntry { index: self.last_given, task });
        Some(self.last_given)
    }

    /// The next task, when the queue runs.
    pub(super) fn pop(&mut self) -> Option<QueueEntry> {
        if self.is_started { self.waiting.pop_front() } else { None }
    }

    /// The commands behind the current one, up to the first that is not one.
    pub(super) fn commands(&self) -> impl Iterator<Item = ArmCommand> {
        self.waiting.iter().map_while(|entry| match entry.task {
            QueuedTask::Do(command) => Some(command),
            QueuedTask::Set { .. } => None,
        })
    }

    /// Notes that a task has ended.
    pub(super) const fn finish(&mut self, index: u64) {
        self.last_finished = index;
    }

    /// Forgets all that waits; indexes go on counting.
    pub(super) fn clear(&mut self) {
        self.waiting.clear();
    }

    /// Lets the queue run or not.
    pub(super) const fn set_started(&mut self, is_started: bool) {
        self.is_started = is_started;
    }

    /// Free places.
    #[must_use]
    pub(super) fn space(&self) -> usize {
        self.depth.saturating_sub(self.waiting.len())
    }

    /// Commands that wait.
    #[must_use]
    pub(super) fn n_waiting(&self) -> usize {
        self.waiting.len()
    }

    /// Index of the command that finished last.
    #[must_use]
    pub(super) const fn last_finished(&self) -> u64 {
        self.last_finished
    }
}
