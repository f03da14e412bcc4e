//! What the events alone show of the camera and its readout, without any light signal.
//!
//! [`camera_report`] makes linear passes over the events of one stream. Each section holds its
//! estimates with their errors, or states that the events are too few for it.

mod background_activity;
mod burst_profile;
mod burst_shape;
mod burst_wake;
mod chance;
mod frame_coupling;
mod frame_fold;
mod frame_period;
mod hann_spectrum;
mod interval_counts;
mod onset_fit;
mod pixel_outliers;
mod rate_lines;
mod rate_spectrum;
mod readout_limits;
mod refractory_onset;
mod shear_search;
mod stamp_step;
mod stamp_ties;
mod stream_rates;
mod threshold_ratio;

pub use background_activity::IsolatedEventRates;
pub use burst_profile::ProfileBin;
pub use burst_wake::BurstWake;
pub use frame_coupling::{CouplingBurst, FrameCoupling, RejectedBurst};
pub use frame_fold::{FrameReference, FrameStarts};
pub use pixel_outliers::{HotPixel, OUTLIER_RATIO, PixelOutliers};
pub use rate_lines::{RateLine, RateLines, RateSeries};
pub use readout_limits::ReadoutLimits;
pub use refractory_onset::{HazardBin, IntervalOrigin, OnsetShape, RefractoryOnset};
pub use stamp_step::StampStep;
pub use stamp_ties::{ReadoutOrder, StampTies};
pub use stream_rates::{SensorGap, StreamRates};
pub use threshold_ratio::ThresholdRatio;

use evrig_core::event::{Event, EventSlice, Events};
use evrig_core::geometry::Size;
use evrig_core::stats::SplitMix;
use interval_counts::IntervalCounts;
use pixel_outliers::PixelCounts;
use serde::Serialize;

/// Schema of the report as JSON.
pub const CAMERA_REPORT_SCHEMA: &str = "evrig.camera-report/1";

/// A section's findings, or why there are none.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(untagged)]
pub enum SectionResult<T> {
    /// What was measured.
    Known(T),
    /// The events or frames do not suffice.
    NotMeasured {
        /// For what, how many there are, and how many are needed.
        not_measured: String,
    },
}

/// A polarity in words.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "UPPERCASE")]
pub enum PolarityName {
    /// Brightness rose.
    On,
    /// Brightness fell.
    Off,
}

/// Why a stream cannot be reported on.
#[derive(Debug, thiserror::Error, PartialEq, Eq)]
pub enum CameraReportError {
    /// Nothing to count.
    #[error("there are no events to report on; expected at least one")]
    NoEvents,
    /// Times go back.
    #[error(
        "event {index} is earlier than the one before it; expected ascending times: sort the \
         events, or take one epoch of the camera's clock"
    )]
    Disorder {
        /// The first such event.
        index: usize,
    },
    /// An event is not on the sensor.
    #[error("event {index} is off the {size} grid; expected events on the sensor: state its size")]
    Outside {
        /// The first such event.
        index: usize,
        /// The grid.
        size: Size,
    },
}

/// What the events of one stream show.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CameraReport {
    /// [`CAMERA_REPORT_SCHEMA`].
    pub schema: &'static str,
    /// Events of the stream.
    pub n_events: u64,
    /// The sensor.
    pub size: Size,
    /// Duration, rates and gaps.
    pub rates: StreamRates,
    /// Common step of the stamps.
    pub stamp_step: SectionResult<StampStep>,
    /// Equal stamps and the order of readout.
    pub stamp_ties: SectionResult<StampTies>,
    /// Hot and silent pixels.
    pub pixels: SectionResult<PixelOutliers>,
    /// Events that follow the camera's own frames.
    pub frame_coupling: SectionResult<FrameCoupling>,
    /// Onset of the interval between two events of a pixel, by their polarities.
    pub refractory: Vec<SectionResult<RefractoryOnset>>,
    /// Isolated events.
    pub background: SectionResult<IsolatedEventRates>,
    /// Flicker.
    pub rate_lines: SectionResult<RateLines>,
    /// Limits of the readout.
    pub readout: SectionResult<ReadoutLimits>,
    /// Balance of ON and OFF.
    pub threshold_ratio: SectionResult<ThresholdRatio>,
}

impl<T> SectionResult<T> {
    pub(crate) fn not_measured(reason: impl Into<String>) -> Self {
        Self::NotMeasured { not_measured: reason.into() }
    }

    /// The findings, where there are any.
    pub fn known(&self) -> Option<&T> {
        match self {
            Self::Known(found) => Some(found),
            Self::NotMeasured { .. } => None,
        }
    }
}

impl PolarityName {
    /// The polarity of an event.
    #[must_use]
    pub const fn of(on: bool) -> Self {
        if on { Self::On } else { Self::Off }
    }
}

impl std::fmt::Display for PolarityName {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(if *self == Self::On { "ON" } else { "OFF" })
    }
}

/// Reports on the events of one stream, in ascending time, and on the camera's frames where their
/// times are known.
///
/// # Errors
/// [`CameraReportError`] for no events, events out of order, or events off the sensor.
pub fn camera_report(
    events: EventSlice<'_>,
    size: Size,
    frames: Option<&FrameStarts>,
) -> Result<CameraReport, CameraReportError> {
    if events.is_empty() {
        return Err(CameraReportError::NoEvents);
    }
    if let Some(index) = events.first_disorder() {
        return Err(CameraReportError::Disorder { index });
    }
    if let Some(index) = events.first_outside(size) {
        return Err(CameraReportError::Outside { index, size });
    }
    let step = stamp_step::stamp_step(events);
    let step_us = step.known().map_or(1.0, |step| step.step_us);
    let spread = (step_us > 1.0).then(|| spread(events, step_us));
    let spread = spread.as_ref().map_or(events, Events::as_slice);
    let counts = PixelCounts::new(events, size);
    let pixels = pixel_outliers::outliers(&counts);
    let hot = pixels.known().map(|pixels| pixels.hot_mask(size));
    let hot = hot.unwrap_or_else(|| vec![false; size.n_pixels()]);
    let (frame_coupling, cycle) = follow_frames(spread, size, frames, step_us);
    let bursts = match (&frame_coupling, &cycle) {
        (SectionResult::Known(found), Some(cycle)) => found.burst_events(events, cycle),
        _ => vec![false; events.len()],
    };
    let has_bursts = bursts.iter().any(|is_burst| *is_burst);
    let intervals = IntervalCounts::new(events, size, &hot, &bursts, step_us);
    let refractory = refractory_onset::onsets(&intervals, has_bursts);
    drop(intervals);
    let period_us = frame_coupling.known().map(|found| found.frame_period_us);
    let mut in_bursts = vec![[0; 2]; size.n_pixels()];
    for i in (0..events.len()).filter(|i| bursts[*i]) {
        in_bursts[size.index(events.x[i], events.y[i])][usize::from(!events.on[i])] += 1;
    }
    Ok(CameraReport {
        schema: CAMERA_REPORT_SCHEMA,
        n_events: events.len() as u64,
        size,
        rates: stream_rates::rates(events, size.n_pixels()),
        stamp_step: step,
        stamp_ties: stamp_ties::ties(events, step_us),
        pixels,
        frame_coupling,
        refractory,
        background: background_activity::background(events, size, &hot, &bursts),
        rate_lines: rate_lines::lines(spread, size, &hot, period_us),
        readout: readout_limits::limits(events, step_us),
        threshold_ratio: threshold_ratio::ratio(&counts, size, &hot, &in_bursts),
    })
}

/// Hot and silent pixels.
pub(crate) fn pixel_outliers(events: EventSlice<'_>, size: Size) -> SectionResult<PixelOutliers> {
    pixel_outliers::outliers(&PixelCounts::new(events, size))
}

/// Events that follow frames with known starts; `step_us` is the step of the stamps.
pub(crate) fn frame_bursts(
    events: EventSlice<'_>,
    size: Size,
    frames: &FrameStarts,
    step_us: f64,
) -> SectionResult<FrameCoupling> {
    frame_coupling::coupling(events, size, frames, step_us, 1.0)
}

/// The coupling to the file's frames, or to a cycle that the events show.
fn follow_frames(
    events: EventSlice<'_>,
    size: Size,
    frames: Option<&FrameStarts>,
    step_us: f64,
) -> (SectionResult<FrameCoupling>, Option<FrameStarts>) {
    if let Some(frames) = frames.filter(|frames| !frames.starts_us.is_empty()) {
        return (frame_bursts(events, size, frames, step_us), Some(frames.clone()));
    }
    let cycles = frame_period::frame_periods(events, size).into_iter();
    let some = frame_period::thinned(events);
    let strength = |cycle: &FrameStarts| frame_coupling::strength(some.as_slice(), size, cycle);
    let by_strength = cycles.map(|cycle| (strength(&cycle), cycle));
    if let Some((_, cycle)) = by_strength.max_by(|a, b| a.0.total_cmp(&b.0)) {
        let n_cycles = frame_period::n_cycles(events.t);
        let coupling = frame_coupling::coupling(events, size, &cycle, step_us, n_cycles);
        if coupling.known().is_some_and(|found| !found.bursts.is_empty()) {
            return (coupling, Some(cycle));
        }
    }
    let [low, high] = frame_period::FRAME_RATE_HZ;
    let what = format!(
        "the file holds no frame times, and the events show no frames between {low:.0} and \
         {high:.0} Hz"
    );
    (SectionResult::not_measured(what), None)
}

/// Events spread uniformly over the step of their stamps, in ascending time: statistics of rates
/// would find the step otherwise.
fn spread(events: EventSlice<'_>, step_us: f64) -> Events {
    let mut random = SplitMix::new(4, events.len() as u64);
    let mut moved = || ((random.uniform() - 0.5) * step_us).round() as i64;
    let mut spread: Events =
        events.iter().map(|event| Event { t: event.t + moved(), ..event }).collect();
    spread.sort_by_time();
    spread
}

#[cfg(test)]
mod tests;
