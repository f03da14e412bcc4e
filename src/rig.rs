//! The rig: what stands on the table, read from a description file.

mod pose;

pub use pose::{Joints, Pose};
