//! Effects inside an event pixel.
//!
//! Ranges and sources: Lichtsteiner et al., JSSC 43:566 (2008); Brandli et al., JSSC 49:2333
//! (2014); Nozaki and Delbruck, IEEE TED 64:3239 (2017); Hu, Liu and Delbruck, "v2e",
//! arXiv 2006.07722; Joubert et al., Front. Neurosci. 15:702765 (2021); Graca et al., arXiv
//! 2304.04019 and 2505.07386; the tables of DND21.

use serde::{Deserialize, Serialize};

/// First-order low pass whose corner is proportional to the photocurrent:
/// `dy/dt = 2 pi f(I) (x - y)`, `f(I) = cutoff_hz_at_white * I / I_white` (v2e; Graca 2025).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PhotoreceptorBandwidth {
    /// Corner where the target is white at full light, 10..10,000 Hz.
    pub cutoff_hz_at_white: f64,
    /// Equal poles in series, 1 or 2.
    #[serde(default = "one")]
    pub order: u32,
}

/// First-order low pass of the source follower; does not depend on light (Graca, arXiv 2109.08640).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FixedPole {
    /// Corner, 10..10,000 Hz.
    pub cutoff_hz: f64,
}

/// After an event the comparator is reset until `refractory_us` have passed, and takes its new
/// reference only then (Joubert 2021; bias RefrBp, 10 us..20 ms).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WorldRefractoryPeriod {
    /// How long.
    pub refractory_us: f64,
}

/// Each pixel's ON and OFF thresholds are normal about the nominal ones (Wang et al., arXiv
/// 2012.09378: 0.1..0.25 relative).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ThresholdMismatch {
    /// Standard deviation of either threshold over its mean.
    pub sigma_relative: f64,
    /// Correlation of a pixel's ON and OFF threshold.
    #[serde(default = "half")]
    pub correlation: f64,
}

/// Thresholds `theta sqrt(ratio)` for ON and `theta / sqrt(ratio)` for OFF (biases onbn, offbn;
/// 0.5..2).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ThresholdAsymmetry {
    /// ON threshold over OFF threshold.
    pub on_off_ratio: f64,
}

/// The reset transistor's junction leaks: the comparator drifts towards ON by `rate_hz` thresholds
/// a second (Nozaki and Delbruck 2017: 0.05..1 Hz).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JunctionLeak {
    /// ON events a second of a pixel that sees nothing change.
    pub rate_hz: f64,
}

/// Parasitic photocurrent: as the junction leak, in proportion to the light on the pixel
/// (Nozaki and Delbruck 2017; up to 10 Hz in a bright scene).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PhotocurrentLeak {
    /// ON events a second where the target is white at full light.
    pub rate_hz_at_white: f64,
}

/// Band-limited noise on the photoreceptor's output: white noise behind a pole at `bandwidth_hz`
/// and the follower's pole at three times that, stationary with standard deviation `rms_thresholds
/// * theta * (I / I_white)^-brightness_exponent` (Graca 2023, 2025: 0.05..0.5 thresholds).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ShotNoise {
    /// Standard deviation at white, in nominal thresholds.
    pub rms_thresholds: f64,
    /// Corner of the first pole.
    pub bandwidth_hz: f64,
    /// 0 where the photoreceptor limits its own noise (kT/C), 0.5 where a fixed pole does.
    #[serde(default)]
    pub brightness_exponent: f64,
}

/// Events of either polarity at random (Poisson), each of which resets the pixel (0.01..20 Hz).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BackgroundActivity {
    /// Events a second and pixel, both polarities together.
    pub rate_hz: f64,
}

/// Some pixels leak so much that they fire all the time (DND21; fraction 1e-4..1e-2).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HotPixels {
    /// Share of pixels.
    pub fraction: f64,
    /// Slowest and fastest; a pixel's own rate is log-uniform between them.
    #[serde(default = "hot_rates")]
    pub rate_hz: [f64; 2],
}

/// Some pixels never fire.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DeadPixels {
    /// How many.
    pub count: u32,
}

/// From a crossing to the request on the bus (Joubert 2021: 10..1000 us).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PixelLatency {
    /// How long.
    pub latency_us: f64,
}

/// The signal's slow part is subtracted: `z = y - fraction * a`, `da/dt = (y - a) /
/// time_constant_s`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Adaptation {
    /// Of the slow part, 0.05..10 s.
    pub time_constant_s: f64,
    /// How much of it is forgotten, 0..1.
    pub fraction: f64,
}

/// Current without light: `I = light + fraction_of_white * I_white` (doubles every 6..8 degrees).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DarkCurrent {
    /// As a share of the current at white in full light, 1e-4..0.1.
    pub fraction_of_white: f64,
}

/// The junction leak grows while the chip warms: `rate_hz_per_s * t` on top of it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TemperatureDrift {
    /// Growth of the leak in events a second, per second.
    pub rate_hz_per_s: f64,
}

fn one() -> u32 {
    1
}

fn half() -> f64 {
    0.5
}

fn hot_rates() -> [f64; 2] {
    [10.0, 300.0]
}
