//! Progress over the steps of the demo: which step it is, and about how long all of them still
//! take.

use crate::commands::Output;
use indicatif::ProgressBar;
use std::io::IsTerminal;
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// A step and its share of the whole time, as measured on two cores.
pub(super) type DemoStep = (&'static str, f64);

/// Time between two lines where no terminal redraws one.
const LINE_PERIOD: Duration = Duration::from_secs(4);

/// Time between two redraws.
const REDRAW_PERIOD: Duration = Duration::from_millis(500);

#[derive(Clone)]
struct StepState {
    steps: &'static [DemoStep],
    index: usize,
    /// Done of this step, 0 to 1, where it is known.
    done: Option<f64>,
    /// What the step is doing.
    detail: String,
    began: Instant,
    step_began: Instant,
}

impl StepState {
    /// Seconds that all steps still take, from the time that those before took.
    fn seconds_left(&self, now: Instant) -> Option<f64> {
        let share = |steps: &[DemoStep]| steps.iter().map(|(_, share)| share).sum::<f64>();
        let (_, own) = self.steps[self.index];
        let before = share(&self.steps[..self.index]);
        let elapsed = (now - self.began).as_secs_f64();
        let (past, known) = match self.done.filter(|done| *done > 0.0) {
            Some(done) => (elapsed, before + own * done),
            None => ((self.step_began - self.began).as_secs_f64(), before),
        };
        let total = past / known * share(self.steps);
        // A step that takes longer than its share leaves at least those behind it.
        let behind = share(&self.steps[self.index + 1..]);
        (known > 0.0).then(|| (total - elapsed).max(total * behind))
    }

    fn line(&self, now: Instant) -> String {
        let (name, _) = self.steps[self.index];
        let mut line = format!("step {} of {}: {name}", self.index + 1, self.steps.len());
        if !self.detail.is_empty() {
            line += &format!(" ({})", self.detail);
        }
        if let Some(left) = self.seconds_left(now).filter(|left| *left >= 1.0) {
            line += &format!(", about {left:.0} s left in all");
        }
        line
    }
}

/// The progress line; it ends when this is dropped.
pub(super) struct StepDisplay {
    state: Arc<Mutex<StepState>>,
    /// Dropped to end the thread.
    ender: Option<Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl StepDisplay {
    pub(super) fn new(output: &Output, steps: &'static [DemoStep]) -> std::io::Result<Self> {
        let now = Instant::now();
        let detail = String::new();
        let state = StepState { steps, index: 0, done: None, detail, began: now, step_began: now };
        let state = Arc::new(Mutex::new(state));
        let (ender, ended) = channel();
        let (seen, output) = (Arc::clone(&state), *output);
        let bar = output.line();
        let mut draw = painter(bar, output);
        let thread = std::thread::Builder::new().name("progress".to_owned()).spawn(move || {
            loop {
                let state = seen.lock().unwrap_or_else(PoisonError::into_inner).clone();
                draw(&state);
                if ended.recv_timeout(REDRAW_PERIOD) != Err(RecvTimeoutError::Timeout) {
                    break;
                }
            }
        })?;
        Ok(Self { state, ender: Some(ender), thread: Some(thread) })
    }

    /// Begins the next step; the first is begun already.
    pub(super) fn next(&self) {
        self.change(|state| {
            state.index = (state.index + 1).min(state.steps.len() - 1);
            state.done = None;
            state.detail.clear();
            state.step_began = Instant::now();
        });
    }

    /// States how much of the step is done, 0 to 1.
    pub(super) fn done(&self, share: f64) {
        self.change(|state| state.done = Some(share));
    }

    /// States what the step is doing.
    pub(super) fn detail(&self, text: &str) {
        self.change(|state| text.clone_into(&mut state.detail));
    }

    fn change(&self, change: impl FnOnce(&mut StepState)) {
        change(&mut self.state.lock().unwrap_or_else(PoisonError::into_inner));
    }
}

impl Drop for StepDisplay {
    fn drop(&mut self) {
        drop(self.ender.take());
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// Redraws one line of a terminal; elsewhere prints a line for each step and every few seconds.
fn painter(bar: ProgressBar, output: Output) -> impl FnMut(&StepState) + Send {
    let is_terminal = std::io::stderr().is_terminal();
    let mut last: Option<(usize, Instant)> = None;
    move |state| {
        let now = Instant::now();
        if is_terminal {
            bar.set_message(state.line(now));
            return;
        }
        let is_due =
            |(index, at): (usize, Instant)| index != state.index || now - at >= LINE_PERIOD;
        if last.is_none_or(is_due) {
            last = Some((state.index, now));
            output.say(state.line(now));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEPS: &[DemoStep] = &[("a", 0.25), ("b", 0.5), ("c", 0.25)];

    #[test]
    fn the_time_left_comes_from_the_time_of_the_steps_before() {
        let began = Instant::now();
        let at = |s: f64| began + Duration::from_secs_f64(s);
        let mut state = StepState {
            steps: STEPS,
            index: 0,
            done: None,
            detail: String::new(),
            began,
            step_began: began,
        };
        assert_eq!(state.seconds_left(at(1.0)), None, "nothing was measured yet");
        state.done = Some(0.5);
        assert!((state.seconds_left(at(1.0)).unwrap() - 7.0).abs() < 1e-6);
        (state.index, state.done, state.step_began) = (1, None, at(2.0));
        assert!((state.seconds_left(at(4.0)).unwrap() - 4.0).abs() < 1e-6);
        assert!((state.seconds_left(at(99.0)).unwrap() - 2.0).abs() < 1e-6, "the last step");
        state.detail = "errors".into();
        assert_eq!(state.line(at(4.0)), "step 2 of 3: b (errors), about 4 s left in all");
    }
}
