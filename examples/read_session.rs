//! Reads a session: its streams, its events between two frames, and the results of its stages.
//!
//! ```sh
//! cargo run --example read_session -- sessions/street
//! ```

#![allow(clippy::print_stdout)]

use evrig::pipeline::{read_comparison, read_diagnosis};
use evrig::session::{Session, StreamKind};
use std::error::Error;
use std::path::PathBuf;

fn main() -> Result<(), Box<dyn Error>> {
    let root: PathBuf = std::env::args_os().nth(1).ok_or("usage: read_session SESSION")?.into();
    let session = Session::open(&root)?;
    for stream in &session.manifest().streams {
        println!("{:<12} {:<9} {:>10}", stream.name, stream.kind.to_string(), stream.count);
    }
    for loss in &session.manifest().losses {
        println!("lost: {}: {}", loss.stream, loss.what);
    }

    // Events are inside the sensor and sorted by time; others are counted and left out.
    let (events, tally) = session.events("real")?;
    println!("real: {} events of {} in the file", tally.kept, tally.seen);

    // Frames on the event camera's clock divide the events; the Pi's need `evrig sync` first.
    let frames = session.manifest().streams.iter().find(|stream| {
        stream.kind == StreamKind::Frames && !session.is_from_pi(&stream.name).unwrap_or(true)
    });
    if let Some(stream) = frames {
        let mut before: Option<i64> = None;
        for frame in session.luminance(&stream.name)?.take(4) {
            let at = frame?.t_us;
            if let Some(before) = before {
                let between = events.as_slice().between(before, at);
                println!(
                    "{before} to {at} us: {} events, {} ON",
                    between.len(),
                    between.count_on()
                );
            }
            before = Some(at);
        }
    }

    for name in session.generated_names() {
        if let Some(comparison) = read_comparison(&session, &name)? {
            for measure in &comparison.measures {
                println!("{name}: {} = {:.3}", measure.name, measure.estimate);
            }
        }
    }
    if let Some(diagnosis) = read_diagnosis(&session)? {
        for effect in &diagnosis.effects {
            println!("{}: {}", effect.name, effect.description);
        }
    }
    Ok(())
}
