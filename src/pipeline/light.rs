//! Frames as light on the events' clock, whichever camera took them.

use super::sync::{missing, read_clocks};
use super::{PipelineError, inputs};
use crate::clock::ClockEstimate;
use crate::frame::Luminance;
use crate::session::{DavisPictures, PiPictures, Session, SessionError, StreamKind, read_stage};
use crate::time::{Davis, PiSensor};

enum Source {
    Davis(DavisPictures),
    Pi { pictures: PiPictures, davis_from_sensor: Box<ClockEstimate<Davis, PiSensor>> },
}

/// A stream's frames as brightness in ascending time, on the events' clock.
///
/// The time is the middle of the exposure of the frame's middle row. A raw frame keeps its mosaic
/// and its pedestal, each pixel in its own colour, as the published generator takes it.
pub struct Light {
    source: Source,
    last_us: Option<i64>,
    n_not_later: u64,
}

/// The light of a stream.
///
/// # Errors
/// When there is no such stream, its files cannot be opened, or it is the Pi's and `sync` has not run.
pub fn light(session: &Session, name: &str) -> Result<Light, PipelineError> {
    let source = if session.is_from_pi(name)? {
        let clocks = read_clocks(session)?.ok_or_else(|| {
            let what = format!("`{name}` is on the Pi's clock; run `evrig sync` first");
            missing(session, what)
        })?;
        let davis_from_sensor = Box::new(clocks.davis_from_sensor);
        Source::Pi { pictures: session.pi_pictures(name)?, davis_from_sensor }
    } else {
        Source::Davis(session.davis_pictures(name)?)
    };
    Ok(Light { source, last_us: None, n_not_later: 0 })
}

/// Checksums of what the light of a stream comes from: its files, and the clock where it needs one.
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

impl Light {
    /// Frames left out so far because they are not later than the frame before them.
    #[must_use]
    pub fn n_not_later(&self) -> u64 {
        self.n_not_later
    }

    fn read(&mut self) -> Option<Result<Luminance, SessionError>> {
        match &mut self.source {
            Source::Davis(pictures) => Some(pictures.next()?.map(|picture| {
                let frame = picture.frame;
                let t_us = frame.timing.mid_exposure(frame.size.height / 2).as_micros();
                Luminance { t_us, size: frame.size, values: frame.brightness() }
            })),
            Source::Pi { pictures, davis_from_sensor } => match pictures.next()? {
                Err(error) => Some(Err(error)),
                Ok(picture) => {
                    let frame = picture.frame;
                    let at = frame.timing.mid_exposure(frame.size.height / 2);
                    // An estimate has a segment at least, which holds beyond its ends.
                    let t_us = davis_from_sensor.map(at)?.as_micros();
                    Some(Ok(Luminance { t_us, size: frame.size, values: frame.brightness() }))
                }
            },
        }
    }
}

impl Iterator for Light {
    type Item = Result<Luminance, SessionError>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            let frame = self.read()?;
            if let Ok(frame) = &frame {
                if self.last_us.is_some_and(|last| frame.t_us <= last) {
                    self.n_not_later += 1;
                    continue;
                }
                self.last_us = Some(frame.t_us);
            }
            return Some(frame);
        }
    }
}
