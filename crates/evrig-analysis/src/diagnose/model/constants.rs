//! Camera constants: what every event camera has, always fitted, with a Gaussian prior.

use crate::diagnose::SessionFacts;
use evrig_core::effect_id::EffectId;

/// A constant of the calibrated camera.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(usize)]
pub(crate) enum CameraConstant {
    /// Log of the geometric mean threshold in log intensity.
    LogTheta,
    /// Log of the ON over the OFF threshold.
    LogRatio,
    /// Leak, ON events per second (k4 of DVS-Voltmeter).
    LeakHz,
    /// Leak at white in proportion to intensity, ON events per second (k5).
    PhotoLeakHz,
    /// Log of the threshold noise at white, logistic scale in thresholds.
    LogNoise,
    /// Exponent of the noise's growth towards the dark.
    NoiseExponent,
    /// Logit of the share of the noise where the signal rests.
    LogitRest,
    /// Log of the speed of the noise over its scale, per second.
    LogNoiseRate,
    /// Logit of the share of the noise that enters the reference level.
    LogitStored,
    /// Log of the rate of ON background events, Hz.
    LogBackgroundOn,
    /// Log of the rate of OFF background events, Hz.
    LogBackgroundOff,
    /// Logit of the share of background events that reset the pixel.
    LogitBackgroundReset,
    /// Offset of the intensity, in white levels: dark current (k2), less a black level.
    Pedestal,
    /// Delay of the events' stamps against the signal, microseconds.
    OffsetUs,
    /// Log of the standard deviation of time stamps and of the known signal in time, microseconds.
    LogStampError,
    /// Variance of the blur beyond that of the map, square pixels.
    BlurPx2,
    /// Recorded minus predicted position to the right, pixels.
    ShiftX,
    /// Recorded minus predicted position downwards, pixels.
    ShiftY,
    /// Recorded minus predicted rotation, degrees.
    RotationDeg,
    /// Recorded over predicted scale, minus one.
    Scale,
    /// Variance of the blur in time by exposure and interpolation, squared frame intervals.
    TemporalBlur,
}

/// Number of constants.
pub(crate) const N_CONSTANTS: usize = 21;

/// A Gaussian prior, and the range that an ordinary camera has.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ConstantPrior {
    /// Mean in the fitted coordinate.
    pub(crate) mean: f64,
    /// Standard deviation; 0 where the constant does not exist.
    pub(crate) sd: f64,
    /// Range of an ordinary camera; a value surely outside is reported as an effect.
    pub(crate) ordinary: [f64; 2],
    /// Finite-difference step.
    pub(crate) step: f64,
}

impl CameraConstant {
    pub(crate) const ALL: [Self; N_CONSTANTS] = [
        Self::LogTheta,
        Self::LogRatio,
        Self::LeakHz,
        Self::PhotoLeakHz,
        Self::LogNoise,
        Self::NoiseExponent,
        Self::LogitRest,
        Self::LogNoiseRate,
        Self::LogitStored,
        Self::LogBackgroundOn,
        Self::LogBackgroundOff,
        Self::LogitBackgroundReset,
        Self::Pedestal,
        Self::OffsetUs,
        Self::LogStampError,
        Self::BlurPx2,
        Self::ShiftX,
        Self::ShiftY,
        Self::RotationDeg,
        Self::Scale,
        Self::TemporalBlur,
    ];

    /// Prior from datasheets and the literature: thresholds of 2 to 100 %, a leak of 0.1 Hz and
    /// background activity of 0.01 to 0.1 Hz (Lichtsteiner et al., 2008; Nozaki and Delbruck, 2017).
    pub(crate) fn prior(self, facts: &SessionFacts) -> ConstantPrior {
        const ANY: [f64; 2] = [f64::NEG_INFINITY, f64::INFINITY];
        let of = |mean: f64, sd: f64, ordinary: [f64; 2], step: f64| ConstantPrior {
            mean,
            sd,
            ordinary,
            step,
        };
        let scene = if facts.from_scene { 1.0 } else { 0.0 };
        let bound = facts.offset_bound_us;
        // Between sparse frames the error of the signal acts as noise.
        let max_noise = if facts.is_light_dense() { 0.05 } else { f64::INFINITY };
        match self {
            Self::LogTheta => of(0.25_f64.ln(), 0.7, ANY, 1e-3),
            Self::LogRatio => of(0.0, 0.3, [-0.05, 0.05], 1e-3),
            Self::LeakHz => of(0.1, 0.3, [-0.1, 0.35], 5e-3),
            Self::PhotoLeakHz => of(0.0, 0.3, [-0.35, 0.35], 5e-3),
            Self::LogNoise => of(0.06_f64.ln(), 0.8, [f64::NEG_INFINITY, max_noise.ln()], 2e-3),
            Self::NoiseExponent => of(0.3, 0.3, ANY, 2e-3),
            Self::LogitRest => of(-0.4, 1.0, ANY, 5e-3),
            // Noise that moves within the microsecond of the stamps is a threshold of its own.
            Self::LogNoiseRate => of(60.0_f64.ln(), 1.0, [f64::NEG_INFINITY, 1e6_f64.ln()], 5e-3),
            Self::LogitStored => of(-0.5, 1.5, ANY, 5e-3),
            Self::LogBackgroundOn | Self::LogBackgroundOff => {
                of(0.02_f64.ln(), 1.5, [f64::NEG_INFINITY, 0.12_f64.ln()], 1e-2)
            }
            Self::LogitBackgroundReset => of(2.0, 1.0, ANY, 1e-2),
            Self::Pedestal => of(0.0, 0.01, [-0.01, 0.01], 1e-4),
            Self::OffsetUs => of(0.0, bound, [-bound, bound], 5.0),
            Self::LogStampError => {
                let ordinary = ordinary_stamp_error_us(facts);
                of((0.3 * ordinary).ln(), 1.0, [f64::NEG_INFINITY, ordinary.ln()], 1e-2)
            }
            Self::BlurPx2 => of(0.0, 0.1 * scene, [-0.2, 0.2], 1e-3),
            Self::ShiftX | Self::ShiftY => of(0.0, 0.1 * scene, [-0.15, 0.15], 1e-3),
            Self::RotationDeg => of(0.0, 0.03 * scene, [-0.04, 0.04], 3e-4),
            Self::Scale => of(0.0, 5e-4 * scene, [-7e-4, 7e-4], 1e-5),
            // Linear interpolation is convolution with a triangle, of variance 1/6.
            Self::TemporalBlur => of(0.0, (1.0 - scene) / 6.0, [-1.0 / 6.0, 1.0 / 3.0], 2e-3),
        }
    }

    /// Whether it changes the signal and not only the law or the clock.
    pub(crate) fn changes_signal(self) -> bool {
        matches!(
            self,
            Self::Pedestal
                | Self::BlurPx2
                | Self::ShiftX
                | Self::ShiftY
                | Self::RotationDeg
                | Self::Scale
                | Self::PhotoLeakHz
                | Self::TemporalBlur
        )
    }

    /// The effect that a value is beyond its ordinary range.
    pub(crate) fn effect(self, value: f64) -> Option<EffectId> {
        Some(match self {
            Self::LogRatio => EffectId::ThresholdAsymmetry,
            Self::LeakHz => EffectId::JunctionLeak,
            Self::PhotoLeakHz => EffectId::PhotocurrentLeak,
            Self::LogBackgroundOn | Self::LogBackgroundOff => EffectId::BackgroundActivity,
            Self::Pedestal if value > 0.0 => EffectId::DarkCurrent,
            Self::Pedestal => EffectId::BlackLevel,
            Self::OffsetUs => EffectId::ClockOffset,
            Self::LogStampError => EffectId::StampJitter,
            Self::BlurPx2 => EffectId::Defocus,
            Self::ShiftX | Self::ShiftY | Self::RotationDeg | Self::Scale => {
                EffectId::Misregistration
            }
            _ => return None,
        })
    }
}

/// Largest ordinary error of stamps and of the known signal in time, microseconds.
///
/// Cameras stamp within tens of microseconds; readout adds up to 200 in a busy DAVIS. Between frames
/// the time at which an edge passes a pixel is known to a sixth of their interval.
fn ordinary_stamp_error_us(facts: &SessionFacts) -> f64 {
    const READOUT_US: f64 = 200.0;
    if facts.from_scene { READOUT_US } else { READOUT_US.max(facts.frame_us / 6.0) }
}

/// How a fitted coordinate is reported.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum ReportedAs {
    Value,
    Exponential,
    Logistic,
    OnePlus,
}

impl CameraConstant {
    /// Key in reports, and how the value is reported.
    pub(crate) const fn key(self) -> (&'static str, ReportedAs) {
        match self {
            Self::LogTheta => ("theta", ReportedAs::Exponential),
            Self::LogRatio => ("on_off_ratio", ReportedAs::Exponential),
            Self::LeakHz => ("leak_hz", ReportedAs::Value),
            Self::PhotoLeakHz => ("photocurrent_leak_hz_at_white", ReportedAs::Value),
            Self::LogNoise => ("noise_at_white_thresholds", ReportedAs::Exponential),
            Self::NoiseExponent => ("noise_exponent", ReportedAs::Value),
            Self::LogitRest => ("noise_at_rest", ReportedAs::Logistic),
            Self::LogNoiseRate => ("noise_movement_hz", ReportedAs::Exponential),
            Self::LogitStored => ("noise_memorised", ReportedAs::Logistic),
            Self::LogBackgroundOn => ("background_on_hz", ReportedAs::Exponential),
            Self::LogBackgroundOff => ("background_off_hz", ReportedAs::Exponential),
            Self::LogitBackgroundReset => ("background_memorised", ReportedAs::Logistic),
            Self::Pedestal => ("pedestal_of_white", ReportedAs::Value),
            Self::OffsetUs => ("clock_offset_us", ReportedAs::Value),
            Self::LogStampError => ("stamp_error_us", ReportedAs::Exponential),
            Self::BlurPx2 => ("blur_px2", ReportedAs::Value),
            Self::ShiftX => ("shift_x_px", ReportedAs::Value),
            Self::ShiftY => ("shift_y_px", ReportedAs::Value),
            Self::RotationDeg => ("rotation_deg", ReportedAs::Value),
            Self::Scale => ("scale", ReportedAs::OnePlus),
            Self::TemporalBlur => ("temporal_blur_frames2", ReportedAs::Value),
        }
    }
}
