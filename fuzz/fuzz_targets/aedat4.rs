//! Any bytes as an AEDAT4 file and as a socket: packets, then at most one error, and an end.
//!
//! `RUSTC_BOOTSTRAP=1 cargo fuzz run aedat4 -- -max_total_time=60`

#![no_main]

use evrig::format::aedat4::Reader;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    for reader in [Reader::new(bytes, "fuzz"), Reader::from_stream(bytes, "fuzz")].into_iter().flatten() {
        let n_errors = reader.filter(Result::is_err).count();
        assert!(n_errors <= 1);
    }
});
