//! The arm with its clock, as the serving thread and its observers share it.

use crate::arm::fault::Faults;
use crate::arm::journal::RequestJournal;
use crate::arm::options::ArmOptions;
use crate::arm::simulated::SimulatedArm;
use evrig_core::time::Span;
use std::sync::atomic::AtomicBool;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Instant;

/// How the arm's time passes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ArmClock {
    /// So many times as fast as the host's.
    Scaled(f64),
    /// That much with every request, whatever the host's clock does: the same requests give
    /// the same motion on any machine, and nothing waits.
    Stepped(Span),
}

#[derive(Debug)]
pub(super) struct SharedArm {
    pub(super) arm: Mutex<ClockedArm>,
    pub(super) faults: Mutex<Faults>,
    pub(super) journal: Mutex<RequestJournal>,
    pub(super) is_ending: AtomicBool,
}

#[derive(Debug)]
pub(super) struct ClockedArm {
    pub(super) arm: SimulatedArm,
    pub(super) options: ArmOptions,
    pub(super) clock: ArmClock,
    pub(super) powered_up: Instant,
}

pub(super) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    // What a panicking thread left behind is still a state an arm can be in.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl ClockedArm {
    pub(super) fn now(&self, is_request: bool) -> Span {
        match self.clock {
            ArmClock::Scaled(scale) => {
                Span::from_secs_f64(self.powered_up.elapsed().as_secs_f64() * scale)
            }
            ArmClock::Stepped(step) if is_request => self.arm.now() + step,
            ArmClock::Stepped(_) => self.arm.now(),
        }
    }

    pub(super) fn power_cycle(&mut self) {
        self.arm = SimulatedArm::new(ArmOptions { is_homed: false, ..self.options.clone() });
        self.powered_up = Instant::now();
    }
}
