//! Makes a whole session of the simulated rig in virtual time, as fast as the processor allows.
//!
//! `cargo run --release --example simulate_session -- RIG TRAJECTORY WORLD.toml SEED OUT [--no-rgb]
//! [--seconds S]`
//!
//! WORLD.toml describes the world (see `rig/world.toml`); `-` is the nominal world. It is not
//! stored in the session.

#![allow(clippy::print_stdout)]

use evrig::rig::Rig;
use evrig::sim::world::WorldDescription;
use evrig::sim::{Simulation, simulate};
use evrig::time::Span;
use evrig::trajectory::{OptionalSegments, Trajectory};
use std::error::Error;
use std::path::Path;
use std::time::Instant;

const USAGE: &str =
    "usage: simulate_session RIG TRAJECTORY WORLD.toml SEED OUT [--no-rgb] [--seconds S]";

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [rig, trajectory, world, seed, out, flags @ ..] = arguments.as_slice() else {
        return Err(USAGE.into());
    };
    let mut rig = Rig::find(rig)?;
    let mut duration = None;
    let mut flags = flags.iter();
    while let Some(flag) = flags.next() {
        match (flag.as_str(), flag.strip_prefix("--seconds=")) {
            ("--no-rgb", _) => rig = rig.without_rgb()?,
            ("--seconds", _) => duration = Some(flags.next().ok_or(USAGE)?.parse()?),
            (_, Some(seconds)) => duration = Some(seconds.parse()?),
            _ => return Err(USAGE.into()),
        }
    }
    let description = match world.as_str() {
        "-" => WorldDescription::default(),
        path => WorldDescription::parse(path, &std::fs::read_to_string(path)?)?,
    };
    let trajectory = Trajectory::find(trajectory)?;
    let path = trajectory.path(&rig, OptionalSegments::LeftOut)?;
    let simulation = Simulation {
        rig: &rig,
        trajectory: &trajectory,
        path: &path,
        world: &description,
        seed: seed.parse()?,
        out: Path::new(out),
        duration: duration.map(Span::from_secs_f64),
    };
    let begun = Instant::now();
    let manifest = simulate(&simulation, &mut |_| {})?;
    for stream in &manifest.streams {
        println!("{:<16} {:>10} {}", stream.name, stream.count, stream.kind);
    }
    let recorded = duration.unwrap_or_else(|| path.duration().as_secs_f64());
    println!("{recorded:.2} s recorded in {:.2} s", begun.elapsed().as_secs_f64());
    Ok(())
}
