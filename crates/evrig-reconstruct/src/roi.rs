//! The tag found, its corners, the track over time, and the picture's region.
//!
//! [`Tracker`] takes frames one after another and ends in a [`Track`]. A tag is sought where the
//! last sightings lead, and in the whole frame when it is not there; its black square is fitted to
//! the grey image (see `corners`), through the lens, each corner at its own row's time; a smoother
//! makes the path (see `state` and `smooth`). [`Track::at`] gives the target at any time,
//! [`View::roi`] the picture's region.
//!
//! Raw mosaics are searched at half resolution (mean of each cell of four, own code, since the
//! image library's demosaicing knows 8 bits only), and fitted at full resolution with the four
//! places of a cell balanced on the tag.
//!
//! # Errors on rendered frames
//! Side 28 to 30 px at 346 x 260, any turn, each corner moved by up to 8 % of the side, 300 frames
//! a row; root mean square distance of the corners (`cargo run --release --example track_table`):
//!
//! | blur, noise | way | found | corner rms |
//! | --- | --- | --- | --- |
//! | 1.0 px, 6 of 255 | this module | 100 % | 0.058 px |
//! | | the library alone | 100 % | 0.140 px |

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
