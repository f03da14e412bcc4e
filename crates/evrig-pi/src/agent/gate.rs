//! Who failed lately is not let in for a while, so that guessing and flooding cost the camera
//! nothing.

use std::collections::VecDeque;
use std::net::IpAddr;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// So many failures of one address ...
const N_FAILURES: usize = 5;
/// ... within so long close the door to it.
const WINDOW: Duration = Duration::from_secs(10);
/// Failures that are remembered at most; beyond, the oldest are forgotten.
const N_REMEMBERED: usize = 256;

#[derive(Debug, Default)]
pub(super) struct Gate {
    failures: Mutex<VecDeque<(Instant, IpAddr)>>,
}

impl Gate {
    pub(super) fn admits(&self, address: IpAddr) -> bool {
        self.admits_at(address, Instant::now())
    }

    pub(super) fn failed(&self, address: IpAddr) {
        self.failed_at(address, Instant::now());
    }

    fn admits_at(&self, address: IpAddr, now: Instant) -> bool {
        let failures = self.failures.lock().unwrap_or_else(PoisonError::into_inner);
        let is_recent = |&&(at, of): &&(Instant, IpAddr)| {
            of == address && now.saturating_duration_since(at) < WINDOW
        };
        failures.iter().filter(is_recent).count() < N_FAILURES
    }

    fn failed_at(&self, address: IpAddr, now: Instant) {
        let mut failures = self.failures.lock().unwrap_or_else(PoisonError::into_inner);
        if failures.len() == N_REMEMBERED {
            failures.pop_front();
        }
        failures.push_back((now, address));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_fails_often_waits_and_others_do_not() {
        let gate = Gate::default();
        let [stranger, host] = [IpAddr::from([10, 0, 0, 1]), IpAddr::from([10, 0, 0, 2])];
        let began = Instant::now();
        for k in 0..N_FAILURES {
            assert!(gate.admits_at(stranger, began), "failure {k}");
            gate.failed_at(stranger, began);
        }
        assert!(!gate.admits_at(stranger, began));
        assert!(gate.admits_at(host, began));
        assert!(gate.admits_at(stranger, began + WINDOW));
        for _ in 0..2 * N_REMEMBERED {
            gate.failed_at(stranger, began);
        }
        assert_eq!(gate.failures.lock().unwrap().len(), N_REMEMBERED);
    }
}
