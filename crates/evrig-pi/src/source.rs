//! Where the agent's frames come from.

use super::order::CaptureSettings;
use super::order::Focus;
use super::read_clocks;
use evrig_core::pi_camera::{FrameMetadata, PiFrame};
use evrig_core::raw10;
use evrig_core::time::{PiSensor, Span, Stamp};
use std::time::Duration;

/// Why frames do not come.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("the camera of the Pi: {because}")]
pub struct SourceError {
    /// What happened and what to do.
    pub because: String,
}

impl SourceError {
    /// With what happened and what to do.
    pub fn new(because: impl ToString) -> Self {
        Self { because: because.to_string() }
    }
}

/// A camera on the agent's side.
pub trait FrameSource: Send {
    /// What it is.
    fn describe(&self) -> String;

    /// Looks whether it is there, without setting anything; what it is comes back.
    ///
    /// # Errors
    /// When it cannot be used, with what to do.
    fn check(&mut self) -> Result<String, SourceError> {
        Ok(self.describe())
    }

    /// Sets it up; what holds afterwards comes back.
    ///
    /// # Errors
    /// When the settings are impossible for it.
    fn configure(&mut self, settings: &CaptureSettings) -> Result<CaptureSettings, SourceError>;

    /// What the lens is to do; asked for before [`Self::configure`]. A camera without a lens that
    /// moves has nothing to do.
    ///
    /// # Errors
    /// When the lens cannot.
    fn set_focus(&mut self, _focus: Focus) -> Result<(), SourceError> {
        Ok(())
    }

    /// What else it read back when it was set up, for the manifest.
    fn camera_description(&self) -> serde_json::Value {
        serde_json::Value::Null
    }

    /// Lets frames come.
    ///
    /// # Errors
    /// When the camera cannot.
    fn start(&mut self) -> Result<(), SourceError> {
        Ok(())
    }

    /// Lets no more frames come, in any state, as often as called.
    fn stop(&mut self) {}

    /// The next frame, in at most a quarter of a second; none when there is none yet or any more.
    ///
    /// # Errors
    /// When the camera failed.
    fn next(&mut self) -> Result<Option<PiFrame>, SourceError>;
}

/// A test pattern that identifies frame, column and row: raw sample
/// (column + 7 row + 13 frame) mod 1024, and the upper eight bits of it as R, G and B.
#[derive(Debug, Clone)]
pub struct Synthetic {
    is_paced: bool,
    n_left: u64,
    settings: Option<CaptureSettings>,
    sequence: u64,
    began: Option<Stamp<PiSensor>>,
}

impl Synthetic {
    /// At the frame rate that is asked for, for ever.
    #[must_use]
    pub const fn paced() -> Self {
        Self { is_paced: true, n_left: u64::MAX, settings: None, sequence: 0, began: None }
    }

    /// So many frames as fast as they are taken; their stamps keep the frame rate.
    #[must_use]
    pub const fn unpaced(n_frames: u64) -> Self {
        Self { is_paced: false, n_left: n_frames, ..Self::paced() }
    }

    /// The raw sample of the pattern.
    #[must_use]
    pub const fn sample(sequence: u64, column: usize, row: usize) -> u16 {
        ((column as u64 + 7 * row as u64 + 13 * sequence) % 1024) as u16
    }
}

impl FrameSource for Synthetic {
    fn describe(&self) -> String {
        "synthetic pattern".to_owned()
    }

    fn configure(&mut self, settings: &CaptureSettings) -> Result<CaptureSettings, SourceError> {
        raw10::row_bytes(settings.size.width).map_err(SourceError::new)?;
        if !(settings.frame_rate.0 > 0.0 && settings.frame_rate.0 <= 1000.0) {
            let because = format!("{} frames a second; expected 0 to 1000", settings.frame_rate.0);
            return Err(SourceError::new(because));
        }
        self.settings = Some(settings.clone());
        Ok(settings.clone())
    }

    fn next(&mut self) -> Result<Option<PiFrame>, SourceError> {
        let Some(settings) = &self.settings else {
            return Err(SourceError::new("it was not configured"));
        };
        if self.n_left == 0 {
            std::thread::sleep(Duration::from_millis(1));
            return Ok(None);
        }
        let now = read_clocks();
        let began = *self.began.get_or_insert(now.boottime_after);
        let due = began + Span::from_secs_f64(self.sequence as f64 / settings.frame_rate.0);
        if self.is_paced {
            let wait = u64::try_from((due - now.boottime_after).as_nanos()).unwrap_or(0);
            std::thread::sleep(Duration::from_nanos(wait));
        }
        let (size, sequence) = (settings.size, self.sequence);
        let [width, height] = [size.width, size.height].map(usize::from);
        let cells = (0..height).flat_map(|row| (0..width).map(move |column| (column, row)));
        let samples: Vec<u16> =
            cells.map(|(column, row)| Self::sample(sequence, column, row)).collect();
        let packed = settings.raw.then(|| raw10::pack(&samples, size)).transpose();
        let raw10 = packed.map_err(SourceError::new)?;
        let grey = samples.iter().map(|sample| (sample >> 2) as u8);
        let rgb = settings.rgb.then(|| grey.flat_map(|value| [value; 3]).collect());
        let metadata = FrameMetadata {
            sequence,
            sensor_timestamp: due,
            frame_wall_clock: None,
            real_time: read_clocks().realtime,
            exposure: settings.exposure,
            analogue_gain: settings.gain,
            digital_gain: 1.0,
            lens_position: None,
            black_levels: [64; 4],
            size,
            bayer: "RGGB".to_owned(),
            n_dropped: 0,
        };
        self.sequence += 1;
        self.n_left -= 1;
        Ok(Some(PiFrame { metadata, raw10, rgb }))
    }
}
