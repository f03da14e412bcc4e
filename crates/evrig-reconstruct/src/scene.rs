//! What the event pixels looked at: the light signal of a session.
//!
//! [`survey()`] makes a map of the print from the Pi's raw frames, in millimetres on the print and
//! finer than either camera's pixels, together with the path of the head over it: the tag to start
//! with, then every frame's pose against the map by the light itself (Gauss-Newton on the marks of
//! the map, row-true), and the row time with them. [`tie()`] finds how the event camera sits beside
//! the Pi camera and how late its clock is: by the tag in its frames to start with, then by their
//! light. [`SceneDrive`] is the drive that follows: the map seen through the event pixels' own
//! optics, along the path, at any time.
//!
//! [`FramesDrive`] takes the drive from the event camera's own pixel grid, frame by frame, where
//! nothing else is known of the scene.

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
