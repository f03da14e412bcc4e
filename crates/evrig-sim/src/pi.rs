//! The simulated Pi camera on the agent's side of the wire.

use super::live::LiveWorld;
use super::progress::TwinProgress;
use super::world::{self, PiTwin};
use evrig_core::frame::Samples;
use evrig_core::geometry::Size;
use evrig_core::pi_camera::{FrameMetadata, PiFrame};
use evrig_core::raw10::{self, Raw10Error};
use evrig_pi::order::CaptureSettings;
use evrig_pi::source::{FrameSource, SourceError};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Model name of the simulated camera.
pub const MODEL: &str = "simulated imx708";

/// A request of `size` as the agent hands it over: raw samples packed, colours in the order R, G,
/// B.
///
/// # Errors
/// When the rows cannot be packed: RAW10 has rows of a multiple of four samples.
pub fn delivered(frame: world::SimulatedPiFrame, size: Size) -> Result<PiFrame, Raw10Error> {
    let message = frame.metadata;
    let raw10 = match &frame.raw {
        Some(raw) => match &raw.samples {
            Samples::U16(samples) => Some(raw10::pack(samples, size)?),
            Samples::U8(_) => None,
        },
        None => None,
    };
    let rgb = frame.rgb.map(|rgb| match rgb.samples {
        Samples::U8(mut samples) => {
            samples.chunks_exact_mut(3).for_each(|pixel| pixel.swap(0, 2));
            samples
        }
        Samples::U16(_) => Vec::new(),
    });
    let black_level = message.black_level_dn.round() as u16;
    let metadata = FrameMetadata {
        sequence: message.sequence,
        sensor_timestamp: message.sensor_timestamp,
        frame_wall_clock: Some(message.frame_wall_clock),
        real_time: message.real_time,
        exposure: message.exposure,
        analogue_gain: message.analogue_gain,
        digital_gain: 1.0,
        lens_position: None,
        black_levels: [black_level; 4],
        size,
        bayer: "RGGB".to_owned(),
        n_dropped: 0,
    };
    Ok(PiFrame { metadata, raw10, rgb })
}

/// The simulated Pi camera behind an agent. It is switched on by the first frame that is asked for
/// after it was configured.
#[derive(Debug)]
pub struct SimulatedSource {
    live: Arc<LiveWorld>,
    progress: TwinProgress,
    settings: Option<CaptureSettings>,
    twin: Option<PiTwin>,
    /// Rendered, but not yet delivered.
    waiting: Option<world::SimulatedPiFrame>,
}

/// The longest wait for a frame.
const PATIENCE: Duration = Duration::from_millis(100);
/// Polling interval.
const TICK: Duration = Duration::from_millis(2);

impl SimulatedSource {
    /// The camera in a world.
    #[must_use]
    pub fn new(live: Arc<LiveWorld>) -> Self {
        let progress = TwinProgress::default();
        Self { live, progress, settings: None, twin: None, waiting: None }
    }

    /// Its progress.
    #[must_use]
    pub fn progress(&self) -> TwinProgress {
        self.progress.clone()
    }

    /// The next frame, if the motion is known that far.
    fn look(&mut self) -> Option<world::SimulatedPiFrame> {
        let (live, begun) = (&self.live, self.progress.look().begun?);
        let twin = self.twin.get_or_insert_with(|| PiTwin::new(Arc::clone(live.world()), begun));
        let known = live.known_until();
        if self.waiting.is_none() {
            let is_over = live.closed_at().is_some_and(|closed_at| twin.position() >= closed_at);
            if is_over || twin.seen_by(twin.position()) > known {
                return None;
            }
            self.waiting = Some(twin.next_frame());
        }
        self.waiting.take_if(|frame| frame.handed_over <= known)
    }
}

impl FrameSource for SimulatedSource {
    fn describe(&self) -> String {
        MODEL.to_owned()
    }

    fn configure(&mut self, settings: &CaptureSettings) -> Result<CaptureSettings, SourceError> {
        let pi = &self.live.world().rig().pi;
        let asked = [
            ("size", settings.size == pi.camera.size),
            ("frame_rate", settings.frame_rate == pi.camera.frame_rate),
            ("exposure", settings.exposure == pi.camera.exposure),
            ("gain", settings.gain == pi.camera.gain),
            ("raw", pi.raw || !settings.raw),
            ("rgb", pi.rgb || !settings.rgb),
        ];
        if let Some((what, _)) = asked.into_iter().find(|(_, is_of_rig)| !is_of_rig) {
            let because = format!("{what} differs from its rig file; use the same rig file");
            return Err(SourceError { because });
        }
        raw10::row_bytes(settings.size.width)
            .map_err(|error| SourceError { because: error.to_string() })?;
        self.settings = Some(settings.clone());
        Ok(settings.clone())
    }

    fn next(&mut self) -> Result<Option<PiFrame>, SourceError> {
        let Some(settings) = self.settings.clone() else {
            return Err(SourceError { because: "it was not configured".to_owned() });
        };
        self.progress.begin(self.live.now());
        let deadline = Instant::now() + PATIENCE;
        let mut found = self.look();
        while found.is_none() && Instant::now() < deadline {
            std::thread::sleep(TICK);
            found = self.look();
        }
        let position = match (&self.waiting, &self.twin) {
            (None, Some(twin)) => twin.position(),
            _ => self.progress.look().position,
        };
        let Some(frame) = found else { return Ok(None) };
        let mut frame = delivered(frame, settings.size)
            .map_err(|error| SourceError { because: error.to_string() })?;
        frame.raw10 = frame.raw10.filter(|_| settings.raw);
        frame.rgb = frame.rgb.filter(|_| settings.rgb);
        self.progress.change(|twin| {
            twin.position = position;
            twin.n_sent += 1;
        });
        Ok(Some(frame))
    }
}
