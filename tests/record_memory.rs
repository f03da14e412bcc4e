//! A recording needs no more memory than its queues and writers, however fast the cameras are.
//! The test has its own process because it measures the memory of the whole process.

#![allow(clippy::expect_used, clippy::unwrap_used, unreachable_pub)]
#![cfg(target_os = "linux")]

#[path = "../benches/record/load.rs"]
#[allow(dead_code)]
mod load;

use evrig::record::recorder::RecorderTally;
use evrig::record::{DryRun, StopRequest, StopToken, dry_run};
use load::{Load, Pace};
use std::time::Duration;

/// Capacity of a queue in this test; in a recording it is 512 MiB.
const QUEUE_BYTES: usize = 16 << 20;
/// Memory of writers, pipes and readers: two chunks of the log, a frame in every processing step,
/// packets. The queues are filled many times during the test.
const OTHER_BYTES: usize = 96 << 20;
/// Samples that each camera offers, 1.5 MB each: in total more than thirty times its queue.
const N_SAMPLES: u64 = 400;

fn status_bytes(key: &str) -> usize {
    let text = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = text.lines().find_map(|line| line.strip_prefix(key)).unwrap();
    line.trim().trim_end_matches(" kB").parse::<usize>().unwrap() << 10
}

#[test]
fn drops_are_counted_and_memory_is_bounded_by_the_queues_when_cameras_outrun_the_writers() {
    let (load, mut recorders) = Load::new(Pace::Unpaced(N_SAMPLES));
    let before = status_bytes("VmRSS:");
    // Stopped once both cameras have ended.
    let stop = StopToken::default();
    let length = Duration::from_secs(3600);
    let rehearsal = DryRun { queue_bytes: QUEUE_BYTES, ..DryRun::of(length) };
    let mut watch = |_, _: &[RecorderTally]| {
        if load.has_ended() {
            stop.request(StopRequest::AtOnce);
        }
    };
    let rehearsed = dry_run(&mut recorders, rehearsal, &stop, &mut watch).unwrap();
    for tally in &rehearsed.tallies {
        assert_eq!(tally.n_samples + tally.n_dropped, N_SAMPLES);
    }
    let n_dropped: u64 = rehearsed.tallies.iter().map(|tally| tally.n_dropped).sum();
    assert!(n_dropped > 0, "the queues were never full");
    let (made, check) = (load.made(), &rehearsed.check);
    assert_eq!((check.n_events, check.event_sum), (made.n_events, made.event_sum));
    assert_eq!((check.n_raw, check.raw_sum), (made.n_raw, made.raw_sum));
    assert_eq!((check.n_rgb, check.rgb_sum), (made.n_rgb, made.rgb_sum));
    let gaps_alone = |problem: &String| problem.contains("do not follow one another");
    assert!(check.problems.iter().all(gaps_alone), "{:?}", check.problems);
    let grown = status_bytes("VmHWM:") - before;
    let bound = 2 * QUEUE_BYTES + OTHER_BYTES;
    assert!(grown <= bound, "{} MB of at most {} MB", grown >> 20, bound >> 20);
}
