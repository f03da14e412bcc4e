//! evrig records paired raw, RGB and event-camera data on a robot-arm rig, and
//! explains where simulated and real events differ.
//!
//! # Crates
//! A crate uses only crates above it in this list; its `Cargo.toml` holds it to that.
//!
//! | crate | contents |
//! | --- | --- |
//! | `evrig-core` | units, clocks, estimates, geometry; event columns, frames, inertial samples; the log-intensity signal ([`drive`]); names of physical effects |
//! | `evrig-format` | [`mod@format`]: one module per file format, bytes in and values out, bounded memory |
//! | `evrig-session` | [`rig`] and [`trajectory`] descriptions; the [`session`] directory: layout, manifest, journal, verification, imports |
//! | `evrig-pi` | [`pi`]: the agent on the Raspberry Pi and its wire protocol (depends on `evrig-core` alone) |
//! | `evrig-record` | [`record`]: device traits, and the engine from preflight to a sealed session; knows no driver |
//! | `evrig-device` | [`device`]: drivers of arm, cameras and stimulus screen |
//! | `evrig-sim` | [`sim`]: the physics of the simulated rig, and its devices on the real wires |
//! | `evrig-generate` | [`generate`]: log intensity to events, by published laws and with physical effects |
//! | `evrig-reconstruct` | [`clock`] maps with errors, [`roi`]: the target's track, [`scene`]: the log-intensity signal of each event pixel |
//! | `evrig-analysis` | [`filter`], [`predict`] (likelihood of recorded events), [`calibrate`], [`compare`], [`diagnose`] |
//! | `evrig-report` | [`report`]: pages, tables and plots as pure functions |
//! | `evrig` | [`pipeline`] stages, [`export`], [`batch`] over datasets, [`prove`] (concealed trials), [`live`] view, [`commands`] and [`cli`] |
//!
//! Missing dependencies separate what must not know each other: acquisition (`evrig-record`,
//! `evrig-device`) from analysis, and the simulated world (`evrig-sim`) from the generators and the
//! diagnosis that are proven on it.
//!
//! # Invariants
//! 1. Analysis reads sessions and nothing else; a session copied to another machine
//!    analyses to the same bytes (same seed, same threads or not).
//! 2. Recorded streams are never rewritten; every stage writes new files beside them.
//! 3. Corrected time is never stored without the raw stamp and the map that corrected it.
//! 4. The recording engine knows no device by name; the simulated rig is another rig file.
//! 5. Stopping the arm depends on no other device, no lock held elsewhere and no allocation that
//!    can fail: a guard process owns the serial port and stops the arm when its pipe closes.
//! 6. Every count in a report is recomputed from files, not taken from what a device reported.
//! 7. Randomness is always a seeded generator passed in; the seed is in the manifest.

pub use evrig_analysis::{calibrate, camera_report, compare, diagnose, filter, predict};
pub use evrig_core::{
    delivery, drive, effect_id, event, frame, geometry, imu, pi_camera, raw10, stats, time, units,
};
pub use evrig_device as device;
pub use evrig_format as format;
pub use evrig_generate as generate;
pub use evrig_pi as pi;
pub use evrig_reconstruct::{clock, roi, scene};
pub use evrig_record as record;
pub use evrig_report as report;
pub use evrig_session as session;
pub use evrig_session::{rig, trajectory};
pub use evrig_sim as sim;

pub mod batch;
pub mod cli;
pub mod commands;
pub mod drivers;
pub mod export;
pub mod live;
pub mod pipeline;
pub mod program;
pub mod prove;
