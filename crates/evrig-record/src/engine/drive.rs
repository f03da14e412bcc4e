//! Driving the path: run after run, with a prompt to the operator between two of them.

use super::recording::{ActiveRecording, EndCause};
use crate::recorder::host_time;
use crate::{RecordState, StopRequest};
use evrig_core::time::Span;
use evrig_session::trajectory::ToolPath;
use evrig_session::{DataLoss, HostTime, Severity, Topic};
use serde_json::json;
use std::ops::Range;
use std::time::Duration;

/// Between two polls of the operator's answer.
const POLL_INTERVAL: Duration = Duration::from_millis(100);

impl ActiveRecording<'_> {
    /// Drives the path, logging poses; true when it was ended at a corner before its end.
    pub(super) fn drive(&mut self) -> Result<bool, EndCause> {
        let path = self.request.path;
        let is_asked = self.request.prompts.0.is_some();
        for run in runs(path, is_asked) {
            self.ask(run.start)?;
            if self.drive_steps(run)? {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// Waits for the operator where a step asks for that; the cameras run on.
    fn ask(&mut self, step: usize) -> Result<(), EndCause> {
        let prompt = self.request.path.steps().get(step).and_then(|s| s.settings.prompt.as_deref());
        let (Some(text), Some(is_answered)) = (prompt, self.request.prompts.0) else {
            return Ok(());
        };
        self.journal.note("prompt", &json!({"step": step, "text": text}))?;
        while !is_answered(text) {
            self.look_at_recorders()?;
            self.heed(StopRequest::AfterStep)?;
            self.stop.wait(POLL_INTERVAL);
        }
        self.journal.note("answered", &json!({"step": step}))?;
        Ok(())
    }

    /// Drives some steps without a rest between them; true as for [`Self::drive`].
    fn drive_steps(&mut self, run: Range<usize>) -> Result<bool, EndCause> {
        let path = self.request.path;
        let [from, to] = span_of(path, &run);
        let rate = self.request.rig.arm.pose_rate;
        let began = host_time();
        if self.began.is_none() {
            self.began = Some(began);
            self.journal.note("first step", &json!({"unix_ns": began.unix.as_nanos()}))?;
        }
        self.log.commanded(path, [from, to], rate, began)?;
        self.set_step(run.start)?;
        let mut last_step = run.start;
        self.devices.arm.start(run)?;
        let interval = Duration::from_secs_f64(1.0 / rate.0);
        let duration = path.duration().as_secs_f64().max(1e-9);
        loop {
            let progress = self.devices.arm.progress()?;
            let pose = progress.pose;
            let middle = pose.asked + Span::from_nanos((pose.answered - pose.asked).as_nanos() / 2);
            let now = host_time();
            // The wall clock at the pose, from the clock that does not step.
            let at = HostTime { monotonic: middle, unix: now.unix - (now.monotonic - middle) };
            self.log.write(|log| log.pose(Topic::ArmPose, at, pose.pose))?;
            let since = (at.monotonic - began.monotonic) + from;
            (self.watch)(RecordState::Trajectory, (since.as_secs_f64() / duration).min(1.0));
            if progress.step != last_step {
                let label = path.steps().get(progress.step).map(|step| &step.label);
                self.journal.note("step", &json!({"step": progress.step, "label": label}))?;
                if self.stop.requested() == StopRequest::AfterStep {
                    self.devices.arm.abort()?;
                    return Ok(true);
                }
                last_step = progress.step;
                self.set_step(last_step)?;
            }
            if progress.is_done {
                self.devices.arm.finish()?;
                return Ok(false);
            }
            self.look_at_recorders()?;
            self.look_at_clock()?;
            self.heed(StopRequest::Park)?;
            self.stop.wait(interval);
        }
    }

    /// Notes when somebody sets the wall clock.
    fn look_at_clock(&mut self) -> Result<(), EndCause> {
        let Some(by) = self.wall_clock.look(host_time) else { return Ok(()) };
        let what = format!(
            "the host's wall clock was set by {:+.6} s; where a wall-clock time is stored with a \
             monotonic one, use the latter for elapsed time",
            by.as_secs_f64()
        );
        self.journal.note("clock set", &json!({"by_ns": by.as_nanos()}))?;
        self.log.write(|log| log.log(host_time(), Severity::Warning, &what))?;
        self.clock_losses.push(DataLoss { stream: "host clock".into(), what, count: 1 });
        Ok(())
    }
}

/// The steps in runs, each but the first beginning with a prompt; one run without prompts, so that
/// the arm does not stop between steps.
fn runs(path: &ToolPath, is_asked: bool) -> Vec<Range<usize>> {
    let steps = path.steps();
    let asks = |step: &usize| is_asked && steps[*step].settings.prompt.is_some();
    let mut edges = vec![0];
    edges.extend((1..steps.len()).filter(asks));
    edges.push(steps.len());
    edges.windows(2).map(|pair| pair[0]..pair[1]).collect()
}

/// From when to when on the path.
fn span_of(path: &ToolPath, run: &Range<usize>) -> [Span; 2] {
    let start = path.steps().get(run.start).map_or(Span::ZERO, |step| step.start);
    let end = path.steps().get(run.end).map_or(path.duration(), |step| step.start);
    [start, end]
}

#[cfg(test)]
mod tests {
    use super::*;
    use evrig_session::rig::Rig;
    use evrig_session::trajectory::{OptionalSegments, Trajectory};

    #[test]
    fn a_path_is_driven_in_runs_that_begin_with_its_prompts() {
        let rig = Rig::simulated().unwrap();
        let path =
            Trajectory::find("protocol").unwrap().path(&rig, OptionalSegments::Included).unwrap();
        let n_steps = path.steps().len();
        assert_eq!(runs(&path, false), std::slice::from_ref(&(0..n_steps)));
        let asked = runs(&path, true);
        let n_prompts =
            path.steps().iter().skip(1).filter(|step| step.settings.prompt.is_some()).count();
        assert!(n_prompts >= 3);
        assert_eq!(asked.len(), n_prompts + 1);
        assert_eq!((asked[0].start, asked[n_prompts].end), (0, n_steps));
        for pair in asked.windows(2) {
            assert_eq!(pair[0].end, pair[1].start);
            assert!(path.steps()[pair[1].start].settings.prompt.is_some());
            assert_eq!(span_of(&path, &pair[0])[1], span_of(&path, &pair[1])[0]);
        }
    }
}
