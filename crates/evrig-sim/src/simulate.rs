//! A session of the simulated rig in virtual time: as fast as the world can be rendered.
//!
//! The devices' twins are called directly, without wires and without a wall clock; the engine's
//! writers write their output in the order in which the host would have received it. The same world
//! and seed give the same recorded bytes, however many threads there are.

use crate::davis;
use crate::pi::{MODEL, delivered};
use crate::world::{
    DAVIS_STEP, DavisPacket, DavisTwin, PiTwin, SimulatedPiFrame, World, WorldDescription,
    WorldError,
};
use evrig_core::geometry::Size;
use evrig_core::raw10::Raw10Error;
use evrig_core::time::Span;
use evrig_format::aedat4::StreamSpec;
use evrig_record::RecordState;
use evrig_record::files::{
    EventFile, SharedRigLog, create_event_file, finish_event_file, take_directory,
    write as write_sample,
};
use evrig_record::recorder::RecorderSample;
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
    /// The rig; its cameras are simulated whatever their transport.
    pub rig: &'a Rig,
    /// The trajectory, for the manifest.
    pub trajectory: &'a Trajectory,
    /// The trajectory on that rig.
    pub path: &'a ToolPath,
    /// The world; it reaches the session only through the devices' output.
    pub world: &'a WorldDescription,
    /// Seed of all random numbers of the world.
    pub seed: u64,
    /// The session's directory; it must be missing or empty.
    pub out: &'a std::path::Path,
    /// How long the cameras run from the path's beginning; the path's own duration by default.
    pub duration: Option<Span>,
}

/// Why a session cannot be simulated.
#[derive(Debug, thiserror::Error)]
pub enum SimulateError {
    /// The description of the world is invalid.
    #[error(transparent)]
    World(#[from] WorldError),
    /// The Pi's frames cannot be packed.
    #[error("pi.size_px: {0}")]
    Raw(#[from] Raw10Error),
    /// The session's files cannot be written or closed.
    #[error(transparent)]
    Session(#[from] SessionError),
}

/// What the host writes at one moment.
enum HostEntry {
    Sample(RecorderSample),
    Pose(Topic, HostTime, Pose),
    Log(HostTime, String),
}

/// Slabs that may wait for the disk.
const WAITING: usize = 4;
/// Readings of the Pi's clocks before and behind the frames, and the time between two of them.
const N_READINGS: i64 = 5;
const BETWEEN_READINGS: Span = Span::from_micros(20_000);
/// Between two readings while frames flow.
const READING_PERIOD: Span = Span::from_micros(1_000_000);

/// Simulates a session in virtual time; `watch` gets the progress, 0..=1.
///
/// # Errors
/// When the world is invalid, or the session's files cannot be written.
pub fn simulate(
    simulation: &Simulation<'_>,
    watch: &mut dyn FnMut(f64),
) -> Result<Manifest, SimulateError> {
    let Simulation { rig, path, .. } = *simulation;
    let world = Arc::new(World::along(rig, path, simulation.world, simulation.seed)?);
    let layout = take_directory(simulation.out)?;
    let mut journal = Journal::open(&layout.journal())?;
    let begin = RecordState::Trajectory.to_string();
    journal.note(&begin, &json!({"time": "virtual"}))?;
    let streams = davis::streams(rig);
    let files = SessionFiles {
        events: create_event_file(&layout, rig.davis.compression, &streams)?,
        log: SharedRigLog::in_virtual_time(&layout)?,
        tally: [0; 2],
    };
    let run = SessionRun {
        world: &world,
        path,
        until: simulation.duration.unwrap_or_else(|| path.duration()),
    };
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
    journal.note(&RecordState::Seal.to_string(), &json!({}))?;
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
type HostBatch = Vec<HostEntry>;

/// The world on its way through the recording.
struct SessionRun<'a> {
    world: &'a Arc<World>,
    path: &'a ToolPath,
    until: Span,
}

impl SessionRun<'_> {
    /// Works the world out slab by slab and sends what the host gets of it.
    fn send_all(
        &self,
        outlet: &SyncSender<HostBatch>,
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
                // The writer reports an error of its own.
                return Ok(());
            }
        }
        let (rest, _) = parted(waiting, Span::from_nanos(i64::MAX));
        let _: Result<(), SendError<HostBatch>> = outlet.send(rest);
        Ok(())
    }

    /// Everything that does not come from a camera.
    fn before(&self) -> Vec<(Span, HostEntry)> {
        let (world, until) = (self.world, self.until);
        let mut entries = Vec::new();
        let mut say = |at, text: String| {
            entries.push((at, HostEntry::Log(world.host_time(at), text)));
        };
        say(Span::ZERO, RecordState::Trajectory.to_string());
        say(until, RecordState::Drain.to_string());
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
            entries.push((answered, HostEntry::Sample(RecorderSample::Clock(reading))));
        }
        let step = Span::from_secs_f64(1.0 / world.rig().arm.pose_rate.0);
        let mut at = Span::ZERO;
        while at <= until {
            let (now, pose) = (world.host_time(at), self.path.pose_at(at));
            if at <= self.path.duration() {
                entries.push((Span::ZERO, HostEntry::Pose(Topic::Commanded, now, pose)));
            }
            // The planner is where the path is; what steppers and brackets add it does not know.
            entries.push((at, HostEntry::Pose(Topic::ArmPose, now, pose)));
            at = at + step;
        }
        entries
    }

    fn packets(
        &self,
        packet: DavisPacket,
        whole: Span,
        n_packets: &mut u64,
        entries: &mut Vec<(Span, HostEntry)>,
    ) {
        for (stream, content) in packet.contents(self.world.rig().davis.aps) {
            let at = self.world.packet_arrival(whole, *n_packets);
            *n_packets += 1;
            let arrived = self.world.host_time(at);
            entries
                .push((at, HostEntry::Sample(RecorderSample::Packet { stream, arrived, content })));
        }
    }

    fn frame(&self, frame: SimulatedPiFrame, size: Size) -> Result<(Span, HostEntry), Raw10Error> {
        let handed_over = frame.handed_over;
        let frame = Box::new(delivered(frame, size)?);
        let sequence = frame.metadata.sequence;
        let at = self.world.frame_arrival(handed_over, frame.n_bytes(), sequence);
        let arrived = self.world.host_time(at);
        Ok((at, HostEntry::Sample(RecorderSample::Frame { arrived, frame })))
    }
}

/// What is written before `until`, in order, and what is still to come.
fn parted(
    mut entries: Vec<(Span, HostEntry)>,
    until: Span,
) -> (Vec<HostEntry>, Vec<(Span, HostEntry)>) {
    entries.sort_by_key(|(at, _)| *at);
    let n = entries.partition_point(|(at, _)| *at < until);
    let later = entries.split_off(n);
    (entries.into_iter().map(|(_, entry)| entry).collect(), later)
}

/// The session's files under way.
struct SessionFiles {
    events: EventFile,
    log: SharedRigLog,
    /// Samples of the DAVIS and of the Pi.
    tally: [u64; 2],
}

impl SessionFiles {
    /// Writes everything, closes the files, and returns the numbers of samples.
    fn write_all(
        mut self,
        inlet: Receiver<HostBatch>,
        layout: &SessionLayout,
    ) -> Result<[u64; 2], SessionError> {
        for entry in inlet.into_iter().flatten() {
            self.write(entry)?;
        }
        finish_event_file(self.events, &layout.davis())?;
        self.log.finish()?;
        Ok(self.tally)
    }

    fn write(&mut self, entry: HostEntry) -> Result<(), SessionError> {
        match entry {
            HostEntry::Log(at, text) => self.log.write(|log| log.log(at, Severity::Info, &text)),
            HostEntry::Pose(topic, at, pose) => self.log.write(|log| log.pose(topic, at, pose)),
            HostEntry::Sample(sample) => {
                match sample {
                    RecorderSample::Packet { .. } => self.tally[0] += 1,
                    RecorderSample::Frame { .. } => self.tally[1] += 1,
                    RecorderSample::LateRgb { .. }
                    | RecorderSample::Clock(_)
                    | RecorderSample::Note { .. } => {}
                }
                write_sample(sample, Some(&mut self.events), &self.log)
            }
        }
    }
}
