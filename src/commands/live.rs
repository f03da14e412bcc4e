//! `live`: sends the samples of devices or of a session to viewers, until Ctrl-C or the end.

use super::pi::{generation_settings, generation_words};
use super::plan::refused;
use super::{Ending, Output, WrongUse};
use crate::cli::LiveArgs;
use crate::drivers::{OpenOptions, OpenRig, replay};
use crate::live::{Addresses, Generation, GenerationSettings, Live, LiveStatus};
use evrig_core::geometry::Size;
use evrig_core::time::Span;
use evrig_record::recorder::{
    Received, Recorder, RecorderSample, SampleReceiver, channel, host_time,
};
use evrig_report::number::counted;
use evrig_session::SessionLayout;
use evrig_session::rig::{ArmPort, Rig};
use evrig_sim::world::WorldDescription;
use serde_json::json;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Bytes that wait to be shown; what does not fit is dropped and counted.
const QUEUE_BYTES: usize = 32 << 20;
/// Between two event images.
const PICTURE_INTERVAL: Duration = Duration::from_millis(33);
/// Between two lines of rates.
const STATUS_INTERVAL: Duration = Duration::from_secs(1);

/// The recorders that are shown, and what must live as long.
struct LiveSource {
    recorders: Vec<Box<dyn Recorder>>,
    tag: (String, u32),
    size: Size,
    /// Size of the Pi's frames and their delay from row to row; none where there are none.
    pi: Option<(Size, Span)>,
    rig: Option<OpenRig>,
    is_arm_simulated: bool,
}

pub(super) fn live(args: &LiveArgs, output: &Output) -> anyhow::Result<Ending> {
    if !(args.pace > 0.0 && args.pace.is_finite()) {
        return Err(WrongUse(format!("--pace is {}; expected above 0", args.pace)).into());
    }
    let mut source = open(args)?;
    let is_ending = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM, SIGHUP] {
        signal_hook::flag::register(signal, Arc::clone(&is_ending))?;
    }
    let addresses = Addresses { events: args.events, frames: args.frames, foxglove: args.foxglove };
    let tag = (source.tag.0.as_str(), source.tag.1);
    let live = Live::serve(addresses, source.size, "evrig live", tag)?;
    output.say(format_args!("events  tcp://{}", live.events().address()));
    output.say(format_args!("frames  tcp://{}", live.frames().address()));
    if let Some(address) = live.foxglove() {
        output.say(format_args!("Foxglove  ws://{address}"));
    }
    if source.is_arm_simulated {
        output.say("the simulated arm rests: events come from changes of light only");
    }
    let mut generation = generation(args, &source, output)?;
    let (outlet, inlet) = channel(QUEUE_BYTES);
    for recorder in &mut source.recorders {
        recorder.prepare()?;
        recorder.start(outlet.clone())?;
    }
    drop(outlet);
    let mut watching = Watching { live, inlet, generation: generation.as_mut() };
    let last = watch(args, &mut watching, &mut source, &is_ending, output)?;
    for recorder in &mut source.recorders {
        recorder.abort();
    }
    let generated = generation.map(Generation::finish).transpose()?;
    let n_samples = last.n_samples;
    let value = json!({
        "schema": "evrig.live/1", "n_samples": n_samples, "n_events": last.n_events,
        "n_dropped_by_devices": last.status.n_dropped_by_devices,
        "n_dropped_for_viewers": last.status.n_dropped_for_viewers,
        "generated": generated,
    });
    let mut text = format!("{} in {n_samples} samples shown", counted(last.n_events, "event"));
    if let Some(tally) = &generated {
        text += &format!("\ngenerated: {}", generation_words(tally));
    }
    output.result(&value, text)?;
    Ok(Ending::Done)
}

/// Events from the Pi's frames, where the user wants them.
fn generation(
    args: &LiveArgs,
    source: &LiveSource,
    output: &Output,
) -> anyhow::Result<Option<Generation>> {
    let Some(light) = args.generate else { return Ok(None) };
    let Some((size, row_time)) = source.pi else {
        let text = format!(
            "{} is played without the Pi's frames; `evrig generate` makes its events",
            args.what
        );
        return Err(WrongUse(text).into());
    };
    let settings = generation_settings(light, size, args.generated, &args.generation)?;
    let settings = GenerationSettings { row_time, ..settings };
    let generation = Generation::start(&settings)?;
    output.say(format_args!("generated events  tcp://{}", generation.address()));
    Ok(Some(generation))
}

fn open(args: &LiveArgs) -> anyhow::Result<LiveSource> {
    let path = Path::new(&args.what);
    if path.is_dir() {
        let davis = SessionLayout::new(path).davis();
        if !davis.exists() {
            return Err(WrongUse(format!("{} has no davis.aedat4", path.display())).into());
        }
        let size = evrig_format::aedat4::Reader::open(&davis)?
            .streams()
            .iter()
            .find_map(|stream| stream.size)
            .unwrap_or(Size::DAVIS346);
        return Ok(LiveSource {
            recorders: vec![replay(&davis, args.pace)],
            tag: ("tag36h11".to_owned(), 0),
            size,
            pi: None,
            rig: None,
            is_arm_simulated: false,
        });
    }
    let rig = Rig::find(&args.what).map_err(refused)?;
    let opening = OpenOptions {
        replay_speed: Some(args.pace),
        home: false,
        start: rig.arm.home,
        world: &WorldDescription::default(),
        seed: 1,
    };
    let mut open = OpenRig::open(&rig, &opening)?;
    let recorders = std::mem::take(&mut open.devices.recorders);
    let tag = (rig.target.tag_family.clone(), rig.target.tag_id);
    let (size, pi) = (rig.davis.camera.size, &rig.pi.camera);
    let pi = Some((pi.size, pi.row_time));
    let is_arm_simulated = rig.arm.port == ArmPort::Sim;
    Ok(LiveSource { recorders, tag, size, pi, rig: Some(open), is_arm_simulated })
}

/// What there was in all.
struct Watched {
    status: LiveStatus,
    n_samples: u64,
    n_events: u64,
}

/// Where samples come from and go to.
struct Watching<'a> {
    live: Live,
    inlet: SampleReceiver,
    generation: Option<&'a mut Generation>,
}

fn watch(
    args: &LiveArgs,
    Watching { live, inlet, generation }: &mut Watching<'_>,
    source: &mut LiveSource,
    is_ending: &AtomicBool,
    output: &Output,
) -> anyhow::Result<Watched> {
    let began = Instant::now();
    let limit = args.seconds.map(Duration::try_from_secs_f64).transpose()?;
    let status = live.update_status(host_time(), None, 0);
    let mut watched = Watched { status, n_samples: 0, n_events: 0 };
    let [mut shown, mut updated] = [began; 2];
    while !is_ending.load(Ordering::Relaxed) && limit.is_none_or(|limit| began.elapsed() < limit) {
        match inlet.take(PICTURE_INTERVAL) {
            Received::Sample(sample) => {
                watched.n_samples += 1;
                watched.n_events += sample.n_events();
                live.take(&sample)?;
                if let (Some(generation), RecorderSample::Frame { arrived, frame }) =
                    (&mut *generation, sample)
                {
                    generation.offer(frame, arrived.monotonic);
                }
            }
            Received::Nothing => {}
            Received::Closed => break,
        }
        if shown.elapsed() >= PICTURE_INTERVAL {
            shown = Instant::now();
            live.show_events(host_time());
        }
        if updated.elapsed() >= STATUS_INTERVAL {
            updated = Instant::now();
            watched.status = update_status(live, source)?;
            output.say(&watched.status);
        }
    }
    live.show_events(host_time());
    watched.status = update_status(live, source)?;
    Ok(watched)
}

fn update_status(live: &mut Live, source: &mut LiveSource) -> anyhow::Result<LiveStatus> {
    let mut n_dropped = 0;
    for recorder in &mut source.recorders {
        n_dropped += recorder.progress()?.n_dropped;
    }
    // Without a motion under way an arm may have no pose to give.
    let arm = source.rig.as_mut().map(|rig| &mut rig.devices.arm);
    let pose = arm.and_then(|arm| arm.progress().ok()).map(|progress| progress.pose.pose);
    Ok(live.update_status(host_time(), pose, n_dropped))
}
