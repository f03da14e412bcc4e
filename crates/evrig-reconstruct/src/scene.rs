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

mod accumulate;
mod align_davis;
mod bilinear;
mod clustered_covariance;
mod coarse_grid;
mod davis_alignment;
mod davis_image;
mod drive;
mod error;
mod frame_view;
mod frames;
mod head;
mod interpolation;
mod locate;
mod map;
mod map_builder;
mod map_samples;
mod moving_illumination;
mod optical_flow;
mod patch;
mod path;
mod photometric;
mod pi_camera;
mod pi_inputs;
mod pixel_noise;
mod point_spread;
mod pose_tracking;
mod raster;
mod read_noise;
mod reconstruction;
mod registration;
mod store;
mod tag_alignment;
mod tag_pose;
mod tag_row_time;
mod tag_tilt;
mod temporal_denoising;
mod tone;
mod vibration;
mod vignetting;
mod warp;

pub use align_davis::{DavisInputs, align_davis};
pub use davis_alignment::DavisAlignment;
pub use drive::SceneDrive;
pub use error::SceneError;
pub use frames::{FramesDrive, FramesError};
pub use head::{DavisMount, HeadGeometry};
pub use map::{MapGrid, RadianceMap};
pub use moving_illumination::MovingIllumination;
pub use path::{HeadPath, PathKnot};
pub use pi_camera::RawLevels;
pub use pi_inputs::{FrameVisitor, PiInputs, RawFrames};
pub use point_spread::PointSpread;
pub use reconstruction::{Reconstruction, reconstruct_target};
pub use registration::Registration;
pub use store::{PATH_COLUMNS, Scene, SceneParameters};
pub use tone::ToneFit;
pub use vibration::HeadVibration;
