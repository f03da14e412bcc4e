//! Times reading and writing of AEDAT4 for `benches/aedat4.py`, which compares libraries.
//!
//! `make RECORDING N OUT` writes N events, tiles of a real recording shifted over the sensor;
//! `decode FILE` and `encode FILE COMPRESSION OUT` time the library; `copy BYTES` times memory.
//! Each prints one line of JSON. Without arguments (plain `cargo bench`) nothing is measured.

#![allow(clippy::print_stdout)]

use anyhow::{Context, Result, bail};
use evrig::event::{Event, Events};
use evrig::format::aedat4::{Compression, Content, Reader, StreamSpec, Writer};
use evrig::geometry::Size;
use std::hint::black_box;
use std::time::Instant;

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|a| a != "--bench").collect();
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    match arguments.as_slice() {
        [] => println!("run benches/aedat4.py, which compares this program with other libraries"),
        ["make", recording, n, out] => make(recording, n.parse()?, out)?,
        ["decode", file] => decode(file)?,
        ["encode", file, compression, out] => encode(file, compression, out)?,
        ["copy", n_bytes] => copy(n_bytes.parse()?),
        other => bail!("unknown arguments {other:?}"),
    }
    Ok(())
}

/// Wall time and processor time (all threads) since the start.
struct TimeMeter(Instant, f64);

fn cpu_seconds() -> f64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}

impl TimeMeter {
    fn start() -> Self {
        Self(Instant::now(), cpu_seconds())
    }

    fn report(self, n_events: usize) {
        let (seconds, cpu) = (self.0.elapsed().as_secs_f64(), cpu_seconds() - self.1);
        println!("{{\"seconds\": {seconds}, \"cpu_seconds\": {cpu}, \"events\": {n_events}}}");
    }
}

fn events_of(file: &str) -> Result<Events> {
    let mut all = Events::new();
    for packet in Reader::open(file)? {
        if let Content::Events(events) = packet?.content {
            all.extend_from_slice(events.as_slice());
        }
    }
    Ok(all)
}

/// Tiles of the recording, consecutive in time, each shifted differently over the sensor so that a
/// compressor finds no tile in the previous one.
fn make(recording: &str, n: usize, out: &str) -> Result<()> {
    let tile = events_of(recording)?;
    let tile = tile.as_slice();
    let (first, last) = tile.t.first().zip(tile.t.last()).context("the recording has no events")?;
    let period = last - first + 1;
    let moved = |i: usize| {
        let (k, event) = (i / tile.len(), tile.get(i % tile.len()));
        let x = (usize::from(event.x) + k * 89) % 346;
        let y = (usize::from(event.y) + k * 157) % 260;
        Event { t: event.t + k as i64 * period, x: x as u16, y: y as u16, on: event.on }
    };
    let events: Events = (0..n).map(moved).collect();
    let streams = [StreamSpec::events(Size::DAVIS346, "bench")];
    let meter = TimeMeter::start();
    let mut writer = Writer::create(out, Compression::None, &streams)?;
    writer.write_events(0, events.as_slice())?;
    writer.finish()?;
    meter.report(n);
    Ok(())
}

fn decode(file: &str) -> Result<()> {
    let meter = TimeMeter::start();
    let mut n_events = 0;
    let mut reader = Reader::open(file)?;
    while let Some(packet) = reader.next() {
        if let Content::Events(events) = black_box(packet?.content) {
            n_events += events.len();
            reader.recycle(events);
        }
    }
    meter.report(n_events);
    Ok(())
}

fn encode(file: &str, compression: &str, out: &str) -> Result<()> {
    let compression = match compression {
        "none" => Compression::None,
        "lz4" => Compression::Lz4,
        "zstd" => Compression::Zstd,
        other => bail!("unknown compression {other}"),
    };
    let events = events_of(file)?;
    let streams = [StreamSpec::events(Size::DAVIS346, "bench")];
    let meter = TimeMeter::start();
    let mut writer = Writer::create(out, compression, &streams)?;
    writer.write_events(0, events.as_slice())?;
    writer.finish()?;
    meter.report(events.len());
    Ok(())
}

/// Best of five copies between two buffers in memory.
fn copy(n_bytes: usize) {
    let from = vec![1_u8; n_bytes];
    let mut to = vec![2_u8; n_bytes];
    let mut best = f64::INFINITY;
    for _ in 0..5 {
        let start = Instant::now();
        to.copy_from_slice(black_box(&from));
        black_box(&mut to);
        best = best.min(start.elapsed().as_secs_f64());
    }
    println!("{{\"seconds\": {best}, \"bytes\": {n_bytes}}}");
}
