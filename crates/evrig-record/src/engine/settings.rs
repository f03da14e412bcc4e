//! What the engine asks of the cameras beside starting and ending: a step's settings, and all they
//! saw.

use super::recording::{ActiveRecording, EndCause};
use crate::{RecordState, StopRequest};
use evrig_session::DataLoss;
use evrig_session::trajectory::StepSettings;
use serde_json::json;
use std::time::{Duration, Instant};

/// A camera that sends what it saw, but nothing for so long, has nothing more to send.
const SETTLE_TIMEOUT: Duration = Duration::from_secs(30);
/// Between two polls of what is still to come.
const POLL_INTERVAL: Duration = Duration::from_millis(50);

impl ActiveRecording<'_> {
    /// Sets what a step asks for beside the motion, if that is other than what the last one asked
    /// for.
    pub(super) fn set_step(&mut self, step: usize) -> Result<(), EndCause> {
        let steps = self.request.path.steps();
        let Some(settings) = steps.get(step).map(|step| &step.settings) else { return Ok(()) };
        let before = step.checked_sub(1).and_then(|before| steps.get(before));
        let before = before.map_or_else(StepSettings::default, |before| before.settings.clone());
        if before == *settings && settings.n_flashes == 0 {
            return Ok(());
        }
        let recorders = &mut self.devices.recorders;
        let unset: Vec<_> =
            recorders.iter_mut().flat_map(|recorder| recorder.set(settings)).collect();
        self.journal.note("set", &json!({"step": step, "settings": settings, "unset": unset}))?;
        Ok(())
    }

    /// Waits for what the cameras saw but have not sent: as long as more of it comes, and no
    /// longer.
    pub(super) fn settle(&mut self, losses: &mut Vec<DataLoss>) {
        let mut best = -1.0;
        let mut since = Instant::now();
        loop {
            let running = self.devices.recorders.iter_mut().take(self.running.len());
            // A camera that was lost owes nothing; finishing it reports why.
            let shares = running.map(|recorder| recorder.settle().unwrap_or(1.0));
            let share = shares.fold(1.0, f64::min);
            (self.watch)(RecordState::Drain, share);
            if share > best {
                (best, since) = (share, Instant::now());
            }
            let is_stuck = since.elapsed() >= SETTLE_TIMEOUT;
            if is_stuck || (self.stop.requested() == StopRequest::AtOnce && share < 1.0) {
                let what = format!("{:.1} % of the samples had not arrived", 100.0 * (1.0 - share));
                losses.push(DataLoss { stream: "recording".into(), what, count: 0 });
            } else if share < 1.0 {
                std::thread::sleep(POLL_INTERVAL);
                continue;
            }
            return;
        }
    }
}
