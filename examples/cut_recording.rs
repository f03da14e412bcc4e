//! Extracts a range of columns and of time from a DAVIS recording, frames and events alike, for
//! split-half checks of a diagnosis.
//!
//! `cargo run --release --example cut_recording -- IN.aedat4 OUT.aedat4 X0 X1 FROM TO`
//!
//! Columns `X0..X1`; the time range is given as fractions of the recording (0 to 1).

#![allow(clippy::print_stdout)]

use evrig::event::{Event, Events};
use evrig::frame::{Frame, Samples};
use evrig::geometry::Size;
use evrig::prove::plasmode::PlasmodeRecording;
use evrig::time::Davis;
use std::error::Error;
use std::ops::Range;
use std::path::Path;

const USAGE: &str = "usage: cut_recording IN.aedat4 OUT.aedat4 X0 X1 FROM TO";

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [from, to, x0, x1, from_share, to_share] = arguments.as_slice() else {
        return Err(USAGE.into());
    };
    let whole = PlasmodeRecording::read(Path::new(from))?;
    let columns: Range<u16> = x0.parse()?..x1.parse::<u16>()?.min(whole.size.width);
    if columns.is_empty() {
        return Err(USAGE.into());
    }
    let times = whole.events.as_slice().t;
    let (first, last) = (times[0], times[times.len() - 1]);
    let at = |share: f64| first + ((last - first) as f64 * share) as i64;
    let time = at(from_share.parse()?)..at(to_share.parse()?);
    let part = cut(&whole, &columns, &time);
    part.write(Path::new(to))?;
    println!("{} events, {} frames, {}", part.events.len(), part.frames.len(), part.size);
    Ok(())
}

fn cut(whole: &PlasmodeRecording, columns: &Range<u16>, time: &Range<i64>) -> PlasmodeRecording {
    let kept = whole.events.as_slice().iter();
    let kept = kept.filter(|e| columns.contains(&e.x) && time.contains(&e.t));
    let events: Events = kept.map(|e| Event { x: e.x - columns.start, ..e }).collect();
    let within = |frame: &&Frame<Davis>| time.contains(&frame.timing.stamp.as_micros());
    let frames = whole.frames.iter().filter(within).map(|frame| narrow(frame, columns)).collect();
    let size = Size { width: columns.end - columns.start, ..whole.size };
    PlasmodeRecording { size, events, frames }
}

fn narrow(frame: &Frame<Davis>, columns: &Range<u16>) -> Frame<Davis> {
    let n = frame.channels.count();
    let width = usize::from(frame.size.width) * n;
    let kept = usize::from(columns.start) * n..usize::from(columns.end) * n;
    let samples = match &frame.samples {
        Samples::U8(all) => {
            Samples::U8(all.chunks(width).flat_map(|row| row[kept.clone()].to_vec()).collect())
        }
        Samples::U16(all) => {
            Samples::U16(all.chunks(width).flat_map(|row| row[kept.clone()].to_vec()).collect())
        }
    };
    let size = Size { width: columns.end - columns.start, ..frame.size };
    Frame { size, samples, ..frame.clone() }
}
