//! The states of a recording, one after another.

mod drive;
mod settings;

pub use drive::Prompts;

use super::files::{Log, SampleWriter, take_directory};
use super::told;
use super::wall_clock::WallClock;
use super::{Devices, State, Stop, StopToken};
use crate::recorder::{Prepared, RecorderError, Tally, host_time};
use crate::{DeviceError, Finding, Verdict};
use evrig_session::rig::Rig;
use evrig_session::trajectory::{ToolPath, Trajectory};
use evrig_session::{
    DataLoss, DeviceEntry, HostTime, Journal, Manifest, Origin, SessionError, SessionLayout,
    SessionStatus, Severity, seal_recording,
};
use serde_json::{Value, json};
use std::time::Duration;

/// Rests before and behind the path, on top of those that the trajectory states.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Dwells {
    /// Cameras run, the arm has not begun.
    pub lead_in: Duration,
    /// The arm has ended, cameras run on.
    pub tail: Duration,
}

impl Default for Dwells {
    fn default() -> Self {
        Self { lead_in: Duration::from_millis(500), tail: Duration::from_millis(500) }
    }
}

/// What is to be recorded.
#[derive(Debug, Clone, Copy)]
pub struct Request<'a> {
    /// The rig, for the manifest.
    pub rig: &'a Rig,
    /// The trajectory, for the manifest.
    pub trajectory: &'a Trajectory,
    /// The trajectory on that rig.
    pub path: &'a ToolPath,
    /// The session's directory; it must be missing or empty.
    pub out: &'a std::path::Path,
    /// Rests around the path.
    pub dwells: Dwells,
    /// Who answers the path's prompts; without anybody they are passed over.
    pub prompts: Prompts<'a>,
}

/// How a recording went.
#[derive(Debug, Clone, PartialEq)]
pub struct Outcome {
    /// The sealed manifest.
    pub manifest: Manifest,
    /// Why it ended before its end; none when it did not.
    pub cut_short: Option<String>,
    /// Whether the operator wanted that.
    pub is_asked_for: bool,
}

/// Why there is no session.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    /// Something must be mended first; nothing moved, nothing was made.
    #[error("not ready: {}", .0.iter().map(|f| format!("{}: {}", f.subject, f.description)).collect::<Vec<_>>().join("; "))]
    NotReady(Vec<Finding>),
    /// The files cannot be made or sealed.
    #[error(transparent)]
    Session(#[from] SessionError),
}

/// Why a state was left early.
#[derive(Debug, thiserror::Error)]
enum Cut {
    #[error("the operator asked for it ({0:?})")]
    Asked(Stop),
    #[error(transparent)]
    Arm(#[from] DeviceError),
    #[error(transparent)]
    Recorder(#[from] RecorderError),
    #[error(transparent)]
    Files(#[from] SessionError),
    #[error("the writer of {0} ended; is the disk full?")]
    Writer(&'static str),
}

/// Looks at every device. Nothing moves.
pub fn preflight(devices: &mut Devices, path: &ToolPath) -> Vec<Finding> {
    let mut findings = devices.arm.check(Some(path));
    findings.extend(devices.recorders.iter_mut().flat_map(|recorder| recorder.check()));
    findings
}

/// Records one session. `watch` is told each state as it begins and how far the path is, 0..=1.
///
/// # Errors
/// When the rig is not ready, or the session's files cannot be made or sealed. Everything else that
/// goes wrong, a device unplugged among it, is in the sealed session.
pub fn record(
    request: Request<'_>,
    devices: &mut Devices,
    stop: &StopToken,
    watch: &mut dyn FnMut(State, f64),
) -> Result<Outcome, RecordError> {
    watch(State::Preflight, 0.0);
    let findings = preflight(devices, request.path);
    let bad: Vec<_> = findings.iter().filter(|f| f.verdict == Verdict::Bad).cloned().collect();
    if !bad.is_empty() {
        return Err(RecordError::NotReady(bad));
    }
    let layout = take_directory(request.out)?;
    let mut journal = Journal::open(&layout.journal())?;
    journal.note("preflight", &json!({"findings": findings}))?;
    journal.note("recording", &told::opening(request.rig, request.trajectory))?;
    let log = Log::create(&layout)?;
    let mut take = Take {
        request,
        devices,
        stop,
        watch,
        layout: &layout,
        journal,
        log,
        state: State::Preflight,
        running: Vec::new(),
        began: None,
        wall_clock: WallClock::default(),
        clock_losses: Vec::new(),
    };
    let cut = take.run().err();
    take.close(cut)
}

/// One recorder under way.
struct Running {
    writer: SampleWriter,
    prepared: Prepared,
    tally: Tally,
    lost: Option<String>,
}

struct Take<'a> {
    request: Request<'a>,
    devices: &'a mut Devices,
    stop: &'a StopToken,
    watch: &'a mut dyn FnMut(State, f64),
    layout: &'a SessionLayout,
    journal: Journal,
    log: Log,
    state: State,
    running: Vec<Running>,
    began: Option<HostTime>,
    wall_clock: WallClock,
    clock_losses: Vec<DataLoss>,
}

impl Take<'_> {
    /// Everything up to the tail; what cuts it short is told by the first error.
    fn run(&mut self) -> Result<(), Cut> {
        self.enter(State::StartPose, json!({}))?;
        let mut prepared = Vec::new();
        for recorder in &mut self.devices.recorders {
            let found = recorder.prepare()?;
            self.journal
                .note("device", &json!({"name": recorder.name(), "description": found.says}))?;
            prepared.push(found);
        }
        let remarks = self.devices.arm.prepare(self.request.path)?;
        self.heed(Stop::AfterStep)?;
        self.enter(State::Cameras, json!({"remarks": remarks}))?;
        for (recorder, prepared) in self.devices.recorders.iter_mut().zip(prepared) {
            let compression = self.request.rig.davis.compression;
            let (writer, outlet) =
                SampleWriter::start(self.layout, compression, &prepared, &self.log)?;
            self.running.push(Running { writer, prepared, tally: Tally::default(), lost: None });
            recorder.start(outlet)?;
        }
        self.enter(State::LeadIn, json!({}))?;
        self.stop.rest(self.request.dwells.lead_in);
        self.heed(Stop::AfterStep)?;
        self.enter(State::Trajectory, json!({}))?;
        let ended_early = self.drive()?;
        self.enter(State::Tail, json!({}))?;
        self.stop.rest(self.request.dwells.tail);
        self.look_at_recorders()?;
        self.heed(Stop::Park)?;
        if ended_early { Err(Cut::Asked(Stop::AfterStep)) } else { Ok(()) }
    }

    fn look_at_recorders(&mut self) -> Result<(), Cut> {
        for (recorder, running) in self.devices.recorders.iter_mut().zip(&mut self.running) {
            match recorder.progress() {
                Ok(tally) => running.tally = tally,
                Err(error) => {
                    running.lost = Some(error.to_string());
                    return Err(error.into());
                }
            }
            if running.writer.has_ended() && !running.tally.is_over {
                return Err(Cut::Writer(recorder.name()));
            }
        }
        Ok(())
    }

    /// Ends the state if the operator asked for at least this.
    fn heed(&self, least: Stop) -> Result<(), Cut> {
        let wish = self.stop.wish();
        if wish >= least { Err(Cut::Asked(wish)) } else { Ok(()) }
    }

    fn enter(&mut self, state: State, details: Value) -> Result<(), SessionError> {
        self.state = state;
        (self.watch)(state, 0.0);
        self.journal.note(&state.to_string(), &details)?;
        self.log.write(|log| log.log(host_time(), Severity::Info, &state.to_string()))
    }

    /// Stands still, drains, seals; whatever came before.
    fn close(mut self, cut: Option<Cut>) -> Result<Outcome, RecordError> {
        let ended_in = self.state;
        let mut losses = std::mem::take(&mut self.clock_losses);
        if let Some(cut) = &cut {
            // The arm first: whatever else is wrong, it must stand.
            let stopped = self.devices.arm.abort();
            if matches!(cut, Cut::Asked(Stop::Park)) && stopped.is_ok() {
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
        let drained = self.enter(State::Drain, json!({}));
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
        (self.watch)(State::Seal, 1.0);
        // The manifest tells the same; a full disk may have no room for this line.
        let _ = self.journal.note("seal", &json!({"losses": losses}));
        // What was lost only while it was drained cuts the recording short as well.
        let lost = || devices.iter().find_map(|device| device.lost.clone());
        let cut_short = cut.as_ref().map(ToString::to_string).or_else(lost);
        let ended = cut_short.clone().unwrap_or_else(|| "complete".to_owned());
        let (rig, trajectory) = (self.request.rig, self.request.trajectory);
        let recording = told::recording(rig, trajectory, devices, ended, self.began);
        let origin =
            Origin::Recorded { rig: rig.name.clone(), trajectory: trajectory.name.clone() };
        let status =
            if cut_short.is_some() { SessionStatus::Aborted } else { SessionStatus::Complete };
        let manifest = seal_recording(self.layout, origin, status, recording, losses)?;
        Ok(Outcome { manifest, is_asked_for: matches!(cut, Some(Cut::Asked(_))), cut_short })
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

    /// Ends the recorders and their files; says what became of each.
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
                description: running.prepared.says.clone(),
                n_samples: running.tally.n_samples,
                n_dropped: running.tally.n_dropped,
                lost: running.lost.clone(),
            });
        }
        entries
    }
}
