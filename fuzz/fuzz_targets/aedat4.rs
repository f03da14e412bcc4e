//! See `inputs::aedat4`.
//!
//! `RUSTC_BOOTSTRAP=1 cargo fuzz run --sanitizer none aedat4 target/found corpus/aedat4 --
//! -max_total_time=300` (run in this folder; new inputs go to `target/found`).

#![no_main]

#[path = "../inputs.rs"]
#[allow(dead_code)]
mod inputs;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| inputs::aedat4(bytes));
