//! Bursts of events that follow the camera's own frames.

use super::Evidence;
use crate::camera_report::{FrameReference, FrameStarts, frame_bursts};
use crate::diagnose::evidence::frame_bursts::FrameBursts;
use evrig_core::event::EventSlice;

const MIN_FRAMES: usize = 8;

/// Why the effect cannot be tested.
pub(super) fn needs(evidence: &Evidence) -> Result<(), String> {
    let n = evidence.event_context.frames_us().len();
    if n < MIN_FRAMES {
        return Err(format!("the camera took {n} frames; at least {MIN_FRAMES} are needed"));
    }
    Ok(())
}

/// Bursts among all events, if significant.
pub(super) fn bursts(evidence: &Evidence, events: EventSlice<'_>) -> Option<FrameBursts> {
    needs(evidence).ok()?;
    let starts = evidence.event_context.frames_us();
    let frames = FrameStarts::new(starts.to_vec(), FrameReference::ExposureStart);
    let size = evidence.event_context.recording().size();
    let step_us = evidence.facts.stamp_step_us.unwrap_or(1.0);
    let found = frame_bursts(events, size, &frames, step_us).known()?.clone();
    FrameBursts::new(found, starts, size)
}
