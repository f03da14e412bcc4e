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
//!
//! Side 28 to 30 px at 346 x 260, any rotation, each corner moved by up to 8 % of the side, 300
//! frames per row; root-mean-square distance of the corners (`cargo run --release --example
//! track_table`):
//!
//! | blur, noise | method | found | corner rms |
//! | --- | --- | --- | --- |
//! | 1.0 px, 6 of 255 | this module | 100 % | 0.058 px |
//! | | the AprilTag library alone | 100 % | 0.140 px |

mod corners;
mod detect;
mod fit;
mod grey;
mod lens;
mod observe;
mod sighting;
mod smooth;
mod spot;
mod state;
mod target;
mod track;
mod track_error;
mod tracker;

#[cfg(test)]
mod render;

pub use grey::Light;
pub use lens::Lens;
pub use sighting::{Lost, Searched, Sighting, TrackTally};
pub use spot::Spotter;
pub use target::TargetPlane;
pub use track::{Gap, Knot, Loss, NoPath, Quality, Roi, Track, View};
pub use track_error::TrackError;
pub use tracker::{TrackOptions, Tracker};

#[cfg(test)]
mod tests;
