//! `pi` and `pair`: serves the Pi's camera until Ctrl-C; makes keys.

use super::plan::refused;
use super::{Ending, Output, WrongUse};
use crate::cli::{LiveGenerationArgs, LiveLight, PairArgs, PiArgs};
use crate::live::{Generation, GenerationSettings, GenerationTally, PiLight};
use evrig_core::geometry::Size;
use evrig_core::time::Span;
use evrig_device::pi::pairing;
use evrig_generate::input::FramePreparation;
use evrig_pi::keys;
use evrig_pi::order::CaptureSettings;
use evrig_pi::read_clocks;
use evrig_pi::serve::{SERVING, ServeError, ServedCamera, check_spool_size};
use evrig_pi::source::FrameSource;
use evrig_record::host_clock;
use evrig_session::rig::Rig;
use serde_json::json;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

pub(super) fn pi(args: &PiArgs, output: &Output) -> anyhow::Result<Ending> {
    check_spool_size(&args.serve).map_err(refused_to_serve)?;
    if let Some(address) = args.events {
        return generate_here(args, address, args.serve.source(), output);
    }
    let served = ServedCamera::open(&args.serve).map_err(refused_to_serve)?;
    match &served.camera {
        Ok(camera) => output.say(format_args!("camera: {camera}")),
        Err(error) => output.warn(error),
    }
    output.result(&json!({ "address": served.address }), &served.address)?;
    output.say(SERVING);
    served.wait();
    Ok(Ending::Done)
}

fn refused_to_serve(error: ServeError) -> anyhow::Error {
    if error.is_wrong_use() { WrongUse(error.to_string()).into() } else { error.into() }
}

/// Events from the camera of this machine, until Ctrl-C or the time is over.
fn generate_here(
    args: &PiArgs,
    address: SocketAddr,
    mut camera: Box<dyn FrameSource>,
    output: &Output,
) -> anyhow::Result<Ending> {
    let limit = args.seconds.map(Duration::try_from_secs_f64).transpose()?;
    let pi = Rig::find(&args.rig).map_err(refused)?.pi;
    let is_raw = args.light == LiveLight::Raw;
    let wanted = CaptureSettings {
        size: pi.camera.size,
        frame_rate: pi.camera.frame_rate,
        exposure: pi.camera.exposure,
        gain: pi.camera.gain,
        raw: is_raw,
        rgb: !is_raw,
    };
    let is_ending = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM, SIGHUP] {
        signal_hook::flag::register(signal, Arc::clone(&is_ending))?;
    }
    let size = camera.configure(&wanted)?.size;
    let settings = generation_settings(args.light, size, address, &args.generation)?;
    let settings = GenerationSettings { row_time: pi.camera.row_time, ..settings };
    let mut generation = Generation::start(&settings)?;
    output.say(format_args!("events  tcp://{}", generation.address()));
    camera.start()?;
    let began = Instant::now();
    let mut worked = Ok(());
    while !is_ending.load(Ordering::Relaxed) && limit.is_none_or(|limit| began.elapsed() < limit) {
        match camera.next() {
            Ok(Some(frame)) => {
                let age = read_clocks().boottime_after - frame.metadata.sensor_timestamp;
                generation.offer(Box::new(frame), host_clock::now() - age);
            }
            Ok(None) => {}
            Err(error) => {
                worked = Err(error);
                break;
            }
        }
    }
    camera.stop();
    let tally = generation.finish()?;
    worked?;
    let value = json!({ "schema": "evrig.live_generation/1", "address": address, "tally": tally });
    output.result(&value, generation_words(&tally))?;
    Ok(if tally.n_dropped + tally.generator.n_late == 0 {
        Ending::Done
    } else {
        Ending::WithLosses
    })
}

/// The settings of live generation from the command line; the rig adds the rows' delay.
pub(super) fn generation_settings(
    light: LiveLight,
    size: Size,
    address: SocketAddr,
    args: &LiveGenerationArgs,
) -> anyhow::Result<GenerationSettings> {
    let bound_ms = args.latency_ms;
    if !(bound_ms > 0.0 && bound_ms <= 1e6) {
        let text = format!("--latency-ms is {bound_ms}; expected above 0, at most 1000000");
        return Err(WrongUse(text).into());
    }
    let (light, published, full_scale_dn) = match light {
        LiveLight::Raw => (PiLight::Raw, "Raw2DVS346", 1023.0),
        LiveLight::Rgb => (PiLight::Rgb, "RGB2DVS346", 255.0),
    };
    let mut choice = args.choice.choice().or_preset(published);
    choice.full_scale_dn = choice.full_scale_dn.or(Some(full_scale_dn));
    Ok(GenerationSettings {
        light,
        size,
        parameters: choice.parameters()?,
        row_time: Span::ZERO,
        preparation: FramePreparation { divide_exposure: true, ..FramePreparation::default() },
        bound: Span::from_secs_f64(bound_ms * 1e-3),
        address,
    })
}

/// What became of the frames, in a line.
pub(super) fn generation_words(tally: &GenerationTally) -> String {
    let made = tally.generator;
    let mut words = format!(
        "{} events from {} of {} frames; {} dropped, {} late; latency {:.1} ms at most",
        made.n_events,
        made.n_taken,
        made.n_seen + tally.n_dropped + tally.n_unreadable,
        tally.n_dropped,
        made.n_late,
        made.worst_latency_us as f64 * 1e-3,
    );
    if let Some(because) = &tally.first_refusal {
        words += &format!("; {} refused, first: {because}", made.n_refused + tally.n_unreadable);
    }
    words
}

pub(super) fn pair(args: &PairArgs, output: &Output) -> anyhow::Result<Ending> {
    let directory = args.out.clone().unwrap_or_else(keys::default_directory);
    let made = pairing::pair(&directory)?;
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
