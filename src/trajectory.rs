//! Trajectories: motion descriptions, and the timed poses they become.

mod curve;
mod path;
mod profile;

pub use curve::{Curve, CurveError, Motion};
pub use path::{Path, PathPoint, Rates, Settings, Step};
pub use profile::Trapezoid;
