//! However fast the cameras are, a recorder takes no more memory than its queues may hold and its
//! writers need. A test of its own process: it measures the memory of all of it.

#![allow(clippy::expect_used, clippy::unwrap_used)]
#![cfg(target_os = "linux")]

use evrig::device::Finding;
use evrig::device::recorder::{
    Outlet, Prepared, Recorder, RecorderError, Sample, Tally, host_time,
};
use evrig::event::{Event, Events};
use evrig::format::aedat4::{Content, StreamSpec};
use evrig::geometry::Size;
use evrig::record::{Rehearsal, StopToken, rehearse};
use evrig::session::{EventSum, FrameMetadata, PiFrame};
use evrig::time::{Span, Stamp};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::Duration;

/// Room of a queue here; a recording's is 512 MiB.
const QUEUE_BYTES: usize = 16 << 20;
/// What writers, pipes and the reading ends need: a chunk of the log and the next one, a frame in
/// every step of its way, packets. The queues are filled many times over meanwhile.
const BESIDE_BYTES: usize = 96 << 20;
const PACKET_EVENTS: usize = 40_000;
/// Samples each camera offers, in all more than thirty times its queue.
const N_SAMPLES: u64 = 1_000;
const PI: Size = Size::new(692, 520);

#[derive(Clone, Default)]
struct Books {
    taken: Arc<Mutex<(EventSum, u64)>>,
}

/// A camera that waits for nobody.
struct Hasty {
    name: &'static str,
    streams: Vec<StreamSpec>,
    make: fn(u64) -> Sample,
    books: Books,
    tally: Arc<Mutex<Tally>>,
    is_done: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Recorder for Hasty {
    fn name(&self) -> &'static str {
        self.name
    }
    fn check(&mut self) -> Vec<Finding> {
        Vec::new()
    }
    fn prepare(&mut self) -> Result<Prepared, RecorderError> {
        Ok(Prepared { says: serde_json::json!({}), streams: self.streams.clone() })
    }
    fn start(&mut self, outlet: Outlet) -> Result<(), RecorderError> {
        let (make, books, tally) = (self.make, self.books.clone(), Arc::clone(&self.tally));
        let is_done = Arc::clone(&self.is_done);
        self.thread = Some(std::thread::spawn(move || {
            for n in 0..N_SAMPLES {
                let sample = make(n);
                let events = match &sample {
                    Sample::Packet { content: Content::Events(events), .. } => events.clone(),
                    _ => Events::new(),
                };
                let is_taken = outlet.offer(sample);
                let mut tally = tally.lock().unwrap();
                *(if is_taken { &mut tally.n_samples } else { &mut tally.n_dropped }) += 1;
                if is_taken {
                    let mut books = books.taken.lock().unwrap();
                    books.0.take(events.as_slice());
                    books.1 += events.len() as u64;
                }
            }
            is_done.store(true, Ordering::SeqCst);
        }));
        Ok(())
    }
    fn progress(&mut self) -> Result<Tally, RecorderError> {
        Ok(self.tally.lock().unwrap().clone())
    }
    fn finish(&mut self) -> Result<Tally, RecorderError> {
        self.abort();
        self.progress()
    }
    fn abort(&mut self) {
        if let Some(thread) = self.thread.take() {
            thread.join().unwrap();
        }
    }
}

fn packet(n: u64) -> Sample {
    let first = n as i64 * PACKET_EVENTS as i64;
    let events: Events = (first..first + PACKET_EVENTS as i64)
        .map(|t| Event { t, x: (t % 346) as u16, y: (t % 260) as u16, on: t % 3 == 0 })
        .collect();
    Sample::Packet { stream: 0, arrived: host_time(), content: Content::Events(events) }
}

fn frame(sequence: u64) -> Sample {
    let arrived = host_time();
    let metadata = FrameMetadata {
        sequence,
        sensor_timestamp: Stamp::from_micros(sequence as i64),
        frame_wall_clock: None,
        real_time: arrived.unix,
        exposure: Span::from_micros(4_000),
        analogue_gain: 1.0,
        digital_gain: 1.0,
        lens_position: None,
        black_levels: [64; 4],
        size: PI,
        bayer: "RGGB".to_owned(),
        n_dropped: 0,
    };
    let raw10 = Some(vec![0; PI.n_pixels() / 4 * 5]);
    let rgb = Some(vec![7; PI.n_pixels() * 3]);
    Sample::Frame { arrived, frame: Box::new(PiFrame { metadata, raw10, rgb }) }
}

fn status_bytes(key: &str) -> usize {
    let text = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = text.lines().find_map(|line| line.strip_prefix(key)).unwrap();
    line.trim().trim_end_matches(" kB").parse::<usize>().unwrap() << 10
}

#[test]
fn cameras_that_outrun_the_writers_cost_drops_that_are_counted_and_no_more_memory_than_the_queues()
{
    let before = status_bytes("VmRSS:");
    let books = Books::default();
    let is_done: [Arc<AtomicBool>; 2] = Default::default();
    let hasty = |name, streams, make, i: usize| -> Box<dyn Recorder> {
        Box::new(Hasty {
            name,
            streams,
            make,
            books: books.clone(),
            tally: Arc::default(),
            is_done: Arc::clone(&is_done[i]),
            thread: None,
        })
    };
    let events = vec![StreamSpec::events(Size::DAVIS346, "hasty")];
    let mut recorders = [hasty("davis", events, packet, 0), hasty("pi", Vec::new(), frame, 1)];
    // It ends when both cameras have.
    let stop = StopToken::default();
    let length = Duration::from_secs(3600);
    let rehearsal = Rehearsal { length, queue_bytes: QUEUE_BYTES };
    let mut watch = |_, _: &[Tally]| {
        if is_done.iter().all(|is_done| is_done.load(Ordering::SeqCst)) {
            stop.ask(evrig::record::Stop::AtOnce);
        }
    };
    let rehearsed = rehearse(&mut recorders, rehearsal, &stop, &mut watch).unwrap();
    for tally in &rehearsed.tallies {
        assert_eq!(tally.n_samples + tally.n_dropped, N_SAMPLES);
    }
    let n_dropped: u64 = rehearsed.tallies.iter().map(|tally| tally.n_dropped).sum();
    assert!(n_dropped > 0, "the queues were never full, so nothing is shown");
    let taken = books.taken.lock().unwrap();
    let heard = &rehearsed.heard;
    assert_eq!((heard.n_events, heard.event_sum), (taken.1, taken.0.value()));
    assert_eq!([heard.n_raw, heard.n_rgb], [rehearsed.tallies[1].n_samples; 2]);
    let gaps_alone = |problem: &String| problem.contains("do not follow one another");
    assert!(heard.problems.iter().all(gaps_alone), "{:?}", heard.problems);
    let grown = status_bytes("VmHWM:") - before;
    let bound = 2 * QUEUE_BYTES + BESIDE_BYTES;
    assert!(grown <= bound, "{} MB of at most {} MB", grown >> 20, bound >> 20);
}
