//! Frames of either camera as luminance on the events' clock.

use super::error::missing;
use super::sync::read_clocks;
use super::{PipelineError, inputs};
use evrig_core::frame::{Frame, Luminance, Samples};
use evrig_core::geometry::Size;
use evrig_core::time::{Clock, Davis, PiSensor};
use evrig_generate::RowTimes;
use evrig_generate::input::{FramePreparation, FramePreparer, SourceFrame};
use evrig_reconstruct::clock::ClockEstimate;
use evrig_session::{
    AscendingFrames, DavisFrames, PiCameraFrames, RecordedFrame, Session, SessionError, StreamKind,
    read_stage,
};

enum CameraFrames {
    Davis(DavisFrames),
    Pi { images: PiCameraFrames, davis_from_sensor: Box<ClockEstimate<Davis, PiSensor>> },
}

/// A stream's frames as luminance in ascending time, on the events' clock.
///
/// The time is mid-exposure of the middle row; [`LuminanceStream::rows`] gives the other rows'. A
/// raw frame keeps its mosaic and its pedestal, each pixel in its own colour, as the published
/// generator takes it.
pub(super) struct LuminanceStream {
    source: CameraFrames,
    preparer: FramePreparer,
    ascending: AscendingFrames,
    row_us: f64,
}

/// The luminance of a frame stream.
///
/// # Errors
/// When there is no such stream, its files cannot be opened, or it is the Pi's and `sync` has not
/// run.
pub(super) fn luminance(session: &Session, name: &str) -> Result<LuminanceStream, PipelineError> {
    let source = if session.is_from_pi(name)? {
        let clocks = read_clocks(session)?.ok_or_else(|| {
            let what = format!("`{name}` is on the Pi's clock; run `evrig sync` first");
            missing(session, what)
        })?;
        let davis_from_sensor = Box::new(clocks.davis_from(name));
        CameraFrames::Pi { images: session.pi_frames(name)?, davis_from_sensor }
    } else {
        CameraFrames::Davis(session.davis_frames(name)?)
    };
    let (preparer, ascending) = (FramePreparer::default(), AscendingFrames::default());
    Ok(LuminanceStream { source, preparer, ascending, row_us: 0.0 })
}

/// Checksums of the files behind a stream's luminance: its own, and the clock where it needs one.
pub(super) fn inputs_of(session: &Session, name: &str) -> Result<inputs::Inputs, PipelineError> {
    let entry = session.stream(StreamKind::Frames, name)?;
    let mut inputs = inputs::of_recorded(session, entry);
    if session.is_from_pi(name)?
        && let Some(record) = read_stage(&session.layout().derived("sync", None))
        && let Some(sha256) = record.outputs.get("clock.json")
    {
        inputs.insert("derived/sync/clock.json".into(), sha256.clone());
    }
    Ok(inputs)
}

impl LuminanceStream {
    /// The same with frames prepared in this way.
    #[must_use]
    pub(super) fn prepared(self, preparation: FramePreparation) -> Self {
        Self { preparer: FramePreparer::new(preparation), ..self }
    }

    /// Exposure times of the rows of a frame of this size, as the frame read last states them.
    #[must_use]
    pub(super) fn rows(&self, size: Size) -> RowTimes {
        RowTimes::about_middle(self.row_us, size)
    }

    /// Frames left out so far because they are not later than the frame before them.
    #[must_use]
    pub(super) fn n_not_later(&self) -> u64 {
        self.ascending.n_not_later()
    }
}

impl CameraFrames {
    /// The next frame, whenever it was.
    fn read(
        &mut self,
        preparer: &mut FramePreparer,
        row_us: &mut f64,
    ) -> Option<Result<Luminance, SessionError>> {
        match self {
            Self::Davis(images) => Some(images.next()?.map(|image| {
                let frame = &image.frame;
                let t_us = frame.timing.mid_exposure(frame.size.height / 2).as_micros();
                let light = preparer.prepare(t_us, &pictured(&image), frame.brightness());
                *row_us = row_time_us(frame, &light);
                light
            })),
            Self::Pi { images, davis_from_sensor } => match images.next()? {
                Err(error) => Some(Err(error)),
                Ok(image) => {
                    let frame = &image.frame;
                    let at = frame.timing.mid_exposure(frame.size.height / 2);
                    // An estimate has a segment at least, which holds beyond its ends.
                    let t_us = davis_from_sensor.map(at)?.as_micros();
                    let light = preparer.prepare(t_us, &pictured(&image), frame.brightness());
                    *row_us = row_time_us(frame, &light);
                    Some(Ok(light))
                }
            },
        }
    }
}

/// The delay from row to row of what was made of a frame: one colour of a mosaic has half the rows.
fn row_time_us<C: Clock>(frame: &Frame<C>, light: &Luminance) -> f64 {
    let rows = f64::from(frame.size.height) / f64::from(light.size.height.max(1));
    frame.timing.row_time.as_nanos() as f64 * 1e-3 * rows.round()
}

/// What preparing an image needs of it.
fn pictured<C: Clock>(image: &RecordedFrame<C>) -> SourceFrame<'_> {
    let facts = &image.properties;
    let mosaic = match (&image.frame.samples, facts.bayer) {
        (Samples::U16(samples), Some(order)) => Some((samples.as_slice(), order)),
        _ => None,
    };
    let exposure_s =
        image.frame.timing.exposure.map(|[start, end]| (end - start).as_nanos() as f64 * 1e-9);
    // A camera that states no gain keeps it.
    let exposure_gain = exposure_s.map(|seconds| seconds * facts.gain.unwrap_or(1.0));
    SourceFrame { size: image.frame.size, mosaic, black_dn: facts.black_dn, exposure_gain }
}

impl Iterator for LuminanceStream {
    type Item = Result<Luminance, SessionError>;

    fn next(&mut self) -> Option<Self::Item> {
        let Self { source, preparer, ascending, row_us } = self;
        ascending.next(|| source.read(preparer, row_us))
    }
}

/// Starts of exposure of the event camera's own frames, µs of its clock, ascending; empty where
/// there are none.
pub(super) fn aps_starts(session: &Session) -> Result<Vec<i64>, PipelineError> {
    if session.stream(StreamKind::Frames, "aps").is_err() {
        return Ok(Vec::new());
    }
    let start = |image: Result<RecordedFrame<Davis>, SessionError>| {
        let timing = image?.frame.timing;
        Ok(timing.exposure.map_or(timing.stamp, |[start, _]| start).as_micros())
    };
    let images = session.davis_frames("aps")?;
    let mut starts = images.map(start).collect::<Result<Vec<_>, PipelineError>>()?;
    starts.sort_unstable();
    Ok(starts)
}
