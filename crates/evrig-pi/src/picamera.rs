//! The camera of a real Pi, through picamera2.
//!
//! picamera2 is what users of Raspberry Pi OS can install (`apt install python3-picamera2`), and it
//! is Python; so the agent starts a small Python program, `helper.py`, which this crate carries,
//! and takes frames from it over a pipe. The helper crops; everything about formats is done here.

mod formats;
mod pipe;

use super::order::CaptureSettings;
use super::order::Focus;
use super::source::{FrameSource, SourceError};
use evrig_core::pi_camera::{FrameMetadata, PiFrame};
use evrig_core::time::{PiSensor, Span, Stamp, Unix};
use formats::{RawFormat, RgbOrder};
use pipe::{Configured, FrameHead, Helper, HelperHead, HelperPacket};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// A Pi loads picamera2 in a few seconds.
const IDENTIFYING: Duration = Duration::from_secs(12);
/// Autofocus, settling of exposure and gain, and a slow start of the libraries.
const CONFIGURING: Duration = Duration::from_secs(18);
/// Frames under way in the pipe when the camera stops.
const STOPPING: Duration = Duration::from_secs(3);
/// A frame is waited for no longer; see [`FrameSource::next`].
const POLL_INTERVAL: Duration = Duration::from_millis(250);
/// Without a frame for so long, the camera counts as failed.
const SILENCE: Duration = Duration::from_secs(3);
/// libcamera states black levels for 16-bit samples, whatever the sensor's bits are.
const BLACK_LEVEL_SHIFT: u32 = 6;
/// Later than any wall clock in microseconds, earlier than this century in nanoseconds.
const FIRST_NANOS: i64 = 100_000_000_000_000_000;

/// A Pi's camera.
#[derive(Debug)]
pub struct Picamera {
    python: PathBuf,
    focus: Focus,
    helper: Option<Helper>,
    held: Option<ConfiguredCamera>,
}

/// What was set up.
#[derive(Debug)]
struct ConfiguredCamera {
    settings: CaptureSettings,
    raw: RawFormat,
    rgb: RgbOrder,
    frame_duration: Span,
    description: Value,
    sequence: u64,
    last: Option<Stamp<PiSensor>>,
    last_frame: Instant,
}

impl Picamera {
    /// Will run the helper with this Python, which must be the one that has picamera2.
    #[must_use]
    pub fn new(python: &Path) -> Self {
        Self { python: python.to_owned(), focus: Focus::default(), helper: None, held: None }
    }

    /// The helper, started when there is none or the last one ended.
    fn helper(&mut self) -> Result<&mut Helper, SourceError> {
        if self.helper.as_mut().is_some_and(|helper| !helper.is_alive()) {
            self.helper = None;
        }
        if self.helper.is_none() {
            self.helper = Some(Helper::start(&self.python)?);
        }
        self.helper.as_mut().ok_or_else(|| SourceError::new("its helper is gone"))
    }
}

impl FrameSource for Picamera {
    fn describe(&self) -> String {
        let model = self.held.as_ref().and_then(|held| held.description.get("model")?.as_str());
        format!("{} through picamera2", model.unwrap_or("a camera"))
    }

    fn check(&mut self) -> Result<String, SourceError> {
        let helper = self.helper()?;
        helper.send(&json!({ "do": "identify" }))?;
        let deadline = Instant::now() + IDENTIFYING;
        loop {
            match helper.receive(deadline)?.head {
                HelperHead::Identified { model, picamera2 } => {
                    let version = picamera2.unwrap_or_default();
                    return Ok(format!("{model} through picamera2 {version}")
                        .trim_end()
                        .to_owned());
                }
                // Of a take before this.
                HelperHead::Frame(_) | HelperHead::Stopped { .. } | HelperHead::Configured(_) => {}
                HelperHead::Error { because } => return Err(SourceError::new(because)),
            }
        }
    }

    fn set_focus(&mut self, focus: Focus) -> Result<(), SourceError> {
        self.focus = focus;
        Ok(())
    }

    fn camera_description(&self) -> Value {
        self.held.as_ref().map_or(Value::Null, |held| held.description.clone())
    }

    fn configure(&mut self, settings: &CaptureSettings) -> Result<CaptureSettings, SourceError> {
        check(settings)?;
        self.held = None;
        let focus = self.focus;
        let helper = self.helper()?;
        helper.send(&json!({
            "do": "configure",
            "width": settings.size.width,
            "height": settings.size.height,
            "frame_rate_hz": settings.frame_rate.0,
            "exposure_us": settings.exposure.as_nanos() as f64 * 1e-3,
            "gain": settings.gain,
            "raw": settings.raw,
            "rgb": settings.rgb,
            "focus": focus,
        }))?;
        let deadline = Instant::now() + CONFIGURING;
        let configured = loop {
            match helper.receive(deadline)?.head {
                HelperHead::Configured(configured) => break *configured,
                // Of a take before this.
                HelperHead::Frame(_)
                | HelperHead::Stopped { .. }
                | HelperHead::Identified { .. } => {}
                HelperHead::Error { because } => return Err(SourceError::new(because)),
            }
        };
        let held = ConfiguredCamera::new(settings, configured)?;
        let settings = held.settings.clone();
        self.held = Some(held);
        Ok(settings)
    }

    fn start(&mut self) -> Result<(), SourceError> {
        let held = self.held.as_mut().ok_or_else(|| SourceError::new("it was not configured"))?;
        (held.sequence, held.last, held.last_frame) = (0, None, Instant::now());
        self.helper()?.send(&json!({ "do": "start" }))
    }

    fn stop(&mut self) {
        let Some(helper) = &mut self.helper else { return };
        let deadline = Instant::now() + STOPPING;
        let mut end = helper.send(&json!({ "do": "stop" }));
        while end.is_ok() {
            match helper.receive(deadline) {
                Ok(HelperPacket { head: HelperHead::Stopped { .. }, .. }) => return,
                Ok(_) => {}
                Err(error) => end = Err(error),
            }
        }
        // A helper that does not stop when asked is ended; the next one starts clean.
        self.helper = None;
    }

    fn next(&mut self) -> Result<Option<PiFrame>, SourceError> {
        let (Some(helper), Some(held)) = (&mut self.helper, &mut self.held) else {
            return Err(SourceError::new("it was not configured"));
        };
        let Some(packet) = helper.poll(POLL_INTERVAL)? else {
            return if held.last_frame.elapsed() < SILENCE {
                Ok(None)
            } else {
                Err(SourceError::new(format!("no frame came for {SILENCE:?}; check its cable")))
            };
        };
        held.last_frame = Instant::now();
        match packet.head {
            HelperHead::Frame(head) => held.frame(*head, &packet.images).map(Some),
            HelperHead::Error { because } => Err(SourceError::new(because)),
            HelperHead::Configured(_)
            | HelperHead::Stopped { .. }
            | HelperHead::Identified { .. } => Ok(None),
        }
    }
}

fn check(settings: &CaptureSettings) -> Result<(), SourceError> {
    let size = settings.size;
    if !size.width.is_multiple_of(4) || !size.height.is_multiple_of(2) || size.n_pixels() == 0 {
        return Err(SourceError::new(format!(
            "it takes images whose width is a multiple of 4 and height of 2, not {size}; correct \
             pi.size_px"
        )));
    }
    if !(settings.raw || settings.rgb) {
        return Err(SourceError::new(
            "neither raw nor RGB frames are asked for; set pi.raw or pi.rgb",
        ));
    }
    Ok(())
}

impl ConfiguredCamera {
    fn new(asked: &CaptureSettings, configured: Configured) -> Result<Self, SourceError> {
        let settings = CaptureSettings {
            exposure: Span::from_nanos((configured.exposure_us * 1e3).round() as i64),
            gain: configured.gain,
            ..asked.clone()
        };
        let frame_duration = Span::from_secs_f64(configured.frame_duration_us * 1e-6);
        if frame_duration <= Span::ZERO {
            return Err(SourceError::new("it states a frame duration of zero"));
        }
        Ok(Self {
            raw: RawFormat::parse(&configured.raw_format)?,
            rgb: RgbOrder::parse(&configured.rgb_format)?,
            settings,
            frame_duration,
            description: configured.description,
            sequence: 0,
            last: None,
            last_frame: Instant::now(),
        })
    }

    fn frame(&mut self, head: FrameHead, images: &[u8]) -> Result<PiFrame, SourceError> {
        let size = self.settings.size;
        let metadata = head.metadata;
        let stamp = Stamp::from_nanos(metadata.sensor_timestamp);
        self.count_up_to(stamp);
        let n_raw = head.n_raw.unwrap_or(0);
        let Some((raw, rgb)) = images.split_at_checked(n_raw) else {
            return Err(SourceError::new("a frame is shorter than its raw image"));
        };
        let raw10 = head.n_raw.map(|_| self.raw.to_raw10(raw, size)).transpose()?;
        let rgb = head.n_rgb.map(|_| self.rgb.to_rgb(rgb, size)).transpose()?;
        let level = |at: usize| (metadata.black_levels[at] >> BLACK_LEVEL_SHIFT) as u16;
        Ok(PiFrame {
            metadata: FrameMetadata {
                sequence: self.sequence,
                sensor_timestamp: stamp,
                frame_wall_clock: metadata.frame_wall_clock.map(wall_clock),
                real_time: Stamp::from_nanos(head.real_time_ns),
                exposure: Span::from_nanos((metadata.exposure_us * 1e3).round() as i64),
                analogue_gain: metadata.analogue_gain,
                digital_gain: metadata.digital_gain,
                lens_position: metadata.lens_position,
                black_levels: [level(0), level(1), level(2), level(3)],
                size,
                bayer: self.raw.bayer().to_owned(),
                n_dropped: 0,
            },
            raw10,
            rgb,
        })
    }

    /// A frame's number follows from its stamp, so that frames which the sensor took and the host
    /// lost leave a gap in the numbers. A stamp that does not rise still gets a number of its own.
    fn count_up_to(&mut self, stamp: Stamp<PiSensor>) {
        if let Some(last) = self.last {
            let steps = (stamp - last).as_secs_f64() / self.frame_duration.as_secs_f64();
            self.sequence += (steps.round() as u64).max(1);
        }
        self.last = Some(stamp);
    }
}

/// libcamera of mid-2025 gave microseconds where nanoseconds are documented.
fn wall_clock(value: i64) -> Stamp<Unix> {
    if value < FIRST_NANOS { Stamp::from_micros(value) } else { Stamp::from_nanos(value) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wall_clock_in_microseconds_is_distinguished_from_one_in_nanoseconds() {
        let now = 1_760_000_000_123_456_000;
        assert_eq!(wall_clock(now), Stamp::from_nanos(now));
        assert_eq!(wall_clock(now / 1000), Stamp::from_nanos(now));
    }
}
