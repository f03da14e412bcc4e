//! Any bytes from the serial line: nothing panics, nothing is lost, nothing grows.

#![no_main]

use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| evrig::device::dobot::frame::fuzz(bytes));
