//! Motion-compensated frame interpolation and warping for a plane of known motion.
//!
//! Between two frames an edge moves; it does not fade. Where the frames show a plane whose motion
//! in the image is known, a pixel at any time maps to a point of the plane, and that point is
//! sampled in the frame before and in the frame after. The two samples are blended linearly in
//! time. Rows of a rolling shutter are sampled at their own times, so the output is of one instant.
//!
//! Objects outside the plane are moved as if they lay in it.

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
