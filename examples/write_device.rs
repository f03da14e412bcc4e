//! A device of one's own: an event camera that is a function, as the recording engine drives it.
//!
//! ```sh
//! cargo run --example write_device
//! ```
//! A device keeps six promises ([`Recorder`]): it looks before it sets, `start` returns once
//! samples flow, samples that do not fit are counted, `finish` hands over what was under way,
//! `abort` works in any state. `CONTRIBUTING.md` states how to add its key to the rig file.

#![allow(clippy::print_stdout)]

use evrig::event::{Event, Events};
use evrig::format::aedat4::{Content, StreamSpec};
use evrig::geometry::Size;
use evrig::record::Finding;
use evrig::record::host_clock;
use evrig::record::recorder::{
    PreparedRecorder, Received, Recorder, RecorderError, RecorderSample, RecorderTally,
    SampleSender, channel,
};
use evrig::session::HostTime;
use evrig::time::Stamp;
use std::error::Error;
use std::time::{Duration, SystemTime};

const SIZE: Size = Size::new(64, 48);

/// A spot that runs along the diagonal, a packet each time it is looked at.
#[derive(Default)]
struct Spot {
    outlet: Option<SampleSender>,
    tally: RecorderTally,
    n_packets: i64,
}

impl Spot {
    fn deliver(&mut self) {
        let Some(outlet) = &self.outlet else { return };
        let start = self.n_packets * 1_000;
        let events: Events = (0..10)
            .map(|i| {
                let at = ((self.n_packets * 10 + i) % 48) as u16;
                Event { t: start + i * 100, x: at, y: at, on: i % 2 == 0 }
            })
            .collect();
        let n = events.len() as u64;
        let content = Content::Events(events);
        let sample = RecorderSample::Packet { stream: 0, arrived: now(), content };
        // A full queue is a loss to be counted, never one to wait for.
        if outlet.offer(sample) {
            self.tally.n_samples += n;
        } else {
            self.tally.n_dropped += n;
        }
        self.n_packets += 1;
    }
}

/// Both clocks of the host; every sample carries when it was whole.
fn now() -> HostTime {
    let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
    let unix = Stamp::from_nanos(i64::try_from(since.as_nanos()).unwrap_or(i64::MAX));
    HostTime { monotonic: host_clock::now(), unix }
}

impl Recorder for Spot {
    fn name(&self) -> &'static str {
        "davis"
    }

    fn check(&mut self) -> Vec<Finding> {
        vec![Finding::good("identity", "a spot on a diagonal, made by this program")]
    }

    fn prepare(&mut self) -> Result<PreparedRecorder, RecorderError> {
        let description =
            serde_json::json!({ "model": "spot", "columns": SIZE.width, "rows": SIZE.height });
        Ok(PreparedRecorder { description, streams: vec![StreamSpec::events(SIZE, "spot")] })
    }

    fn start(&mut self, outlet: SampleSender) -> Result<(), RecorderError> {
        self.outlet = Some(outlet);
        self.deliver();
        Ok(())
    }

    fn progress(&mut self) -> Result<RecorderTally, RecorderError> {
        self.deliver();
        Ok(self.tally.clone())
    }

    fn finish(&mut self) -> Result<RecorderTally, RecorderError> {
        self.abort();
        Ok(self.tally.clone())
    }

    fn abort(&mut self) {
        // Without its outlet the queue closes, and the writer knows that no more will come.
        self.outlet = None;
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut spot = Spot::default();
    for finding in spot.check() {
        println!("{}: {}", finding.subject, finding.description);
    }
    let prepared = spot.prepare()?;
    println!("{} stream, {}", prepared.streams.len(), prepared.description);
    let (outlet, inlet) = channel(1 << 20);
    spot.start(outlet)?;
    for _ in 0..5 {
        spot.progress()?;
    }
    let tally = spot.finish()?;
    let mut n = 0;
    while let Received::Sample(sample) = inlet.take(Duration::from_secs(1)) {
        n += sample.n_events();
    }
    println!("{} events delivered, {} dropped, {n} taken", tally.n_samples, tally.n_dropped);
    Ok(())
}
