//! `emulate`: serves a simulated device until Ctrl-C.

use super::record::{described, world};
use super::{Ending, Output, WrongUse};
use crate::cli::{EmulateArgs, EmulateArmArgs, EmulateCameraArgs, EmulatedDevice};
use anyhow::Context;
use evrig_core::time::Span;
use evrig_core::units::Degrees;
use evrig_pi::agent::Agent;
use evrig_session::trajectory::OptionalSegments;
use evrig_sim::arm::fault::Fault;
use evrig_sim::arm::{ArcSpeed, Clock, Emulator, Imperfections, OnAlarm, Options};
use evrig_sim::davis::DavisServer;
use evrig_sim::live::LiveWorld;
use evrig_sim::pi::SimulatedSource;
use serde::Serialize;
use serde_json::json;
use std::io::Write;
use std::path::PathBuf;

pub(super) fn emulate(args: &EmulateArgs, output: &Output) -> anyhow::Result<Ending> {
    match &args.device {
        EmulatedDevice::Arm(args) => arm(args, output),
        EmulatedDevice::Davis(args) => davis(args, output),
        EmulatedDevice::Pi(args) => pi(args, output),
    }
}

#[derive(Serialize)]
struct Served {
    port: PathBuf,
}

fn arm(args: &EmulateArmArgs, output: &Output) -> anyhow::Result<Ending> {
    if !(args.time_scale > 0.0 && args.time_scale <= 1e4) {
        let text = format!("--time-scale is {}; expected 0 < X <= 10000", args.time_scale);
        return Err(WrongUse(text).into());
    }
    let faults = args
        .faults
        .iter()
        .map(|text| text.parse::<Fault>())
        .collect::<Result<Vec<_>, _>>()
        .map_err(|error| WrongUse(error.to_string()))?;
    let journal = args
        .journal
        .as_ref()
        .map(|path| {
            std::fs::File::create(path)
                .with_context(|| format!("cannot write the journal {}", path.display()))
        })
        .transpose()?
        .map(|file| Box::new(file) as Box<dyn Write + Send>);
    let clock = Clock::Scaled(args.time_scale);
    let mut signals = signals()?;
    let mut emulator = Emulator::start_with_journal(options(args), clock, faults, journal)?;
    if let Some(link) = &args.link {
        emulator.link(link)?;
    }
    let port = args.link.clone().unwrap_or_else(|| emulator.port().to_owned());
    output.result(&Served { port: port.clone() }, port.display())?;
    output.say("a simulated Dobot Magician answers there; Ctrl-C ends it");
    signals.forever().next();
    Ok(Ending::Done)
}

fn davis(args: &EmulateCameraArgs, output: &Output) -> anyhow::Result<Ending> {
    let mut signals = signals()?;
    let live = live(args)?;
    let server = DavisServer::serve(std::sync::Arc::clone(&live), args.listen)?;
    server.progress().begin(live.now());
    let addresses: Vec<String> = server.addresses().iter().map(ToString::to_string).collect();
    output.result(&json!({ "addresses": addresses }), addresses.join(","))?;
    output.say("a simulated DAVIS346 serves events and frames there; Ctrl-C ends it");
    signals.forever().next();
    Ok(Ending::Done)
}

fn pi(args: &EmulateCameraArgs, output: &Output) -> anyhow::Result<Ending> {
    let mut signals = signals()?;
    let source = SimulatedSource::new(live(args)?);
    let agent = Agent::serve(args.listen, Box::new(source))?;
    output.result(&json!({ "addresses": [agent.address()] }), agent.address())?;
    output.say("a simulated Pi camera answers there; Ctrl-C ends it");
    signals.forever().next();
    Ok(Ending::Done)
}

/// The world of a camera that goes along a path and back.
fn live(args: &EmulateCameraArgs) -> anyhow::Result<std::sync::Arc<LiveWorld>> {
    let world = world(args.world.as_deref())?;
    let (rig, _, path) = described(&args.rig, &args.trajectory, OptionalSegments::LeftOut)?;
    Ok(LiveWorld::along(&path, &rig, &world, args.seed)?)
}

/// Signals are taken over before an address is announced, so that none falls between.
fn signals() -> std::io::Result<signal_hook::iterator::Signals> {
    signal_hook::iterator::Signals::new([
        signal_hook::consts::SIGINT,
        signal_hook::consts::SIGTERM,
        signal_hook::consts::SIGHUP,
    ])
}

fn options(args: &EmulateArmArgs) -> Options {
    Options {
        queue_depth: args.queue_depth,
        has_circle: !args.no_circle,
        is_homed: args.homed,
        homing: Span::from_secs_f64(args.homing),
        reply_delay: Span::from_micros(i64::from(args.reply_delay) * 1_000),
        on_alarm: if args.skip_on_alarm { OnAlarm::Skip } else { OnAlarm::Stall },
        arc_speed: if args.arc_at_ptp_speed {
            ArcSpeed::PtpCoordinate
        } else {
            ArcSpeed::ArcParams
        },
        imperfections: Imperfections {
            backlash: Degrees(args.backlash),
            vibration_gain: args.vibration,
            ..Imperfections::default()
        },
        ..Options::default()
    }
}
