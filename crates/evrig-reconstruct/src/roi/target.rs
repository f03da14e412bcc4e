//! Target plane: positions of the tag and the target image.

use evrig_session::rig::TargetDescription;
use serde::{Deserialize, Serialize};

/// Tag and target image in the target plane: millimetres to the right and down from the centre of
/// both together. The image lies to the left of the tag, bottoms aligned; its bottom-right corner
/// is one gap to the left of the tag's bottom-left corner.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct TargetPlane {
    /// Side of the tag's black border.
    pub tag_side_mm: f64,
    /// Side of the target image.
    pub picture_side_mm: f64,
    /// From the image's right edge to the tag's left edge.
    pub gap_mm: f64,
}

impl TargetPlane {
    /// The target of a rig.
    #[must_use]
    pub fn of(target: &TargetDescription) -> Self {
        Self {
            tag_side_mm: target.tag_side.0,
            picture_side_mm: target.picture_side.0,
            gap_mm: target.gap.0,
        }
    }

    /// The tag's corners: bottom left, bottom right, top right, top left, in upright orientation.
    #[must_use]
    pub fn tag_corners_mm(&self) -> [[f64; 2]; 4] {
        let [right, bottom] = self.bottom_right();
        square([right - self.tag_side_mm, bottom], self.tag_side_mm)
    }

    /// Centre of the tag.
    #[must_use]
    pub fn tag_centre_mm(&self) -> [f64; 2] {
        let [right, bottom] = self.bottom_right();
        [right - self.tag_side_mm / 2.0, bottom - self.tag_side_mm / 2.0]
    }

    /// The target image's corners: bottom left, bottom right, top right, top left.
    #[must_use]
    pub fn picture_corners_mm(&self) -> [[f64; 2]; 4] {
        let [right, bottom] = self.bottom_right();
        let left = right - self.tag_side_mm - self.gap_mm - self.picture_side_mm;
        square([left, bottom], self.picture_side_mm)
    }

    /// Centre of the target image.
    #[must_use]
    pub fn picture_centre_mm(&self) -> [f64; 2] {
        let [a, _, c, _] = self.picture_corners_mm();
        [(a[0] + c[0]) / 2.0, (a[1] + c[1]) / 2.0]
    }

    fn bottom_right(&self) -> [f64; 2] {
        let width = self.picture_side_mm + self.gap_mm + self.tag_side_mm;
        [width / 2.0, self.picture_side_mm.max(self.tag_side_mm) / 2.0]
    }
}

/// Corners of a square from its bottom-left one; down is positive.
fn square([left, bottom]: [f64; 2], side: f64) -> [[f64; 2]; 4] {
    let [right, top] = [left + side, bottom - side];
    [[left, bottom], [right, bottom], [right, top], [left, top]]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_image_is_left_of_the_tag_with_aligned_bottoms() {
        let plane = TargetPlane { tag_side_mm: 287.0, picture_side_mm: 861.0, gap_mm: 82.0 };
        let [tag, image] = [plane.tag_corners_mm(), plane.picture_corners_mm()];
        assert_eq!(tag[0][0] - image[1][0], 82.0);
        assert_eq!(tag[0][1], image[1][1]);
        // Together they are centred: width 861 + 82 + 287 = 1230, height 861.
        assert_eq!((image[3], tag[1]), ([-615.0, -430.5], [615.0, 430.5]));
        assert_eq!(plane.tag_centre_mm(), [471.5, 287.0]);
        assert_eq!(plane.picture_centre_mm(), [-184.5, 0.0]);
    }
}
