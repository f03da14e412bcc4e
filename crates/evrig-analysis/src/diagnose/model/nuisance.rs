//! What every recording has and every fit has to allow for.

use crate::diagnose::SessionFacts;

/// A quantity that is always fitted, within its ordinary range; outside, it is a finding.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(usize)]
pub enum Nuisance {
    /// Logarithm of the mean threshold in log intensity: the contrast gain turned round.
    LogTheta,
    /// Logarithm of On threshold over Off threshold.
    LogRatio,
    /// Leak, On events a second and pixel.
    LeakHz,
    /// Logarithm of the threshold's scatter at white, in thresholds.
    LogNoise,
    /// How the scatter grows towards the dark.
    NoiseExponent,
    /// Logarithm of the share of the scatter that there is where the light stays.
    LogNoiseAtRest,
    /// Logarithm of how often a second the noise moves by its own scale.
    LogNoiseHz,
    /// How much of the noise that set off an event the pixel memorises with the light.
    NoiseInReference,
    /// Logarithm of the rate of background On events, a second and pixel.
    LogBackgroundOn,
    /// Logarithm of the rate of background Off events, a second and pixel.
    LogBackgroundOff,
    /// Share of the background events at which the pixel memorises the light.
    BackgroundResetsReference,
    /// By how much the event camera's stamps are late against the light, microseconds.
    OffsetUs,
    /// Variance by which the event camera sees more blurred than the light's map, square pixels.
    BlurPx2,
    /// Real minus predicted place, to the right, pixels.
    ShiftX,
    /// Real minus predicted place, downwards, pixels.
    ShiftY,
    /// Real minus predicted rotation about the sensor's middle, degrees.
    RotationDeg,
    /// Real over predicted size, less one.
    ScaleChange,
}

/// How many there are.
pub(crate) const N_NUISANCES: usize = 17;

/// Start, ordinary range and step of a difference quotient.
pub(crate) struct PriorRange {
    pub(crate) start: f64,
    pub(crate) range: [f64; 2],
    pub(crate) step: f64,
}

impl Nuisance {
    /// All of them, in the order of a hypothesis's values.
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

    /// The key under which it is reported.
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

    /// From the fitted coordinate to the number that is reported.
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

    /// Its value where there is nothing of it, in the fitted coordinate.
    pub(crate) fn neutral(self) -> f64 {
        match self {
            // A rate or a scatter has none on a logarithmic scale: there a change counts as it is.
            Self::LogNoise | Self::LogNoiseHz | Self::LogBackgroundOn | Self::LogBackgroundOff => {
                f64::NEG_INFINITY
            }
            Self::LogTheta => 0.25_f64.ln(),
            Self::BackgroundResetsReference => 1.0,
            _ => 0.0,
        }
    }

    /// What an ordinary recording has: a camera in order, its clocks as stated, its lens in focus.
    /// A light from frames of the same sensor sees from the same place through the same lens.
    pub(crate) fn prior(self, facts: &SessionFacts) -> PriorRange {
        let of = |start: f64, range: [f64; 2], step: f64| PriorRange { start, range, step };
        let surroundings = if facts.from_scene { 1.0 } else { 0.0 };
        let within = facts.offset_bound_us;
        // What happens between frames is noise to whoever only has the frames.
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
            // As much again in the corners of a DAVIS346.
            Self::RotationDeg => of(0.0, [-0.04 * surroundings, 0.04 * surroundings], 3e-3),
            Self::ScaleChange => of(0.0, [-7e-4 * surroundings, 7e-4 * surroundings], 5e-5),
        }
    }
}
