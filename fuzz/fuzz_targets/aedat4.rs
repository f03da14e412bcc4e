//! Any bytes as an AEDAT4 file and as a socket: packets, then at most one error, and an end.
//!
//! `RUSTC_BOOTSTRAP=1 cargo fuzz run --sanitizer none aedat4 target/found corpus/aedat4 -- -max_total_time=300`
//! (in this folder; finds go to `target/found`. `-set_cover_merge=1 -use_counters=0 -max_len=2048`
//! picked the corpus from them, to which inputs that once crashed were added.)

#![no_main]

use evrig::format::aedat4::Reader;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    for reader in
        [Reader::new(bytes, "fuzz"), Reader::from_stream(bytes, "fuzz")].into_iter().flatten()
    {
        let n_errors = reader.filter(Result::is_err).count();
        assert!(n_errors <= 1);
    }
});
