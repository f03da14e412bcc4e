//! Detection of the tag, its track over time, and the region of the target image.
//!
//! [`Tracker`] takes frames in order and returns a [`Track`]. A tag is searched near its predicted
//! position, and in the whole frame when it is not there. Its black square is fitted to the grey
//! image (see `corners`), each corner is undistorted and stamped with the time of its own row, and
//! a smoother estimates the path (see `state` and `smooth`). [`Track::at`] gives the target's pose
//! at any time, [`TargetView::roi`] the region of the target image.
//!
//! Raw Bayer frames are searched at half resolution (mean of each 2 x 2 cell) and fitted at full
//! resolution with the four Bayer sites balanced on the tag.
//!
//! # Errors on rendered frames
//! Side 28 to 30 px at 346 x 260, any rotation, each corner moved by up to 8 % of the side, 300
//! frames per row; root-mean-square distance of the corners (`cargo run --release --example
//! track_table`):
//!
//! | blur, noise | method | found | corner rms |
//! | --- | --- | --- | --- |
//! | 1.0 px, 6 of 255 | this module | 100 % | 0.058 px |
//! | | the AprilTag library alone | 100 % | 0.140 px |

mod corner_fit;
mod detection;
mod grey_image;
mod lens;
mod observe;
mod path_fit;
mod path_state;
mod single_frame;
mod smoother;
mod tag_detector;
mod target;
mod track;
mod track_error;
mod tracker;

#[cfg(test)]
mod render;

pub use detection::{LossReason, Searched, TagDetection, TrackTally};
pub use grey_image::SampleFormat;
pub use lens::Lens;
pub use single_frame::SingleFrameDetector;
pub use target::TargetPlane;
pub use track::{
    LostFrame, Roi, TargetView, Track, TrackGap, TrackKnot, TrackQuality, TrackTimeError,
};
pub use track_error::TrackError;
pub use tracker::{TrackOptions, Tracker};

#[cfg(test)]
mod tests;
