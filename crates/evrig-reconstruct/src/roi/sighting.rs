//! What became of each frame: a sighting of the tag, or the reason why there is none.

use evrig_core::time::{Clock, Span, Stamp};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Why a frame gives no sighting.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Lost {
    /// The frame holds fewer samples than its size needs, or colours where a mosaic was stated.
    Unreadable,
    /// The frame does not come after the one before it.
    OutOfOrder,
    /// The frame is of one brightness.
    NoContrast,
    /// Nothing like a tag of the family is in the frame.
    NotFound,
    /// Tags of the family are in the frame, but none with the number looked for.
    OtherId,
    /// A corner is so near the frame's border that its surroundings are cut off.
    AtBorder,
    /// The outline does not stand out clearly enough for corners.
    Unclear,
    /// The corners do not lie on the path that all the others follow.
    Outlier,
    /// Too few sightings around it for a path.
    Isolated,
}

impl Lost {
    /// The reason in words.
    #[must_use]
    pub const fn says(self) -> &'static str {
        match self {
            Self::Unreadable => "fewer samples than the size needs",
            Self::OutOfOrder => "not after the frame before it",
            Self::NoContrast => "no contrast",
            Self::NotFound => "no tag found",
            Self::OtherId => "only tags of other numbers",
            Self::AtBorder => "tag at the border",
            Self::Unclear => "outline unclear",
            Self::Outlier => "off the path",
            Self::Isolated => "too few sightings around it",
        }
    }
}

/// The tag in one frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(bound = "")]
pub struct Sighting<C: Clock> {
    /// Number of the frame among those shown to the tracker, from 0.
    pub frame: u64,
    /// Mid-exposure of the row of the tag's middle.
    pub time: Stamp<C>,
    /// Sensor pixels of the tag's corners: bottom left, bottom right, top right, top left.
    pub corners_px: [[f64; 2]; 4],
    /// Mid-exposure of each corner's row, relative to `time`.
    pub corner_delays: [Span; 4],
    /// Covariance of x and y of each corner in turn, row-major, square sensor pixels.
    pub covariance_px2: [[f64; 8]; 8],
    /// Standard deviation of the blur across the outline, in sensor pixels.
    pub blur_px: f64,
}

/// How many frames were seen and what became of them: seen = used + all lost.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct TrackTally {
    /// Frames shown.
    pub seen: u64,
    /// Frames whose sightings carry the path.
    pub used: u64,
    /// The others, by reason; a reason that lost none is absent.
    pub lost: BTreeMap<Lost, u64>,
    /// Looks at whole frames and at windows, and the pixels searched in each kind.
    pub searched: Searched,
}

/// What the search has cost.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Searched {
    /// Frames searched as a whole.
    pub whole_frames: u64,
    /// Windows searched where the tag was expected.
    pub windows: u64,
    /// Pixels in those windows together.
    pub window_pixels: u64,
}

impl TrackTally {
    pub(super) fn lose(&mut self, reason: Lost) {
        *self.lost.entry(reason).or_default() += 1;
    }

    /// A frame that was used is not any more.
    pub(super) fn withdraw(&mut self, reason: Lost) {
        self.used -= 1;
        self.lose(reason);
    }

    /// Frames lost for any reason.
    #[must_use]
    pub fn n_lost(&self) -> u64 {
        self.lost.values().sum()
    }

    /// Whether every frame is accounted for.
    #[must_use]
    pub fn balances(&self) -> bool {
        self.seen == self.used + self.n_lost()
    }

    /// The reasons with their counts in words, the most frequent first.
    #[must_use]
    pub fn reasons(&self) -> String {
        let mut lost: Vec<_> = self.lost.iter().collect();
        lost.sort_by_key(|(_, n)| std::cmp::Reverse(**n));
        let parts: Vec<_> = lost.iter().map(|(why, n)| format!("{n} {}", why.says())).collect();
        parts.join(", ")
    }
}
