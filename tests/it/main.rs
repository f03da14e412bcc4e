//! Files and stages: imports, processing, datasets, exports, reports and concealed trials.

#![allow(
    clippy::expect_used,
    clippy::print_stderr,
    clippy::print_stdout,
    clippy::unwrap_used,
    unreachable_pub
)]

#[path = "../support/cluster.rs"]
mod cluster;
#[path = "../support/devtools.rs"]
mod devtools;
#[path = "../../fuzz/inputs.rs"]
mod inputs;
#[path = "../support/sessions.rs"]
mod sessions;
#[path = "../support/small_rig.rs"]
mod small_rig;
#[path = "../support/synthetic.rs"]
mod synthetic;

mod aedat4;
mod aedat4_dv;
mod camera_report;
mod dataset;
mod export;
mod external_simulators;
mod fuzz_corpus;
mod generate_input;
mod hdf5_python;
mod import_frames;
mod import_raw2event;
mod import_recordings;
mod main_job;
mod paper_table;
mod prove;
mod published_layout;
mod report_page;
mod scene;
#[cfg(target_os = "linux")]
mod slurm;
mod target;
mod variants;
