//! Result for each frame: a detection of the tag, or the reason for its absence.

use evrig_core::time::{Clock, Span, Stamp};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Why a frame has no usable detection.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LossReason {
    /// The frame has fewer samples than its size needs, or colours where a mosaic was stated.
    Unreadable,
    /// The frame is not after the one before it.
    OutOfOrder,
    /// The frame has no contrast.
    NoContrast,
    /// No tag of the family was detected.
    NotFound,
    /// Only tags of the family with other ids were detected.
    OtherId,
    /// Only the mirror image of the tag was detected; looked for until the tag itself is detected.
    Mirrored,
    /// The tag was detected in several places.
    Repeated,
    /// A corner is too close to the frame's border.
    AtBorder,
    /// The outline has too little contrast for a corner fit.
    Unclear,
    /// The corners are an outlier of the path.
    Outlier,
    /// Too few neighbouring detections for a path.
    Isolated,
}

impl LossReason {
    /// The reason in words.
    #[must_use]
    pub const fn description(self) -> &'static str {
        match self {
            Self::Unreadable => "too few samples for the size",
            Self::OutOfOrder => "not after the previous frame",
            Self::NoContrast => "no contrast",
            Self::NotFound => "no tag detected",
            Self::OtherId => "only tags with other ids",
            Self::Mirrored => "mirror image of the tag",
            Self::Repeated => "tag in several places",
            Self::AtBorder => "tag at the border",
            Self::Unclear => "low contrast of the outline",
            Self::Outlier => "outlier of the path",
            Self::Isolated => "too few neighbouring detections",
        }
    }
}

/// Detection of the tag in one frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(bound = "")]
pub struct TagDetection<C: Clock> {
    /// Index of the frame among those given to the tracker, from 0.
    pub frame: u64,
    /// Mid-exposure of the row of the tag's centre.
    pub time: Stamp<C>,
    /// Sensor pixels of the tag's corners: bottom left, bottom right, top right, top left.
    pub corners_px: [[f64; 2]; 4],
    /// Mid-exposure of each corner's row, relative to `time`.
    pub corner_delays: [Span; 4],
    /// Covariance of x and y of each corner in turn, row-major, square sensor pixels.
    pub covariance_px2: [[f64; 8]; 8],
    /// Standard deviation of the blur across the outline, sensor pixels.
    pub blur_px: f64,
}

/// Frame counts: seen = used + lost for all reasons.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct TrackTally {
    /// Frames given.
    pub seen: u64,
    /// Frames whose detections are part of the path.
    pub used: u64,
    /// The other frames by reason; reasons with no frame are absent.
    pub lost: BTreeMap<LossReason, u64>,
    /// Search effort.
    pub searched: Searched,
}

/// Search effort.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Searched {
    /// Frames searched as a whole.
    pub whole_frames: u64,
    /// Windows searched around predicted positions.
    pub windows: u64,
    /// Pixels in those windows together.
    pub window_pixels: u64,
}

impl TrackTally {
    pub(super) fn lose(&mut self, reason: LossReason) {
        *self.lost.entry(reason).or_default() += 1;
    }

    /// Moves a used frame to the lost ones.
    pub(super) fn withdraw(&mut self, reason: LossReason) {
        self.used -= 1;
        self.lose(reason);
    }

    /// Frames lost for any reason.
    #[must_use]
    pub fn n_lost(&self) -> u64 {
        self.lost.values().sum()
    }

    /// Whether every frame is counted.
    #[must_use]
    pub fn balances(&self) -> bool {
        self.seen == self.used + self.n_lost()
    }

    /// The reasons with their counts, the most frequent first.
    #[must_use]
    pub fn reasons(&self) -> String {
        let mut lost: Vec<_> = self.lost.iter().collect();
        lost.sort_by_key(|(_, n)| std::cmp::Reverse(**n));
        let parts: Vec<_> =
            lost.iter().map(|(why, n)| format!("{n} {}", why.description())).collect();
        parts.join(", ")
    }
}
