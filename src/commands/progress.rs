//! Progress of a pipeline as bars and lines on stderr.

use super::Output;
use crate::batch::BatchProgress;
use crate::pipeline::PipelineProgress;
use indicatif::ProgressBar;
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

/// One bar at a time: that of the stage under way.
pub(super) struct ProgressDisplay<'a> {
    output: &'a Output,
    began: Instant,
    current: Mutex<Option<(&'static str, ProgressBar)>>,
}

impl<'a> ProgressDisplay<'a> {
    pub(super) fn new(output: &'a Output) -> Self {
        Self { output, began: Instant::now(), current: Mutex::default() }
    }

    fn on_bar(&self, stage: &'static str, change: impl FnOnce(&ProgressBar)) {
        let mut current = self.current.lock().unwrap_or_else(PoisonError::into_inner);
        if current.as_ref().is_none_or(|(shown, _)| *shown != stage)
            && let Some((_, ended)) = current.replace((stage, self.output.progress(stage, 0)))
        {
            ended.finish_and_clear();
        }
        if let Some((_, bar)) = current.as_ref() {
            change(bar);
        }
    }

    pub(super) fn show(&self, progress: PipelineProgress<'_>) {
        match progress {
            PipelineProgress::Stage { stage, stream, done, total } => self.on_bar(stage, |bar| {
                if bar.length() != Some(total) {
                    bar.set_length(total);
                }
                if done <= 1 && !stream.is_empty() {
                    bar.set_message(format!("{stage} {stream}"));
                }
                bar.set_position(done);
            }),
            PipelineProgress::Diagnosis(what) => self.on_bar("diagnose", |bar| {
                let at_s = self.began.elapsed().as_secs_f64();
                bar.suspend(|| self.output.detail(format!("{at_s:8.1} s  {what}")));
                bar.set_message(what.to_owned());
                bar.inc(1);
            }),
            PipelineProgress::Message(text) => self.suspended(|| self.output.say(text)),
        }
    }

    fn suspended(&self, print: impl FnOnce()) {
        let current = self.current.lock().unwrap_or_else(PoisonError::into_inner);
        match current.as_ref() {
            Some((_, bar)) => bar.suspend(print),
            None => print(),
        }
    }

    /// Progress over a dataset: a line per session and the bar of the stage under way.
    pub(super) fn show_batch(&self, progress: BatchProgress<'_>) {
        match progress {
            BatchProgress::Sessions(n) => self.output.detail(format_args!("{n} sessions")),
            BatchProgress::Begun(session) => {
                self.suspended(|| self.output.say(format_args!("{session} ...")));
            }
            BatchProgress::Ended(outcome) => self.suspended(|| {
                self.output.say(format_args!("{}: {}", outcome.session, outcome.summary()));
            }),
            BatchProgress::Compared(session) => {
                self.suspended(|| self.output.detail(format_args!("{session}: compared")));
            }
            BatchProgress::Stage(stage) => self.show(stage),
        }
    }
}

impl Drop for ProgressDisplay<'_> {
    fn drop(&mut self) {
        let mut current = self.current.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, bar)) = current.take() {
            bar.finish_and_clear();
        }
    }
}
