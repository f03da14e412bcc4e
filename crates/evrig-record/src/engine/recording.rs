//! A recording under way, as all its steps see it.

use super::request::RecordRequest;
use crate::files::{SampleWriter, SharedRigLog};
use crate::recorder::{PreparedRecorder, RecorderError, RecorderTally, host_time};
use crate::wall_clock::WallClock;
use crate::{DeviceError, Devices, RecordState, StopRequest, StopToken};
use evrig_session::{DataLoss, HostTime, Journal, SessionError, SessionLayout, Severity};
use serde_json::Value;

/// Why a state was left early.
#[derive(Debug, thiserror::Error)]
pub(super) enum EndCause {
    #[error("the operator requested to {0}")]
    Asked(StopRequest),
    #[error(transparent)]
    Arm(#[from] DeviceError),
    #[error(transparent)]
    Recorder(#[from] RecorderError),
    #[error(transparent)]
    Files(#[from] SessionError),
    #[error("the writer of {0} ended; is the disk full?")]
    Writer(&'static str),
}

/// One recorder under way.
pub(super) struct ActiveRecorder {
    pub(super) writer: SampleWriter,
    pub(super) prepared: PreparedRecorder,
    pub(super) tally: RecorderTally,
    pub(super) lost: Option<String>,
}

pub(super) struct ActiveRecording<'a> {
    pub(super) request: RecordRequest<'a>,
    pub(super) devices: &'a mut Devices,
    pub(super) stop: &'a StopToken,
    pub(super) watch: &'a mut dyn FnMut(RecordState, f64),
    pub(super) layout: &'a SessionLayout,
    pub(super) journal: Journal,
    pub(super) log: SharedRigLog,
    pub(super) state: RecordState,
    pub(super) running: Vec<ActiveRecorder>,
    pub(super) began: Option<HostTime>,
    pub(super) wall_clock: WallClock,
    pub(super) clock_losses: Vec<DataLoss>,
}

impl ActiveRecording<'_> {
    pub(super) fn look_at_recorders(&mut self) -> Result<(), EndCause> {
        for (recorder, running) in self.devices.recorders.iter_mut().zip(&mut self.running) {
            match recorder.progress() {
                Ok(tally) => running.tally = tally,
                Err(error) => {
                    running.lost = Some(error.to_string());
                    return Err(error.into());
                }
            }
            if running.writer.has_ended() && !running.tally.is_over {
                return Err(EndCause::Writer(recorder.name()));
            }
        }
        Ok(())
    }

    /// Ends the state if the operator asked for at least this.
    pub(super) fn heed(&self, least: StopRequest) -> Result<(), EndCause> {
        let wish = self.stop.requested();
        if wish >= least { Err(EndCause::Asked(wish)) } else { Ok(()) }
    }

    pub(super) fn enter(&mut self, state: RecordState, details: Value) -> Result<(), SessionError> {
        self.state = state;
        (self.watch)(state, 0.0);
        self.journal.note(&state.to_string(), &details)?;
        self.log.write(|log| log.log(host_time(), Severity::Info, &state.to_string()))
    }
}
