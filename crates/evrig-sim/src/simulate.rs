//! A session of the simulated rig in virtual time: as fast as the world can be worked out.
//!
//! The devices' twins are asked directly, without wires and without a wall clock, and what they
//! give is written by the writers of the engine in the order in which the host would have had
//! it. The same world and seed give the same recorded bytes, however many threads there are.

use crate::davis;
use crate::pi::{MODEL, delivered};
use crate::world::{
    DAVIS_STEP, DavisPacket, DavisTwin, PiFrame, PiTwin, World, WorldDescription, WorldError,
};
use evrig_core::geometry::Size;
use evrig_core::raw10::Raw10Error;
use evrig_core::time::Span;
use evrig_format::aedat4::StreamSpec;
use evrig_record::State;
use evrig_record::files::{
    EventFile, Log, create_event_file, finish_event_file, take_directory, write as write_sample,
};
use evrig_record::recorder::Sample;
use evrig_session::rig::{Pose, Rig};
use evrig_session::trajectory::{ToolPath, Trajectory};
use evrig_session::{
    DeviceEntry, HostTime, Journal, Manifest, Origin, Recording, SessionError, SessionLayout,
    SessionStatus, Severity, Topic, seal_recording,
};
use serde_json::json;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, SendError, SyncSender, sync_channel};

/// What is to be simulated.
#[derive(Debug, Clone, Copy)]
pub struct Simulation<'a> {
    /// The rig; its cameras are played whatever their transport.
    pub rig: &'a Rig,
    /// The trajectory, for the manifest.
    pub trajectory: &'a Trajectory,
    /// The trajectory on that rig.
    pub path: &'a ToolPath,
    /// What the rig does not say. None of it reaches the session but through what the devices see.
    pub world: &'a WorldDescription,
    /// Of everything that is random in the world.
    pub seed: u64,
    /// The session's directory; it must be missing or empty.
    pub out: &'a std::path::Path,
    /// How long the cameras run from the path's beginning; the path's own duration if not said.
    pub duration: Option<Span>,
}

/// Why there is no simulated session.
#[derive(Debug, thiserror::Error)]
pub enum SimulateError {
    /// There is no such world.
    #[error(transparent)]
    World(#[from] WorldError),
    /// The Pi's frames cannot be packed.
    #[error("pi.size_px: {0}")]
    Raw(#[from] Raw10Error),
    /// The files cannot be made or sealed.
    #[error(transparent)]
    Session(#[from] SessionError),
}

/// What the host writes at one moment.
enum Entry {
    Sample(Sample),
    Pose(Topic, HostTime, Pose),
    Said(HostTime, String),
}

/// Slabs that may wait for the disk.
const WAITING: usize = 4;
/// Readings of the Pi's clocks before and behind the frames, and the time between two of them.
const N_READINGS: i64 = 5;
const BETWEEN_READINGS: Span = Span::from_micros(20_000);
/// Between two readings while frames flow.
const READING_PERIOD: Span = Span::from_micros(1_000_000);

/// Makes a session in virtual time; `watch` is told how far it is, 0..=1.
///
/// # Errors
/// When the world cannot be, or the session's files cannot be made.
pub fn simulate(
    simulation: &Simulation<'_>,
    watch: &mut dyn FnMut(f64),
) -> Result<Manifest, SimulateError> {
    let Simulation { rig, path, .. } = *simulation;
    let world = Arc::new(World::along(rig, path, simulation.world, simulation.seed)?);
    let layout = take_directory(simulation.out)?;
    let mut journal = Journal::open(&layout.journal())?;
    let begin = State::Trajectory.to_string();
    journal.note(&begin, &json!({"time": "virtual"}))?;
    let streams = davis::streams(rig);
    let files = Files {
        events: create_event_file(&layout, rig.davis.compression, &streams)?,
        log: Log::in_virtual_time(&layout)?,
        tally: [0; 2],
    };
    let run =
        Run { world: &world, path, until: simulation.duration.unwrap_or_else(|| path.duration()) };
    // The disk takes what came before while the world is worked out.
    let tally = std::thread::scope(|scope| -> Result<[u64; 2], SimulateError> {
        let (outlet, inlet) = sync_channel(WAITING);
        let writer = std::thread::Builder::new()
            .name("writer".to_owned())
            .spawn_scoped(scope, || files.write_all(inlet, &layout))
            .map_err(|source| SessionError::Io { path: simulation.out.to_owned(), source })?;
        let worked = run.send_all(&outlet, watch);
        drop(outlet);
        // A panic there was reported by its own hook.
        let tally = writer.join().unwrap_or_else(|_| {
            let source = std::io::Error::other("the writer ended early");
            Err(SessionError::Io { path: simulation.out.to_owned(), source })
        })?;
        worked.map(|()| tally)
    })?;
    journal.note(&State::Seal.to_string(), &json!({}))?;
    seal(simulation, &world, &layout, &streams, tally)
}

fn seal(
    simulation: &Simulation<'_>,
    world: &World,
    layout: &SessionLayout,
    streams: &[StreamSpec],
    tally: [u64; 2],
) -> Result<Manifest, SimulateError> {
    let rig = simulation.rig;
    let kinds: Vec<_> = streams.iter().map(|stream| stream.kind.identifier()).collect();
    let pi = &rig.pi;
    let device = |name: &str, description, n_samples| DeviceEntry {
        name: name.to_owned(),
        description,
        n_samples,
        n_dropped: 0,
        lost: None,
    };
    let devices = vec![
        device("davis", json!({"source": "sim", "streams": kinds}), tally[0]),
        device(
            "pi",
            json!({"camera": MODEL, "size": pi.camera.size, "raw": pi.raw, "rgb": pi.rgb}),
            tally[1],
        ),
    ];
    let recording = Recording {
        rig: rig.text.clone(),
        trajectory: simulation.trajectory.text.clone(),
        devices,
        ended: "complete".to_owned(),
        trajectory_began_ns: Some(world.clocks().unix(Span::ZERO).as_nanos()),
        clocks: json!({"reference": rig.clocks.reference, "host": "sim", "pi": "sim"}),
    };
    let origin =
        Origin::Recorded { rig: rig.name.clone(), trajectory: simulation.trajectory.name.clone() };
    Ok(seal_recording(layout, origin, SessionStatus::Complete, recording, Vec::new())?)
}

/// What was worked out of a stretch of time, in the order in which the host writes it.
type Batch = Vec<Entry>;

/// The world on its way through the recording.
struct Run<'a> {
    world: &'a Arc<World>,
    path: &'a ToolPath,
    until: Span,
}

impl Run<'_> {
    /// Works the world out slab by slab and sends what the host gets of it.
    fn send_all(
        &self,
        outlet: &SyncSender<Batch>,
        watch: &mut dyn FnMut(f64),
    ) -> Result<(), SimulateError> {
        let mut davis = DavisTwin::new(Arc::clone(self.world), Span::ZERO);
        let mut pi = PiTwin::new(Arc::clone(self.world), Span::ZERO);
        let size = self.world.rig().pi.camera.size;
        let mut waiting = self.before();
        let mut n_packets = 0;
        loop {
            let begin = davis.position();
            if begin >= self.until {
                break;
            }
            let ((packet, end), frames) = rayon::join(
                || (davis.next_packet(), davis.position()),
                || pi.frames_until((begin + DAVIS_STEP).min(self.until)),
            );
            self.packets(packet, end, &mut n_packets, &mut waiting);
            for frame in frames {
                waiting.push(self.frame(frame, size)?);
            }
            let (now, later) = parted(waiting, end);
            waiting = later;
            let share = end.as_secs_f64() / self.until.as_secs_f64().max(1e-9);
            watch(share.min(1.0));
            if outlet.send(now).is_err() {
                // The writer has an error of its own to tell.
                return Ok(());
            }
        }
        let (rest, _) = parted(waiting, Span::from_nanos(i64::MAX));
        let _: Result<(), SendError<Batch>> = outlet.send(rest);
        Ok(())
    }

    /// Everything that does not come from a camera.
    fn before(&self) -> Vec<(Span, Entry)> {
        let (world, until) = (self.world, self.until);
        let mut entries = Vec::new();
        let mut say = |at, text: String| {
            entries.push((at, Entry::Said(world.host_time(at), text)));
        };
        say(Span::ZERO, State::Trajectory.to_string());
        say(until, State::Drain.to_string());
        let around = |beginning: Span| {
            (0..N_READINGS)
                .map(move |n| beginning + Span::from_nanos(BETWEEN_READINGS.as_nanos() * n))
        };
        let lead = Span::from_nanos(BETWEEN_READINGS.as_nanos() * N_READINGS);
        let while_running = (0..)
            .map(|n| Span::from_nanos(READING_PERIOD.as_nanos() * n))
            .take_while(|at| *at < until);
        let asked = around(Span::ZERO - lead).chain(while_running).chain(around(until));
        for (number, at) in asked.enumerate() {
            let (answered, reading) = world.clock_exchange(at, number as u64);
            entries.push((answered, Entry::Sample(Sample::Clock(reading))));
        }
        let step = Span::from_secs_f64(1.0 / world.rig().arm.pose_rate.0);
        let mut at = Span::ZERO;
        while at <= until {
            let (now, pose) = (world.host_time(at), self.path.pose_at(at));
            if at <= self.path.duration() {
                entries.push((Span::ZERO, Entry::Pose(Topic::Commanded, now, pose)));
            }
            // The planner is where the path is; what steppers and brackets add it does not know.
            entries.push((at, Entry::Pose(Topic::ArmPose, now, pose)));
            at = at + step;
        }
        entries
    }

    fn packets(
        &self,
        packet: DavisPacket,
        whole: Span,
        n_packets: &mut u64,
        entries: &mut Vec<(Span, Entry)>,
    ) {
        for (stream, content) in packet.contents(self.world.rig().davis.aps) {
            let at = self.world.packet_arrival(whole, *n_packets);
            *n_packets += 1;
            let arrived = self.world.host_time(at);
            entries.push((at, Entry::Sample(Sample::Packet { stream, arrived, content })));
        }
    }

    fn frame(&self, frame: PiFrame, size: Size) -> Result<(Span, Entry), Raw10Error> {
        let handed_over = frame.handed_over;
        let frame = Box::new(delivered(frame, size)?);
        let sequence = frame.metadata.sequence;
        let at = self.world.frame_arrival(handed_over, frame.n_bytes(), sequence);
        let arrived = self.world.host_time(at);
        Ok((at, Entry::Sample(Sample::Frame { arrived, frame })))
    }
}

/// What is written before `until`, in order, and what is still to come.
fn parted(mut entries: Vec<(Span, Entry)>, until: Span) -> (Vec<Entry>, Vec<(Span, Entry)>) {
    entries.sort_by_key(|(at, _)| *at);
    let n = entries.partition_point(|(at, _)| *at < until);
    let later = entries.split_off(n);
    (entries.into_iter().map(|(_, entry)| entry).collect(), later)
}

/// The session's files under way.
struct Files {
    events: EventFile,
    log: Log,
    /// Samples of the DAVIS and of the Pi.
    tally: [u64; 2],
}

impl Files {
    /// Writes everything, ends the files, and says how many samples there were.
    fn write_all(
        mut self,
        inlet: Receiver<Batch>,
        layout: &SessionLayout,
    ) -> Result<[u64; 2], SessionError> {
        for entry in inlet.into_iter().flatten() {
            self.write(entry)?;
        }
        finish_event_file(self.events, &layout.davis())?;
        self.log.finish()?;
        Ok(self.tally)
    }

    fn write(&mut self, entry: Entry) -> Result<(), SessionError> {
        match entry {
            Entry::Said(at, text) => self.log.write(|log| log.log(at, Severity::Info, &text)),
            Entry::Pose(topic, at, pose) => self.log.write(|log| log.pose(topic, at, pose)),
            Entry::Sample(sample) => {
                match sample {
                    Sample::Packet { .. } => self.tally[0] += 1,
                    Sample::Frame { .. } => self.tally[1] += 1,
                    Sample::LateRgb { .. } | Sample::Clock(_) | Sample::Note { .. } => {}
                }
                write_sample(sample, Some(&mut self.events), &self.log)
            }
        }
    }
}
