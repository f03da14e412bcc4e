//! Nuisance parameters: always fitted, within their prior ranges.

use crate::diagnose::SessionFacts;

/// A parameter that is always fitted within its prior range; a value beyond is a finding.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(usize)]
pub enum Nuisance {
    /// Log of the geometric mean threshold in log intensity.
    LogTheta,
    /// Log of the ON over the OFF threshold.
    LogRatio,
    /// Leak, ON events per second and pixel.
    LeakHz,
    /// Log of the threshold noise at white, in thresholds.
    LogNoise,
    /// Exponent of the noise's growth towards the dark.
    NoiseExponent,
    /// Log of the share of the noise under constant light.
    LogNoiseAtRest,
    /// Log of the rate at which the noise moves by its own scale, per second.
    LogNoiseHz,
    /// Share of the noise that enters the reference level stored at an event.
    NoiseInReference,
    /// Log of the rate of ON background events, per second and pixel.
    LogBackgroundOn,
    /// Log of the rate of OFF background events, per second and pixel.
    LogBackgroundOff,
    /// Share of background events that reset the reference level.
    BackgroundResetsReference,
    /// Delay of the event camera's stamps against the light, microseconds.
    OffsetUs,
    /// Variance of the event camera's blur beyond that of the map, square pixels.
    BlurPx2,
    /// Recorded minus predicted position to the right, pixels.
    ShiftX,
    /// Recorded minus predicted position downwards, pixels.
    ShiftY,
    /// Recorded minus predicted rotation about the center, degrees.
    RotationDeg,
    /// Recorded over predicted scale, minus one.
    ScaleChange,
}

pub(crate) const N_NUISANCES: usize = 17;

/// Start, prior range and finite-difference step.
pub(crate) struct PriorRange {
    pub(crate) start: f64,
    pub(crate) range: [f64; 2],
    pub(crate) step: f64,
}

impl Nuisance {
    /// All nuisances in the order of a hypothesis's values.
    pub const ALL: [Self; N_NUISANCES] = [
        Self::LogTheta,
        Self::LogRatio,
        Self::LeakHz,
        Self::LogNoise,
        Self::NoiseExponent,
        Self::LogNoiseAtRest,
        Self::LogNoiseHz,
        Self::NoiseInReference,
        Self::LogBackgroundOn,
        Self::LogBackgroundOff,
        Self::BackgroundResetsReference,
        Self::OffsetUs,
        Self::BlurPx2,
        Self::ShiftX,
        Self::ShiftY,
        Self::RotationDeg,
        Self::ScaleChange,
    ];

    /// Key in reports.
    #[must_use]
    pub const fn key(self) -> &'static str {
        match self {
            Self::LogTheta => "theta",
            Self::LogRatio => "on_off_ratio",
            Self::LeakHz => "leak_hz",
            Self::LogNoise => "noise_at_white_thresholds",
            Self::NoiseExponent => "noise_exponent",
            Self::LogNoiseAtRest => "noise_at_rest",
            Self::LogNoiseHz => "noise_movement_hz",
            Self::NoiseInReference => "noise_memorised",
            Self::LogBackgroundOn => "background_on_hz",
            Self::LogBackgroundOff => "background_off_hz",
            Self::BackgroundResetsReference => "background_memorised",
            Self::OffsetUs => "clock_offset_us",
            Self::BlurPx2 => "blur_px2",
            Self::ShiftX => "shift_x_px",
            Self::ShiftY => "shift_y_px",
            Self::RotationDeg => "rotation_deg",
            Self::ScaleChange => "scale",
        }
    }

    /// From fitted coordinate to reported value.
    #[must_use]
    pub fn reported(self, value: f64) -> f64 {
        match self {
            Self::LogTheta
            | Self::LogRatio
            | Self::LogNoise
            | Self::LogNoiseAtRest
            | Self::LogNoiseHz
            | Self::LogBackgroundOn
            | Self::LogBackgroundOff => value.exp(),
            Self::ScaleChange => 1.0 + value,
            _ => value,
        }
    }

    /// The value without the nuisance's effect, in the fitted coordinate.
    pub(crate) fn neutral(self) -> f64 {
        match self {
            // A log rate has no zero: changes count as they are.
            Self::LogNoise | Self::LogNoiseHz | Self::LogBackgroundOn | Self::LogBackgroundOff => {
                f64::NEG_INFINITY
            }
            Self::LogTheta => 0.25_f64.ln(),
            Self::BackgroundResetsReference => 1.0,
            _ => 0.0,
        }
    }

    /// Prior of a working camera: clocks as stated, lens in focus. Frames of the same sensor share
    /// its pose and lens.
    pub(crate) fn prior(self, facts: &SessionFacts) -> PriorRange {
        let of = |start: f64, range: [f64; 2], step: f64| PriorRange { start, range, step };
        let surroundings = if facts.from_scene { 1.0 } else { 0.0 };
        let within = facts.offset_bound_us;
        // Without dense frames, changes between frames act as noise.
        let (most_noise, most_hz, most_background) = if facts.is_light_dense() {
            (0.2_f64, 200.0_f64, 0.1_f64)
        } else {
            (1.2, 2_000.0, 3.0)
        };
        match self {
            Self::LogTheta => of(0.25_f64.ln(), [0.02_f64.ln(), 3.0_f64.ln()], 0.004),
            Self::LogRatio => of(0.0, [-0.03, 0.03], 0.004),
            Self::LeakHz => of(0.1, [0.0, 0.3], 0.02),
            Self::LogNoise => of(0.06_f64.ln(), [0.001_f64.ln(), most_noise.ln()], 0.02),
            Self::NoiseExponent => of(0.3, [0.0, 1.0], 0.02),
            Self::LogNoiseAtRest => of(0.4_f64.ln(), [0.03_f64.ln(), 0.0], 0.05),
            Self::LogNoiseHz => of(60.0_f64.ln(), [1.0_f64.ln(), most_hz.ln()], 0.05),
            Self::NoiseInReference => of(0.0, [0.0, 1.0], 0.05),
            Self::BackgroundResetsReference => of(1.0, [1.0, 1.0], 0.05),
            Self::LogBackgroundOn | Self::LogBackgroundOff => {
                of(0.01_f64.ln(), [1e-4_f64.ln(), most_background.ln()], 0.05)
            }
            Self::OffsetUs => of(0.0, [-within, within], 50.0),
            Self::BlurPx2 => of(0.0, [-0.2 * surroundings, 0.2 * surroundings], 0.01),
            Self::ShiftX | Self::ShiftY => {
                of(0.0, [-0.15 * surroundings, 0.15 * surroundings], 0.01)
            }
            // Shifts the corners of a DAVIS346 by as much as the bound above.
            Self::RotationDeg => of(0.0, [-0.04 * surroundings, 0.04 * surroundings], 3e-3),
            Self::ScaleChange => of(0.0, [-7e-4 * surroundings, 7e-4 * surroundings], 5e-5),
        }
    }
}
