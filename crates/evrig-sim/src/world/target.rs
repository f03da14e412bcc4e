//! The target: image to the left, tag to the right, bottoms aligned, grey patches above the tag.

use super::description::PrintedTargetDescription;
use super::error::WorldError;
use super::target_image::TargetImage;
use evrig_session::rig::TargetDescription;
use evrig_session::rig::tag;

/// Reflectances of the six patches as shares of white: steps of a factor of 1.74.
const PATCHES: [f64; 6] = [0.80, 0.46, 0.264, 0.152, 0.0873, 0.0502];

/// White paper around the target that is still sampled, so that blurred edges end in white.
const MARGIN_MM: f64 = 4.0;

/// Reflectance everywhere on the sheet. Coordinates are millimetres on the target, right and down
/// from the middle of image and tag together; beyond them the paper is white.
#[derive(Debug, Clone)]
pub(super) struct PrintedTarget {
    image: TargetImage,
    white: f64,
    black: f64,
    has_patches: bool,
    image_side: f64,
    tag_side: f64,
    gap: f64,
}

impl PrintedTarget {
    /// The target of a target.
    pub(super) fn new(
        description: &PrintedTargetDescription,
        target: &TargetDescription,
    ) -> Result<Self, WorldError> {
        if target.tag_family != "tag36h11" || target.tag_id != 0 {
            let (family, id) = (target.tag_family.clone(), target.tag_id);
            return Err(WorldError::Tag { family, id });
        }
        Ok(Self {
            image: TargetImage::named(&description.image)?,
            white: description.white,
            black: description.black,
            has_patches: description.patches,
            image_side: target.picture_side.0,
            tag_side: target.tag_side.0,
            gap: target.gap.0,
        })
    }

    /// Half width and half height of image and tag together.
    fn half(&self) -> [f64; 2] {
        let width = self.image_side + self.gap + self.tag_side;
        [width / 2.0, self.image_side.max(self.tag_side) / 2.0]
    }

    /// Left, top, right and bottom of what is not bare paper, with a margin.
    pub(super) fn bounds_mm(&self) -> [f64; 4] {
        let [x, y] = self.half();
        [-x - MARGIN_MM, -y - MARGIN_MM, x + MARGIN_MM, y + MARGIN_MM]
    }

    /// Reflectance of bare paper.
    pub(super) fn white(&self) -> f64 {
        self.white
    }

    /// Corners of the tag's black border, clockwise from the top left.
    pub(super) fn tag_corners_mm(&self) -> [[f64; 2]; 4] {
        let [right, bottom] = self.half();
        let (left, top) = (right - self.tag_side, bottom - self.tag_side);
        [[left, top], [right, top], [right, bottom], [left, bottom]]
    }

    /// Reflectance at a place.
    pub(super) fn reflectance(&self, x: f64, y: f64) -> f64 {
        let [half_width, half_height] = self.half();
        let (from_left, to_bottom) = (x + half_width, half_height - y);
        let in_image = (0.0..self.image_side).contains(&from_left)
            && (0.0..self.image_side).contains(&to_bottom);
        if in_image {
            let (right, up) = (from_left / self.image_side, to_bottom / self.image_side);
            let down = 1.0 - up;
            let ink = self.image.reflectance(right, down, self.image_side, self.black);
            return self.white * ink;
        }
        let from_tag = from_left - self.image_side - self.gap;
        if !(0.0..self.tag_side).contains(&from_tag) {
            return self.white;
        }
        if (0.0..self.tag_side).contains(&to_bottom) {
            let down = 1.0 - to_bottom / self.tag_side;
            let is_white = tag::is_white(from_tag / self.tag_side, down);
            return if is_white { self.white } else { self.white * self.black };
        }
        self.patch(from_tag, to_bottom - self.tag_side - self.gap).unwrap_or(self.white)
    }

    /// Two columns of three patches over the tag, one gap above it.
    fn patch(&self, from_left: f64, up: f64) -> Option<f64> {
        let side = self.tag_side / 2.0;
        let fits = self.tag_side + self.gap + 3.0 * side <= self.image_side;
        if !self.has_patches || !fits || !(0.0..3.0 * side).contains(&up) {
            return None;
        }
        let column = ((from_left / side) as usize).min(1);
        let row = ((up / side) as usize).min(2);
        Some(self.white * PATCHES[2 * row + column])
    }
}
