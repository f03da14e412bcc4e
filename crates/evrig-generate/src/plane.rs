//! Frames between frames of a plane that moves through the picture.
//!
//! What a pixel saw between two frames is not between what it saw in them: an edge moves on, it
//! does not fade. Where the frames show a plane whose way through the picture is known, a pixel at
//! any time is a place on the plane, and that place is found in the frame before and in the frame
//! after. Both are taken there and faded into each other, so that nothing jumps when the next pair
//! begins; the frames' own rhythm leaves the events. Rows that saw their light one after another
//! (a rolling shutter) are found at their own times: what comes out is of one instant.
//!
//! Whatever does not lie in the plane is moved as if it did.

mod frame_mapping;
mod interpolator;
mod mesh;
mod path;
mod sample;
mod warp;

pub use interpolator::PlaneInterpolator;
pub use path::PlanePath;
pub use warp::PlaneWarper;

#[cfg(test)]
mod tests;
