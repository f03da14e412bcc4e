//! See `inputs::recordings`.
//!
//! `RUSTC_BOOTSTRAP=1 cargo fuzz run --sanitizer none recordings target/found corpus/recordings --
//! -max_total_time=300` (run in this folder; new inputs go to `target/found`).

#![no_main]

#[path = "../inputs.rs"]
#[allow(dead_code)]
mod inputs;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| inputs::recordings(bytes));
