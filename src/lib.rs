//! evrig records paired raw, RGB and event-camera data on a robot-arm rig, and
//! explains where simulated and real events differ.
//!
//! # The map of the house
//! A module uses only those above it in this list; `tests/architecture.rs` holds it to that.
//!
//! | room | what it is |
//! | --- | --- |
//! | [`units`], [`time`], [`stats`], [`geometry`] | vocabulary: units, clocks, estimates, grids; no I/O |
//! | [`event`], [`frame`], [`imu`] | the data that flow: event columns, frames with exposure and row timing, inertial samples |
//! | [`drive`] | the light signal of an event pixel, at any time |
//! | [`effect_id`] | the names of physical effects and of their parameters; no code |
//! | [`format`](mod@format) | one file a format, bytes in and values out, bounded memory |
//! | [`rig`], [`trajectory`] | descriptions read, checked, explained; path to timed poses; reach, joint, speed limits |
//! | [`session`] | the on-disk contract: layout, manifest, journal, verify, imports |
//! | [`device`] | the devices, and the simulated world that simulated devices live in |
//! | [`record`] | the engine: from preflight to a sealed session, in explicit states |
//! | [`generate`] | brightness to events; pure |
//! | [`roi`] | the tag found, tracked on a continuous path with its error; the picture's region |
//! | [`filter`] | hot pixels, background activity, dead time, rate limit; every event has a fate |
//! | [`clock`] | SensorTimestamp to Unix, each map with its error; offset from motion that both cameras saw |
//! | [`scene`] | what the event pixels looked at: their light signal |
//! | [`calibrate`] | the generator's constants from frames and real events, each with its error |
//! | [`predict`] | the events that were seen against the light: how likely they are, what is left over |
//! | [`compare`] | real against simulated events, one measure a file, each with its error |
//! | [`diagnose`] | what the prediction leaves over: which physical effect is missing, what it buys, when to abstain |
//! | [`report`] | the page and the terminal table that show results; plots as pure functions |
//! | [`pipeline`] | stages: input checksums to outputs, what is stale |
//! | [`export`] | streams in the formats other programs read, with what is needed to use them |
//! | [`batch`] | the same stages over a dataset, here or on Slurm: index, splits, card, comparison |
//! | [`prove`] | concealed trials: what is hidden, sealed, found again and counted |
//! | [`live`] | what devices see now, to viewers: rates, frames with the tag, events; nothing waits for them |
//! | [`commands`], [`cli`] | one file a verb; clap definitions only in `cli` |
//!
//! # Invariants
//! 1. Analysis reads sessions and nothing else; a session copied to another machine
//!    analyses to the same bytes (same seed, same threads or not).
//! 2. Recorded streams are never rewritten; every stage writes new files beside them.
//! 3. Corrected time is never stored without the raw stamp and the map that corrected it.
//! 4. Every count in a report is recomputed from files, not taken from what a device said.
//! 5. Randomness is always a seeded generator passed in; the seed is in the manifest.

pub mod batch;
pub mod calibrate;
pub mod cli;
pub mod clock;
pub mod commands;
pub mod compare;
pub mod device;
pub mod diagnose;
pub mod drive;
pub mod effect_id;
pub mod event;
pub mod export;
pub mod filter;
pub mod format;
pub mod frame;
pub mod generate;
pub mod geometry;
pub mod imu;
pub mod live;
pub mod pipeline;
pub mod predict;
pub mod prove;
pub mod record;
pub mod report;
pub mod rig;
pub mod roi;
pub mod scene;
pub mod session;
pub mod stats;
pub mod time;
pub mod trajectory;
pub mod units;
