//! Log-intensity signal of each event pixel, reconstructed from a session's frames.
//!
//! [`reconstruct_target()`] estimates a radiance map of the printed target from the Pi's raw frames
//! (millimetres on the target, finer than either camera's pixels), the path of the camera head over
//! it and the row time. Poses start from the tag and are refined by Gauss-Newton against the map,
//! row by row. [`align_davis()`] estimates how the event camera sits beside the Pi camera and how
//! late its clock is, from the tag and then photometrically. [`SceneDrive`] is the resulting drive:
//! the map blurred by the optics of the event pixels and sampled along the path at any time.
//!
//! [`FramesDrive`] takes the drive from frames on the event camera's own pixel grid and needs no
//! other knowledge of the scene.

mod align;
mod blur;
mod corners;
mod davis;
mod drive;
mod error;
mod fall_off;
mod follow;
mod frame_noise;
mod frames;
mod head;
mod locate;
mod looks;
mod map;
mod mosaic;
mod motion;
mod moving_light;
mod path;
mod picture;
mod raster;
mod read_noise;
mod register;
mod robust;
mod shake;
mod splat;
mod squares;
mod start;
mod steady;
mod store;
mod survey;
mod surveyor;
mod tag_fit;
mod tag_rows;
mod tag_tilt;
mod tie;
mod tone;
mod warp;

pub use blur::PointSpread;
pub use davis::DavisTie;
pub use drive::SceneDrive;
pub use error::SceneError;
pub use frames::{FramesDrive, FramesError};
pub use head::{DavisMount, Head};
pub use map::{MapGrid, RadianceMap};
pub use mosaic::RawLight;
pub use moving_light::MovingLight;
pub use path::{HeadPath, PathKnot};
pub use register::Registration;
pub use shake::Shake;
pub use store::{PATH_COLUMNS, Scene, SceneFacts};
pub use survey::{Footage, PiKnown, Seeing, Survey, survey};
pub use tie::{DavisKnown, tie};
pub use tone::Tone;
