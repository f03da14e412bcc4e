//! The six k of the event model, their ranges, and what they make of two brightnesses.

use crate::parameter_error::ParameterError;
use crate::sequence::FrameSpan;
use serde::{Deserialize, Serialize};
use std::str::FromStr;

/// The six coefficients k1..k6 of the event model (Lin et al., ECCV 2022, eq. 10; Raw2Event,
/// eq. 1), for time in µs, brightness L in the frame's own digital units and thresholds of ±1:
///
/// dV = (k1 L'/(L + k2) + k4 + k5 L) dt + (k3 √L/(L + k2) + k6) dW
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "[f64; 6]", into = "[f64; 6]")]
pub struct Coefficients([f64; 6]);

/// What k may be: lowest and highest value, and unit (DN: digital number of the frame).
/// Wide enough for any fit; outside lies a slip of unit or sign.
const RANGES: [(f64, f64, &str); 6] = [
    (0.0, 1e4, "thresholds per log unit"),
    (1e-9, 1e6, "DN"),
    (0.0, 1e2, "thresholds sqrt(DN / us)"),
    (-1e-2, 1e-2, "thresholds / us"),
    (-1e-4, 1e-4, "thresholds / us / DN"),
    (0.0, 1.0, "thresholds / sqrt(us)"),
];

/// Drift and diffusion of a pixel's voltage within an interval, both constant there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DriftDiffusion {
    /// Drift μ, thresholds per µs.
    pub drift_per_us: f64,
    /// Diffusion σ, thresholds per √µs (a standard deviation, not a variance).
    pub sigma_per_sqrt_us: f64,
}

impl Coefficients {
    /// Coefficients within their ranges.
    ///
    /// # Errors
    /// The first k that is not finite or outside its range, by name.
    pub fn new(k: [f64; 6]) -> Result<Self, ParameterError> {
        for (i, (&value, (low, high, unit))) in k.iter().zip(RANGES).enumerate() {
            if !(low..=high).contains(&value) {
                let number = i + 1;
                return Err(ParameterError::KOutOfRange { number, value, low, high, unit });
            }
        }
        Ok(Self(k))
    }

    /// DAVIS346 from its own 8-bit frames (Lin et al., ECCV 2022), where k1 is 0.00018 * 29250.
    pub const DVS346: Self = Self([5.265, 20.0, 0.000_1, 1e-7, 5e-9, 0.000_01]);

    /// DAVIS240 from its own 8-bit frames (Lin et al., ECCV 2022), where k1 is 0.000094 * 47065.
    pub const DVS240: Self = Self([4.424_11, 23.0, 0.000_2, 1e-7, 5e-8, 0.000_01]);

    /// DAVIS346 from 10-bit raw frames of Pi Camera Module 3 (Raw2Event).
    pub const RAW2DVS346: Self = Self([2.388, 4.166e-7, 1.541e-6, 9.768e-8, 1.466e-11, 9.824e-6]);

    /// DAVIS346 from 8-bit gray of the same camera's RGB frames (Raw2Event).
    pub const RGB2DVS346: Self = Self([
        5.332_474_147_628_972,
        0.900_333_202_726_682_3,
        8.288_263_352_543_993e-6,
        1.099_239_717_282_808_7e-7,
        3.302_652_963_977_818e-9,
        1.101_244_403_871_650_4e-7,
    ]);

    /// k1 to k6.
    #[must_use]
    pub const fn k(&self) -> [f64; 6] {
        self.0
    }

    /// Drift and diffusion between two frames `span_us` apart that saw `before` and `after` (DN).
    #[must_use]
    #[inline]
    pub fn motion(&self, before: f32, after: f32, span_us: f64) -> DriftDiffusion {
        let [k1, k2, k3, k4, k5, k6] = self.0;
        let (before, after) = (f64::from(before), f64::from(after));
        let mean = 0.5 * (before + after);
        let gain = 1.0 / (mean + k2);
        DriftDiffusion {
            drift_per_us: k1 * gain * (after - before) / span_us + k4 + k5 * mean,
            sigma_per_sqrt_us: k3 * gain * mean.sqrt() + k6,
        }
    }

    /// A number of events that no pixel's mean exceeds in an interval: a pixel fires at the
    /// rate μ/tanh(μ/σ²) <= |μ| + σ²; |ΔL| <= 2 L̄ and √L/(L + k2) <= 1/(2 √k2).
    pub(super) fn max_mean_events(&self, interval: FrameSpan) -> f64 {
        let [k1, k2, k3, k4, k5, k6] = self.0;
        let sigma = k3 / (2.0 * k2.sqrt()) + k6;
        let leak = k4.abs() + k5.abs() * f64::from(interval.brightest);
        2.0 * k1 + (leak + sigma * sigma) * f64::from(interval.span_us)
    }
}

impl TryFrom<[f64; 6]> for Coefficients {
    type Error = ParameterError;
    fn try_from(k: [f64; 6]) -> Result<Self, ParameterError> {
        Self::new(k)
    }
}

impl From<Coefficients> for [f64; 6] {
    fn from(coefficients: Coefficients) -> Self {
        coefficients.0
    }
}

impl FromStr for Coefficients {
    type Err = ParameterError;

    /// Reads `k1,k2,k3,k4,k5,k6`.
    fn from_str(text: &str) -> Result<Self, ParameterError> {
        let parts: Vec<&str> = text.split(',').map(str::trim).collect();
        if parts.len() != 6 {
            return Err(ParameterError::KCount { found: parts.len(), text: text.to_owned() });
        }
        let mut k = [0.0; 6];
        for (i, part) in parts.iter().enumerate() {
            k[i] = part
                .parse()
                .map_err(|_| ParameterError::KNotANumber { number: i + 1, text: (*part).into() })?;
        }
        Self::new(k)
    }
}

impl std::fmt::Display for Coefficients {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [k1, k2, k3, k4, k5, k6] = self.0;
        write!(f, "{k1:?},{k2:?},{k3:?},{k4:?},{k5:?},{k6:?}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn six_numbers_are_read_and_written_back() {
        let text = "2.388,4.166e-7,1.541e-6,9.768e-8,1.466e-11,9.824e-6";
        let k: Coefficients = text.parse().unwrap();
        assert_eq!(k.to_string().parse::<Coefficients>().unwrap(), k);
        let json = serde_json::to_string(&k).unwrap();
        assert_eq!(serde_json::from_str::<Coefficients>(&json).unwrap(), k);
    }

    #[test]
    fn a_wrong_k_is_named() {
        let error = |text: &str| text.parse::<Coefficients>().unwrap_err().to_string();
        assert!(error("1,2,3").contains("3 numbers"), "{}", error("1,2,3"));
        assert!(error("1,2,x,0,0,0").contains("k3"), "{}", error("1,2,x,0,0,0"));
        assert!(error("1,0,0,0,0,0").contains("k2"), "{}", error("1,0,0,0,0,0"));
        assert!(error("1,1,-1,0,0,0").contains("k3"), "{}", error("1,1,-1,0,0,0"));
        assert!(error("1,1,0,NaN,0,0").contains("k4"), "{}", error("1,1,0,NaN,0,0"));
        assert!(serde_json::from_str::<Coefficients>("[1,0,0,0,0,0]").is_err());
    }

    #[test]
    fn dark_and_saturated_pixels_have_finite_motion() {
        let k = Coefficients::RAW2DVS346;
        for (before, after) in [(0.0, 0.0), (0.0, 1e-30), (1023.0, 0.0), (0.0, f32::MAX)] {
            let motion = k.motion(before, after, 1.0);
            assert!(motion.drift_per_us.is_finite() && motion.sigma_per_sqrt_us.is_finite());
            let brightest = f32::max(before, after);
            let interval = FrameSpan { index: 1, start_us: 0, span_us: 1, brightest };
            let most = k.max_mean_events(interval);
            assert!(motion.drift_per_us.abs() + motion.sigma_per_sqrt_us.powi(2) <= most);
        }
    }
}
