//! Drives the published circle and prints the timing of its poses.
//!
//! ```sh
//! cargo run --example drive_circle                    # the simulated arm
//! cargo run --example drive_circle -- /dev/ttyUSB0 50 # a real arm, homed, at most 50 poses per second
//! ```
//! The measured duration shows which parameters set the speed of a circle: 2.508 s for the ARC
//! parameters (50 mm/s, 50 mm/s^2). The PTP parameters are set to half of them.

#![allow(clippy::print_stdout)]

use evrig::device::dobot::command::{ArmCommand, CartesianLimits, PtpMode, Ratios};
use evrig::device::dobot::guard::{GuardLink, serve};
use evrig::device::dobot::{ArmClient, ArmTimeouts};
use evrig::record::host_clock;
use evrig::sim::arm::{ArmClock, ArmEmulator, ArmOptions};
use evrig::time::Span;
use std::error::Error;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

fn main() -> Result<(), Box<dyn Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    // The guard is this program again, as in evrig.
    if let [verb, port] = &args[..]
        && verb == "guard"
    {
        let never = AtomicBool::new(false);
        serve(Path::new(port), std::io::stdin(), std::io::stdout(), &never);
        return Ok(());
    }
    let rate: f64 = args.get(1).map_or(Ok(50.0), |text| text.parse())?;
    let simulated = match args.first() {
        Some(_) => None,
        None => Some(ArmEmulator::start(ArmOptions::default(), ArmClock::Scaled(1.0), Vec::new())?),
    };
    let port = match (&simulated, args.first()) {
        (Some(emulator), _) => emulator.port().to_owned(),
        (None, port) => PathBuf::from(port.cloned().unwrap_or_default()),
    };
    let link = GuardLink::start(&std::env::current_exe()?, &port)?;
    let patience = ArmTimeouts { between_polls: Span::ZERO, ..ArmTimeouts::default() };
    let mut client = ArmClient::new(Box::new(link), patience);
    println!("{:?}", client.identify()?);
    if simulated.is_some() {
        client.clear_alarms()?;
    }
    client.refuse_alarms()?;
    drive(&mut client, rate)
}

fn drive(client: &mut ArmClient, rate: f64) -> Result<(), Box<dyn Error>> {
    let timeout = Span::from_micros(1_000_000);
    let minute = Span::from_micros(60_000_000);
    client.begin()?;
    client.set(&ArmCommand::PtpCommon(Ratios { velocity: 100.0, acceleration: 100.0 }))?;
    client.set(&ArmCommand::PtpCoordinate(CartesianLimits::uniform(25.0, 25.0)))?;
    client.set(&ArmCommand::ArcParams(CartesianLimits::uniform(50.0, 50.0)))?;
    let target = [240.0, 0.0, 100.0, 90.0];
    let start = client.enqueue(&ArmCommand::Ptp { mode: PtpMode::MoveLineXyz, target }, timeout)?;
    client.wait_for(start, minute, &mut |_| ())?;
    let (via, to) = ([252.0, 12.0, 100.0, 90.0], [264.0, 0.0, 100.0, 90.0]);
    let circle = client.enqueue(&ArmCommand::Circle { via, to, turns: 1 }, timeout)?;
    let started = host_clock::now();
    let mut poses = Vec::new();
    client.wait_for(circle, minute, &mut |pose| {
        poses.push(*pose);
        std::thread::sleep(std::time::Duration::from_secs_f64(1.0 / rate));
    })?;
    println!("the circle took {}", host_clock::now() - started);
    let gaps = poses.windows(2).map(|pair| pair[1].time() - pair[0].time());
    let largest_gap = gaps.max().unwrap_or(Span::ZERO);
    let uncertainty = poses.iter().map(|pose| pose.uncertainty()).max().unwrap_or(Span::ZERO);
    println!("{} poses, at most {largest_gap} apart, each known to {uncertainty}", poses.len());
    Ok(())
}
