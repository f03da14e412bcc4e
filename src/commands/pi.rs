//! `pi` and `pair`: serves the Pi's camera until Ctrl-C; makes keys.

use super::{Ending, Output, WrongUse};
use crate::cli::{PairArgs, PiArgs, PiCamera};
use crate::device::pi::agent::{Agent, AgentError, Service, Spool};
use crate::device::pi::keys::{self, Keys};
use crate::device::pi::picamera::Picamera;
use crate::device::pi::source::{FrameSource, Synthetic};
use serde_json::json;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};

pub(super) fn pi(args: &PiArgs, output: &Output) -> anyhow::Result<Ending> {
    if !(args.spool_gb > 0.0 && args.spool_gb <= 1e5) {
        let text = format!("--spool-gb is {}; expected above 0, at most 100000", args.spool_gb);
        return Err(WrongUse(text).into());
    }
    let camera: Box<dyn FrameSource> = match args.camera {
        PiCamera::Picamera2 => Box::new(Picamera::new(&args.python)),
        PiCamera::Synthetic => Box::new(Synthetic::paced()),
    };
    let mut service = Service::local(args.listen);
    service.keys = args.keys.as_deref().map(Keys::read).transpose()?;
    if let Some(directory) = &args.spool {
        if !directory.is_dir() {
            let text = format!("--spool {} is no directory", directory.display());
            return Err(WrongUse(text).into());
        }
        let limit_bytes = (args.spool_gb * 1e9) as u64;
        service.room.spool = Some(Spool { directory: directory.clone(), limit_bytes });
    }
    // Signals are taken over before the address is announced, so that none falls between.
    let mut signals = signal_hook::iterator::Signals::new([SIGINT, SIGTERM, SIGHUP])?;
    let is_encrypted = service.keys.is_some();
    let agent = match Agent::open(service, camera) {
        Err(error @ AgentError::NotLoopback { .. }) => {
            return Err(WrongUse(error.to_string()).into());
        }
        agent => agent?,
    };
    let scheme = if is_encrypted { "tls" } else { "tcp" };
    let address = format!("{scheme}://{}", agent.address());
    output.result(&json!({ "address": address }), &address)?;
    output.say("serves the camera there to one recorder at a time; Ctrl-C ends it");
    signals.forever().next();
    drop(agent);
    Ok(Ending::Done)
}

pub(super) fn pair(args: &PairArgs, output: &Output) -> anyhow::Result<Ending> {
    let directory = args.out.clone().unwrap_or_else(keys::default_directory);
    let made = keys::pair(&directory)?;
    let (host, agent) = (made.host.display(), made.agent.display());
    let line = match &args.out {
        None => String::new(),
        Some(_) => format!("\n     keys = \"{host}\""),
    };
    let text = format!(
        "keys for the host: {host}\nkeys for the Pi:   {agent}\n\n\
         1. copy the Pi's half there, and remove it here:\n     \
            scp -rp {agent} PI:evrig-keys && rm -r {agent}\n\
         2. on the Pi, start the agent with it:\n     \
            evrig pi --listen 0.0.0.0:7766 --keys ~/evrig-keys --spool /var/tmp\n\
         3. in the rig file, [pi]:\n     \
            transport = \"tls://PI:7766\"{line}"
    );
    output.result(&json!({ "host": made.host, "agent": made.agent }), text)?;
    Ok(Ending::Done)
}
