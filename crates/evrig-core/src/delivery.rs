//! Focus of the Pi's camera, and coding and transmission of its frames.

use crate::keyword::UnknownKeyword;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

/// Focus control of the lens. By default it is locked during a recording.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Focus {
    /// One autofocus before the recording, then locked.
    #[default]
    Once,
    /// Continuous autofocus; the magnification changes with it.
    Continuous,
    /// Locked at this focus, dioptres.
    Dioptres(f64),
}

/// Coding of frames in transmission and in the spool; both are lossless.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Coding {
    /// Uncompressed: RAW10, and R, G, B bytes.
    Plain,
    /// Prediction from neighbouring pixels, with compressed residuals.
    #[default]
    Lossless,
}

/// When RGB frames are transmitted. Raw frames are always transmitted immediately.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RgbDelivery {
    /// With the raw frame of the same request.
    #[default]
    Live,
    /// With every n-th raw frame; the others are dropped.
    Every(u32),
    /// Stored on the Pi's disk and transmitted after the recording.
    AfterTake,
}

impl FromStr for Focus {
    type Err = UnknownKeyword;

    fn from_str(text: &str) -> Result<Self, UnknownKeyword> {
        let dioptres = |text: &str| {
            let number: f64 = text.parse().ok()?;
            (0.0..=32.0).contains(&number).then_some(Self::Dioptres(number))
        };
        match text {
            "once" => Ok(Self::Once),
            "continuous" => Ok(Self::Continuous),
            _ => dioptres(text)
                .ok_or_else(|| UnknownKeyword::new(text, "once, continuous, or 0 to 32 dioptres")),
        }
    }
}

impl FromStr for Coding {
    type Err = UnknownKeyword;

    fn from_str(text: &str) -> Result<Self, UnknownKeyword> {
        match text {
            "plain" => Ok(Self::Plain),
            "lossless" => Ok(Self::Lossless),
            _ => Err(UnknownKeyword::new(text, "plain or lossless (smaller)")),
        }
    }
}

impl FromStr for RgbDelivery {
    type Err = UnknownKeyword;

    fn from_str(text: &str) -> Result<Self, UnknownKeyword> {
        let every = |text: &str| {
            let n: u32 = text.strip_prefix("every:")?.parse().ok()?;
            (n > 0).then_some(Self::Every(n))
        };
        match text {
            "live" => Ok(Self::Live),
            "after-take" => Ok(Self::AfterTake),
            _ => {
                every(text).ok_or_else(|| UnknownKeyword::new(text, "live, every:N or after-take"))
            }
        }
    }
}

impl fmt::Display for RgbDelivery {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Live => f.write_str("live"),
            Self::Every(n) => write!(f, "every:{n}"),
            Self::AfterTake => f.write_str("after-take"),
        }
    }
}

impl fmt::Display for Coding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Plain => "plain",
            Self::Lossless => "lossless",
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_words_of_the_rig_file_are_understood_and_others_are_refused() {
        assert_eq!("once".parse(), Ok(Focus::Once));
        assert_eq!("4.5".parse(), Ok(Focus::Dioptres(4.5)));
        for word in ["live", "every:4", "after-take"] {
            assert_eq!(word.parse::<RgbDelivery>().unwrap().to_string(), word);
        }
        for word in ["plain", "lossless"] {
            assert_eq!(word.parse::<Coding>().unwrap().to_string(), word);
        }
        for wrong in ["", "every:0", "every:-1", "later"] {
            assert!(wrong.parse::<RgbDelivery>().unwrap_err().to_string().contains("every:N"));
        }
        for wrong in ["-1", "nan", "inf", "near"] {
            assert!(wrong.parse::<Focus>().is_err(), "{wrong}");
        }
        assert!("jpeg".parse::<Coding>().is_err());
    }
}
