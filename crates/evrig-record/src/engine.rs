//! The states of a recording, one after another.

mod drive;
mod recording;
mod request;
mod settings;

pub use request::{Dwells, Prompts, RecordError, RecordOutcome, RecordRequest};

use crate::files::{SampleWriter, SharedRigLog, take_directory};
use crate::recorder::{RecorderTally, host_time};
use crate::wall_clock::WallClock;
use crate::{Devices, Finding, RecordState, StopRequest, StopToken, Verdict, manifest_entries};
use evrig_session::trajectory::ToolPath;
use evrig_session::{
    DataLoss, DeviceEntry, Journal, Origin, SessionStatus, Severity, seal_recording,
};
use recording::{ActiveRecorder, ActiveRecording, EndCause};
use serde_json::json;

/// Checks every device. Nothing moves.
pub fn preflight(devices: &mut Devices, path: &ToolPath) -> Vec<Finding> {
    let mut findings = devices.arm.check(Some(path));
    findings.extend(devices.recorders.iter_mut().flat_map(|recorder| recorder.check()));
    findings
}

/// Records one session. `watch` gets each state as it begins and the share of the path driven,
/// 0..=1.
///
/// # Errors
/// When the rig is not ready, or the session's files cannot be made or sealed. Everything else that
/// goes wrong, a device unplugged among it, is in the sealed session.
pub fn record(
    request: RecordRequest<'_>,
    devices: &mut Devices,
    stop: &StopToken,
    watch: &mut dyn FnMut(RecordState, f64),
) -> Result<RecordOutcome, RecordError> {
    watch(RecordState::Preflight, 0.0);
    let findings = preflight(devices, request.path);
    let bad: Vec<_> = findings.iter().filter(|f| f.verdict == Verdict::Bad).cloned().collect();
    if !bad.is_empty() {
        return Err(RecordError::NotReady(bad));
    }
    let layout = take_directory(request.out)?;
    let mut journal = Journal::open(&layout.journal())?;
    journal.note("preflight", &json!({"findings": findings}))?;
    journal
        .note("recording", &manifest_entries::recording_line(request.rig, request.trajectory))?;
    let log = SharedRigLog::create(&layout)?;
    let mut take = ActiveRecording {
        request,
        devices,
        stop,
        watch,
        layout: &layout,
        journal,
        log,
        state: RecordState::Preflight,
        running: Vec::new(),
        began: None,
        wall_clock: WallClock::default(),
        clock_losses: Vec::new(),
    };
    let cut = take.run().err();
    take.close(cut)
}

impl ActiveRecording<'_> {
    /// Everything up to the tail; the first error ends it.
    fn run(&mut self) -> Result<(), EndCause> {
        self.enter(RecordState::StartPose, json!({}))?;
        let mut prepared = Vec::new();
        for recorder in &mut self.devices.recorders {
            let found = recorder.prepare()?;
            self.journal.note(
                "device",
                &json!({"name": recorder.name(), "description": found.description}),
            )?;
            prepared.push(found);
        }
        let remarks = self.devices.arm.prepare(self.request.path)?;
        self.heed(StopRequest::AfterStep)?;
        self.enter(RecordState::Cameras, json!({"remarks": remarks}))?;
        for (recorder, prepared) in self.devices.recorders.iter_mut().zip(prepared) {
            let compression = self.request.rig.davis.compression;
            let (writer, outlet) =
                SampleWriter::start(self.layout, compression, &prepared, &self.log)?;
            self.running.push(ActiveRecorder {
                writer,
                prepared,
                tally: RecorderTally::default(),
                lost: None,
            });
            recorder.start(outlet)?;
        }
        self.enter(RecordState::LeadIn, json!({}))?;
        self.stop.wait(self.request.dwells.lead_in);
        self.heed(StopRequest::AfterStep)?;
        self.enter(RecordState::Trajectory, json!({}))?;
        let ended_early = self.drive()?;
        self.enter(RecordState::Tail, json!({}))?;
        self.stop.wait(self.request.dwells.tail);
        self.look_at_recorders()?;
        self.heed(StopRequest::Park)?;
        if ended_early { Err(EndCause::Asked(StopRequest::AfterStep)) } else { Ok(()) }
    }

    /// Stops the arm, drains the recorders and seals the session, whatever came before.
    fn close(mut self, cut: Option<EndCause>) -> Result<RecordOutcome, RecordError> {
        let ended_in = self.state;
        let mut losses = std::mem::take(&mut self.clock_losses);
        if let Some(cut) = &cut {
            // The arm first: whatever else is wrong, it must stop.
            let stopped = self.devices.arm.abort();
            if matches!(cut, EndCause::Asked(StopRequest::Park)) && stopped.is_ok() {
                self.park(&mut losses);
            }
            let what = format!("cut short in state {ended_in}: {cut}");
            losses.push(DataLoss { stream: "recording".into(), what: what.clone(), count: 0 });
            // A full disk must not keep the rest from being sealed.
            let _ = self.log.write(|log| log.log(host_time(), Severity::Error, &what));
            let _ = self
                .journal
                .note("cut short", &json!({"state": ended_in, "because": cut.to_string()}));
        }
        let drained = self.enter(RecordState::Drain, json!({}));
        self.settle(&mut losses);
        let devices = self.drain(&mut losses);
        for result in [drained, self.log.finish()] {
            if let Err(error) = result {
                losses.push(DataLoss {
                    stream: "rig.mcap".into(),
                    what: error.to_string(),
                    count: 0,
                });
            }
        }
        (self.watch)(RecordState::Seal, 1.0);
        // The manifest states the same; a full disk may have no space for this line.
        let _ = self.journal.note("seal", &json!({"losses": losses}));
        // What was lost only while it was drained cuts the recording short as well.
        let lost = || devices.iter().find_map(|device| device.lost.clone());
        let cut_short = cut.as_ref().map(ToString::to_string).or_else(lost);
        let ended = cut_short.clone().unwrap_or_else(|| "complete".to_owned());
        let (rig, trajectory) = (self.request.rig, self.request.trajectory);
        let recording = manifest_entries::recording(rig, trajectory, devices, ended, self.began);
        let origin =
            Origin::Recorded { rig: rig.name.clone(), trajectory: trajectory.name.clone() };
        let status =
            if cut_short.is_some() { SessionStatus::Aborted } else { SessionStatus::Complete };
        let manifest = seal_recording(self.layout, origin, status, recording, losses)?;
        Ok(RecordOutcome {
            manifest,
            is_asked_for: matches!(cut, Some(EndCause::Asked(_))),
            cut_short,
        })
    }

    fn park(&mut self, losses: &mut Vec<DataLoss>) {
        let home = ToolPath::new(self.request.rig.arm.home);
        let parked =
            self.devices.arm.prepare(&home).map(|_| ()).and_then(|()| self.devices.arm.finish());
        if let Err(error) = parked {
            losses.push(DataLoss {
                stream: "arm".into(),
                what: format!("not parked: {error}"),
                count: 0,
            });
        }
    }

    /// Ends the recorders and their files; returns the manifest's entry of each.
    fn drain(&mut self, losses: &mut Vec<DataLoss>) -> Vec<DeviceEntry> {
        let mut entries = Vec::new();
        for (index, recorder) in self.devices.recorders.iter_mut().enumerate() {
            let name = recorder.name();
            let Some(running) = self.running.get_mut(index) else {
                recorder.abort();
                continue;
            };
            match recorder.finish() {
                Ok(tally) => running.tally = tally,
                Err(error) => running.lost = Some(error.to_string()),
            }
            let mut lose = |what: String, count: u64| {
                losses.push(DataLoss { stream: name.into(), what, count })
            };
            if let Err(error) = running.writer.finish() {
                lose(error.to_string(), 0);
            }
            if running.tally.n_dropped > 0 {
                lose("samples dropped because a buffer was full".into(), running.tally.n_dropped);
            }
            running.tally.gaps.iter().for_each(|gap| lose(gap.clone(), 0));
            if let Some(lost) = &running.lost {
                lose(lost.clone(), 0);
            }
            entries.push(DeviceEntry {
                name: name.to_owned(),
                description: running.prepared.description.clone(),
                n_samples: running.tally.n_samples,
                n_dropped: running.tally.n_dropped,
                lost: running.lost.clone(),
            });
        }
        entries
    }
}
