//! Effects of the frame camera, of the optics, of the light.
//!
//! What a frame effect changes is the truth; what the session states stays as the rig has it.
//! Sources: IMX708 driver tables of raspberrypi/linux; IEEE 1789-2015 for flicker depths.

use serde::{Deserialize, Serialize};

/// Which camera an optical effect sits on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum WhichCamera {
    /// The event camera.
    Davis,
    /// The frame camera.
    Pi,
    /// Both.
    Both,
}

impl WhichCamera {
    /// Whether it is on the event camera.
    #[must_use]
    pub fn has_davis(self) -> bool {
        self != Self::Pi
    }

    /// Whether it is on the frame camera.
    #[must_use]
    pub fn has_pi(self) -> bool {
        self != Self::Davis
    }
}

/// The Pi's rows see light for so long, whatever the session states; brightness stays the same.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ExposureBlur {
    /// True exposure of a row, up to a frame's period.
    pub exposure_us: f64,
}

/// The Pi's rows follow each other at this pace, whatever the session states.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RollingShutter {
    /// True row time (9.21 us in 1536 x 864, 13.36 us in 2304 x 1296).
    pub row_us: f64,
}

/// The raw frames' pedestal differs from the stated one.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BlackLevel {
    /// True minus stated, in DN.
    pub offset_dn: f64,
}

/// The raw frames are not linear: `s -> s^gamma`, `s` the signal over the range above the pedestal.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ToneCurve {
    /// 1 is linear; 0.3..3.
    pub gamma: f64,
}

/// Normal noise on the raw frames on top of shot and read noise.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FrameNoise {
    /// Its standard deviation in DN.
    pub sigma_dn: f64,
}

/// A lens out of focus: a Gaussian on top of its point spread.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Defocus {
    /// Its standard deviation in the pixels of that camera, 0.3..3.
    pub sigma_px: f64,
    /// Whose lens.
    #[serde(default = "davis")]
    pub camera: WhichCamera,
}

/// Light falls off as the square of the distance from the centre: `1 - corner_loss (r /
/// r_corner)^2`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Vignetting {
    /// Share lost in the corner, 0..0.9.
    pub corner_loss: f64,
    /// Whose lens.
    #[serde(default = "both")]
    pub camera: WhichCamera,
}

/// The DAVIS sees everything moved by this similarity about its centre, against what the rig
/// states.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Misregistration {
    /// To the right, in DAVIS pixels.
    pub shift_x_px: f64,
    /// Down, in DAVIS pixels.
    pub shift_y_px: f64,
    /// Clockwise in the image.
    pub rotation_deg: f64,
    /// Larger than one: the image is larger.
    pub scale: f64,
}

impl Default for Misregistration {
    fn default() -> Self {
        Self { shift_x_px: 0.0, shift_y_px: 0.0, rotation_deg: 0.0, scale: 1.0 }
    }
}

/// The lamps pulsate: `1 + depth sin(2 pi frequency t)` (100 or 120 Hz on mains, depth 0.05..0.4).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Flicker {
    /// Pulses a second.
    pub frequency_hz: f64,
    /// Amplitude over mean, 0..1.
    pub depth: f64,
}

/// A soft-edged band of shadow wanders over the target, again and again.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MovingShadow {
    /// Share of the light that it takes, 0..1.
    pub depth: f64,
    /// Its way over the target.
    #[serde(default = "shadow_speed")]
    pub speed_mm_per_s: f64,
    /// Standard deviation of its profile across.
    #[serde(default = "shadow_width")]
    pub width_mm: f64,
    /// From one pass to the next along its way.
    #[serde(default = "shadow_period")]
    pub period_mm: f64,
    /// Its direction on the target, clockwise from the right.
    #[serde(default)]
    pub direction_deg: f64,
}

fn davis() -> WhichCamera {
    WhichCamera::Davis
}

fn both() -> WhichCamera {
    WhichCamera::Both
}

fn shadow_speed() -> f64 {
    25.0
}

fn shadow_width() -> f64 {
    8.0
}

fn shadow_period() -> f64 {
    100.0
}
