//! Grids, regions and homographies.

mod homography;

pub use homography::{Homography, HomographyError, UncertainHomography};

use serde::{Deserialize, Serialize};

/// Width and height of a pixel grid.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Size {
    /// Columns.
    pub width: u16,
    /// Rows.
    pub height: u16,
}

impl Size {
    /// The DAVIS346's grid.
    pub const DAVIS346: Self = Self { width: 346, height: 260 };

    /// A grid of the given columns and rows.
    #[must_use]
    pub const fn new(width: u16, height: u16) -> Self {
        Self { width, height }
    }

    /// Number of pixels.
    #[must_use]
    pub const fn n_pixels(self) -> usize {
        self.width as usize * self.height as usize
    }

    /// Whether the pixel is on the grid.
    #[must_use]
    pub const fn contains(self, x: u16, y: u16) -> bool {
        x < self.width && y < self.height
    }

    /// Row-major index of a pixel on the grid.
    #[must_use]
    pub const fn index(self, x: u16, y: u16) -> usize {
        y as usize * self.width as usize + x as usize
    }
}

/// A rectangle of pixels: columns `x_px[0]..x_px[1]`, rows `y_px[0]..y_px[1]`, ends not included.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rectangle {
    /// Columns.
    pub x_px: [u16; 2],
    /// Rows.
    pub y_px: [u16; 2],
}

impl Rectangle {
    /// Whether the pixel is inside.
    #[must_use]
    pub fn contains(&self, x: u16, y: u16) -> bool {
        (self.x_px[0]..self.x_px[1]).contains(&x) && (self.y_px[0]..self.y_px[1]).contains(&y)
    }

    /// Pixels in it.
    #[must_use]
    pub fn area(&self) -> u64 {
        let side = |[low, high]: [u16; 2]| u64::from(high.saturating_sub(low));
        side(self.x_px) * side(self.y_px)
    }

    /// Pixels in both.
    #[must_use]
    pub fn shared(&self, other: &Self) -> u64 {
        let both = |a: [u16; 2], b: [u16; 2]| [a[0].max(b[0]), a[1].min(b[1])];
        Self { x_px: both(self.x_px, other.x_px), y_px: both(self.y_px, other.y_px) }.area()
    }
}

impl std::fmt::Display for Size {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} x {}", self.width, self.height)
    }
}
