//! The luminance on the event pixels, frame by frame, from the frames of either camera.

use super::super::error::missing;
use super::super::interpolation::plane_path;
use super::super::scene_source::{drive_of, is_scene};
use super::super::{PipelineError, luminance};
use evrig_analysis::calibrate::{BrightnessSeries, BrightnessSeriesBuilder};
use evrig_core::frame::Luminance;
use evrig_generate::input::{Colour, FramePreparation};
use evrig_generate::voltmeter::Coefficients;
use evrig_generate::{DriveFrames, PlaneWarper};
use evrig_session::{Session, StreamKind};

/// Sampling step of the scene, µs: at the arm's speed no pixel changes much within it.
const SCENE_STEP_US: u32 = 4_000;

/// White of an 8-bit frame, DN: brighter frames are of 10 bits.
const WHITE_8_BIT_DN: f32 = 255.0;

/// The signal to calibrate on.
pub(super) struct CalibrationSignal {
    pub(super) light: BrightnessSeries,
    /// The constants published for such frames.
    pub(super) published: Coefficients,
    /// How the frames have to be prepared for the constants to hold.
    pub(super) preparation: FramePreparation,
}

/// How the frames of a stream are prepared to calibrate on: a mosaic as luma without its pedestal,
/// since an event pixel sees no mosaic and a logarithm no pedestal; others as they are.
///
/// # Errors
/// When the frames cannot be read.
pub(super) fn preparation_of(
    session: &Session,
    from: &str,
) -> Result<FramePreparation, PipelineError> {
    if is_scene(session, from) || !session.is_from_pi(from)? {
        return Ok(FramePreparation::default());
    }
    let first = session.pi_frames(from)?.next().transpose()?;
    let is_mosaic = first.is_some_and(|image| image.properties.bayer.is_some());
    Ok(if is_mosaic {
        FramePreparation { colour: Colour::Luma, subtract_black: true, divide_exposure: false }
    } else {
        FramePreparation::default()
    })
}

/// The brightness of the event pixels from a session's frames or its scene.
///
/// # Errors
/// When frames, tracks or clocks are missing, or no pixel can be used.
pub(super) fn calibration_signal(
    session: &Session,
    from: &str,
    seed: u64,
) -> Result<CalibrationSignal, PipelineError> {
    let preparation = preparation_of(session, from)?;
    let mut gather = Gather { session, seed, n_frames: 0, builder: None, brightest: 0.0 };
    let published = if is_scene(session, from) {
        from_scene(session, &mut gather)?;
        Coefficients::RAW2DVS346
    } else {
        gather.n_frames = session.stream(StreamKind::Frames, from)?.count;
        let is_from_pi = session.is_from_pi(from)?;
        if is_from_pi {
            carried(session, from, preparation, &mut gather)?;
        } else {
            for frame in session.luminance(from)? {
                gather.push(&frame?)?;
            }
        }
        match (is_from_pi, gather.brightest > WHITE_8_BIT_DN || preparation.subtract_black) {
            (_, true) => Coefficients::RAW2DVS346,
            (true, false) => Coefficients::RGB2DVS346,
            (false, false) => Coefficients::DVS346,
        }
    };
    Ok(CalibrationSignal { light: gather.finish()?, published, preparation })
}

/// Gathers frames on the event pixels' grid.
struct Gather<'a> {
    session: &'a Session,
    seed: u64,
    n_frames: u64,
    builder: Option<BrightnessSeriesBuilder>,
    brightest: f32,
}

impl Gather<'_> {
    fn push(&mut self, frame: &Luminance) -> Result<(), PipelineError> {
        self.brightest = frame.values.iter().copied().fold(self.brightest, f32::max);
        let (n_frames, seed) = (self.n_frames, self.seed);
        let builder = self
            .builder
            .get_or_insert_with(|| BrightnessSeriesBuilder::new(frame.size, n_frames, seed));
        let wrong = |source| super::failed(self.session, source);
        builder.push(frame).map_err(wrong)
    }

    fn finish(self) -> Result<BrightnessSeries, PipelineError> {
        let none = evrig_analysis::calibrate::CalibrateError::TooFewFrames { n: 0 };
        let wrong = |source| super::failed(self.session, source);
        self.builder.ok_or(none).and_then(BrightnessSeriesBuilder::finish).map_err(wrong)
    }
}

/// The frames of the Pi's camera as the event pixels would have seen them, along the tracks of
/// both.
fn carried(
    session: &Session,
    from: &str,
    preparation: FramePreparation,
    gather: &mut Gather<'_>,
) -> Result<(), PipelineError> {
    let own = own_frames(session)?;
    let size = session.stream(StreamKind::Events, "real").ok().and_then(|entry| entry.size);
    let size = size.or(session.size());
    let size = size.ok_or_else(|| missing(session, "no stream states its pixel grid".into()))?;
    let carrier = PlaneWarper::new(plane_path(session, from)?, plane_path(session, &own)?, size);
    let mut frames = luminance::luminance(session, from)?.prepared(preparation);
    let mut n_on_path = 0_u64;
    while let Some(frame) = frames.next() {
        let frame = frame?;
        let rows = frames.rows(frame.size);
        if let Some(frame) = carrier.warp(&frame, rows) {
            n_on_path += 1;
            gather.push(&frame)?;
        }
    }
    if n_on_path < 2 {
        let what = format!(
            "{n_on_path} frames of `{from}` lie on the tracks of both cameras; record with \
             the tag in sight of both"
        );
        return Err(missing(session, what));
    }
    Ok(())
}

/// The stream of the event camera's own frames that was tracked.
fn own_frames(session: &Session) -> Result<String, PipelineError> {
    let tracked = super::super::tracked(session);
    let own = tracked.into_iter().find(|name| !session.is_from_pi(name).unwrap_or(true));
    own.ok_or_else(|| {
        let what = "no track of the event camera locates its pixels; run `evrig track`";
        missing(session, what.into())
    })
}

/// The scene's brightness at even instants.
fn from_scene(session: &Session, gather: &mut Gather<'_>) -> Result<(), PipelineError> {
    let drive = drive_of(session)?;
    let mut frames = DriveFrames::new(&drive, [i64::MIN, i64::MAX], SCENE_STEP_US)?;
    gather.n_frames = frames.grid().n as u64;
    while let Some(frame) = frames.next_frame() {
        gather.push(frame)?;
    }
    Ok(())
}
