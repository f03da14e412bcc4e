//! The tag found, its corners, the track over time, and the picture's region.

mod corners;
mod detect;
mod fit;
mod grey;
mod lens;
mod sighting;
mod smooth;
mod state;
mod target;
mod track;
mod tracker;

#[cfg(test)]
mod render;

pub use grey::Light;
pub use lens::Lens;
pub use sighting::{Lost, Searched, Sighting, TrackTally};
pub use target::TargetPlane;
pub use track::{Gap, Knot, Loss, NoPath, Quality, Roi, Track, View};
pub use tracker::{TrackError, TrackOptions, Tracker};

#[cfg(test)]
mod tests;
