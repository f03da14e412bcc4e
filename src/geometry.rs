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

    /// Whether the pixel lies on the grid.
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

impl std::fmt::Display for Size {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} x {}", self.width, self.height)
    }
}
