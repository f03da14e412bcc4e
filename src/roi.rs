//! The tag found, its corners, the track over time, and the picture's region.

mod corners;
mod detect;
mod fit;
mod grey;
mod lens;
mod observe;
mod sighting;
mod smooth;
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
pub use target::TargetPlane;
pub use track::{Gap, Knot, Loss, NoPath, Quality, Roi, Track, View};
pub use track_error::TrackError;
pub use tracker::{TrackOptions, Tracker};

#[cfg(test)]
mod tests;
