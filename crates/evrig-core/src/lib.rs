//! Shared types of evrig: units, clocks, estimates and geometry, and the data that its
//! crates exchange. Nothing here performs I/O.

pub mod delivery;
pub mod drive;
pub mod effect_id;
pub mod event;
pub mod finding;
pub mod frame;
pub mod geometry;
pub mod imu;
pub mod keyword;
pub mod pi_camera;
pub mod raw10;
pub mod stats;
pub mod time;
pub mod units;
