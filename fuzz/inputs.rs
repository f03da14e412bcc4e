//! Every parser of external data, each as a function of arbitrary bytes. It may reject them; it
//! must not panic, run forever or use unbounded memory.
//!
//! The fuzz targets call these functions, and so does `tests/it/fuzz_corpus.rs` with the corpus.

use evrig::format::aedat4::Reader;
use evrig::format::npy::{ArrayWriter, NpzWriter};
use evrig::format::raw2event;
use evrig::geometry::Size;
use evrig::pi::wire;
use evrig::pipeline;
use evrig::rig::Rig;
use evrig::scene::PATH_COLUMNS;
use evrig::session::import::{
    EventTableOptions, FrameTimes, ImportFrames, ImportRecording, RawFrameOptions, import_frames,
    import_recording,
};
use evrig::session::{
    RecordingCheck, Session, SessionLayout, StageRecord, StreamName, read_stage, repair, verify,
    write_stage,
};
use evrig::sim::world::WorldDescription;
use evrig::trajectory::{OptionalSegments, Plan, Trajectory};
use std::collections::BTreeMap;
use std::path::Path;

/// A parser under test.
pub type ByteParser = fn(&[u8]);

/// Name of the corpus and parser.
pub const ALL: [(&str, ByteParser); 11] = [
    ("aedat4", aedat4),
    ("dobot", dobot),
    ("pi", pi),
    ("rig_log", rig_log),
    ("raw2event", raw2event_files),
    ("descriptions", descriptions),
    ("manifest", manifest),
    ("journal", journal),
    ("imported", imported),
    ("recordings", recordings),
    ("results", results),
];

/// AEDAT4 as a file and from a socket: packets, at most one error, end.
pub fn aedat4(bytes: &[u8]) {
    for reader in
        [Reader::new(bytes, "fuzz"), Reader::from_stream(bytes, "fuzz")].into_iter().flatten()
    {
        let n_errors = reader.filter(Result::is_err).count();
        assert!(n_errors <= 1);
    }
}

/// Frames of the arm's serial line: no byte is lost and buffers are bounded.
pub fn dobot(bytes: &[u8]) {
    evrig::device::dobot::frame::fuzz(bytes, |frame| {
        let _ = evrig::device::dobot::command::ArmCommand::decode(frame);
    });
}

/// Messages between host and agent, in pieces of any size: a complete message can be encoded
/// again, a malformed one is an error.
pub fn pi(bytes: &[u8]) {
    if let Some(preamble) = bytes.first_chunk() {
        let _ = wire::check_preamble(preamble);
    }
    let piece = 1 + bytes.first().copied().map_or(0, usize::from);
    let mut decoder = wire::MessageDecoder::default();
    for bytes in bytes.chunks(piece * 16) {
        decoder.push(bytes);
        loop {
            match decoder.take() {
                Ok(Some(message)) => drop(wire::encode(&message)),
                Ok(None) => break,
                Err(_) => return,
            }
        }
    }
}

/// `rig.mcap`, read while it is recorded and as a file of a session.
pub fn rig_log(bytes: &[u8]) {
    drop(RecordingCheck::of_rig_log(bytes));
    in_a_session(|layout| {
        std::fs::write(layout.rig_log(), bytes).unwrap();
        std::fs::write(layout.journal(), JOURNAL).unwrap();
        if repair(layout.root()).is_err() {
            return;
        }
        let Ok(session) = Session::open(layout.root()) else { return };
        let _ = verify(&session);
        let _ = session.rig_log_contents();
        for name in ["raw", "rgb"] {
            session.pi_frames(name).into_iter().flatten().take(64).for_each(drop);
        }
    });
}

/// Files of the published recorder: metadata and raw samples.
pub fn raw2event_files(bytes: &[u8]) {
    let (records, n_left) = raw2event::parse_metadata(bytes, chrono_tz::UTC);
    assert!(records.len() <= bytes.len() && n_left <= bytes.len());
    let _ = raw2event::sensor_unit(&records);
    let samples: Vec<u16> =
        bytes.chunks_exact(2).map(|pair| u16::from_le_bytes([pair[0], pair[1]])).collect();
    let _ = raw2event::raw_justification(&samples);
}

/// Descriptions of a rig, of a trajectory on the simulated rig, and of a world.
pub fn descriptions(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    let _ = Rig::parse("fuzz.toml", text);
    let _ = WorldDescription::parse("fuzz.toml", text);
    if let (Ok(trajectory), Ok(rig)) = (Trajectory::parse("fuzz.toml", text), Rig::simulated()) {
        let _ = Plan::new(&trajectory, &rig, OptionalSegments::Included);
    }
}

/// The manifest of a session and the record of a stage. No stream may be outside the session's
/// directory.
pub fn manifest(bytes: &[u8]) {
    in_a_session(|layout| {
        std::fs::write(layout.manifest(), bytes).unwrap();
        if let Ok(session) = Session::open(layout.root()) {
            let _ = verify(&session);
            let _ = session.rig();
            for stream in &session.manifest().streams {
                let _ = session.events(&stream.name);
                let _ = session.pi_frames(&stream.name).map(Iterator::count);
            }
        }
        std::fs::write(layout.root().join("stage.json"), bytes).unwrap();
        let _ = read_stage(layout.root());
    });
}

/// The journal of an interrupted session.
pub fn journal(bytes: &[u8]) {
    in_a_session(|layout| {
        std::fs::write(layout.journal(), bytes).unwrap();
        let _ = repair(layout.root());
    });
}

/// Imported file by the first byte of the input.
const IMPORTED: [&str; 17] = [
    "frames.npy",
    "times.npy",
    "times.csv",
    "events.npy",
    "events.npz",
    "events.csv",
    "events.h5",
    "images/0.png",
    "images/0.tif",
    "events.parquet",
    "events.raw",
    "events.dat",
    "events.aedat",
    "events.bag",
    "events.mcap",
    "events.zip",
    "frames.bin",
];

/// One file of an import of frames, selected by the first byte; the other files are valid.
pub fn imported(bytes: &[u8]) {
    let Some((which, bytes)) = bytes.split_first() else { return };
    let name = IMPORTED[usize::from(*which) % IMPORTED.len()];
    in_a_session(|layout| {
        let given = layout.root().join("given");
        std::fs::create_dir_all(given.join("images")).unwrap();
        let at = |name: &str| given.join(name);
        write_frames(&at("frames.npy"));
        std::fs::write(at(name), bytes).unwrap();
        let is = |of: &str| name.starts_with(of);
        let frames = at(if is("images") {
            "images"
        } else if is("frames.bin") {
            name
        } else {
            "frames.npy"
        });
        let times = if is("times") { FrameTimes::File(at(name)) } else { FrameTimes::Fps(50.0) };
        let events = is("events").then(|| at(name));
        let request = frames_and_events(&frames, times, events.as_deref());
        let _ = import_frames(&request, &layout.root().join("session"));
    });
}

/// Recording by the first byte of the input.
const RECORDINGS: [&str; 5] = ["a.bag", "a.mcap", "a.aedat", "a.raw", "a.dat"];

/// A recording with events, frames and inertial samples of another program.
pub fn recordings(bytes: &[u8]) {
    let Some((which, bytes)) = bytes.split_first() else { return };
    in_a_session(|layout| {
        let file = layout.root().join(RECORDINGS[usize::from(*which) % RECORDINGS.len()]);
        std::fs::write(&file, bytes).unwrap();
        for size in [None, Some(Size::new(4, 2))] {
            let request =
                ImportRecording { file: &file, size, options: EventTableOptions::default() };
            let root = layout.root().join("session");
            let _ = import_recording(&request, &root);
            let _ = std::fs::remove_dir_all(root);
        }
    });
}

fn frames_and_events<'a>(
    frames: &'a Path,
    times: FrameTimes,
    events: Option<&'a Path>,
) -> ImportFrames<'a> {
    let events_name = StreamName::new("real").unwrap();
    let options = EventTableOptions::default();
    let raw = RawFrameOptions { size: Some(Size::new(4, 2)), ..RawFrameOptions::default() };
    ImportFrames { frames, times, frame_time_unit: None, events, events_name, options, raw }
}

/// Result file by the first byte of the input.
const RESULTS: [&str; 8] = [
    "sync/clock.json",
    "track-frames/track.json",
    "scene/scene.json",
    "calibrate-frames/k.json",
    "compare-simulated/comparison.json",
    "diagnose/diagnosis.json",
    "diagnose/forward_simulation.json",
    "diagnose/heat.json",
];

/// A result that later stages and the report read, selected by the first byte.
pub fn results(bytes: &[u8]) {
    let Some((which, bytes)) = bytes.split_first() else { return };
    let name = RESULTS[usize::from(*which) % RESULTS.len()];
    in_a_session(|layout| {
        let frames = layout.root().join("frames.npy");
        write_frames(&frames);
        let request = frames_and_events(&frames, FrameTimes::Fps(50.0), None);
        let root = layout.root().join("session");
        import_frames(&request, &root).unwrap();
        let session = Session::open(&root).unwrap();
        let path = root.join("derived").join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        write_companions(path.parent().unwrap());
        std::fs::write(&path, bytes).unwrap();
        let _ = pipeline::read_clocks(&session);
        let _ = pipeline::read_comparison(&session, &StreamName::new("simulated").unwrap());
        let _ = pipeline::read_track(&session, "frames");
        let _ = pipeline::read_scene(&session);
        let _ = pipeline::read_diagnosis(&session);
        let _ = pipeline::report(&session);
    });
}

/// The other files of a scene and of a comparison.
fn write_companions(folder: &Path) {
    let record = StageRecord::new("any", None, BTreeMap::new(), serde_json::Value::Null);
    write_stage(folder, record, &[]).unwrap();
    for (name, n) in [("map.npy", 4), ("map_error.npy", 4), ("path.npy", 2 * PATH_COLUMNS)] {
        let mut writer = ArrayWriter::<f64>::create(&folder.join(name), &[n as u64]).unwrap();
        writer.extend(&vec![0.5; n]).unwrap();
        writer.finish().unwrap();
    }
    let mut maps = NpzWriter::create(&folder.join("maps.npz")).unwrap();
    for name in ["real_on", "real_off", "simulated_on", "simulated_off"] {
        maps.add(name, &[2, 3], [0_u32, 1, 2, 3, 4, 5]).unwrap();
    }
    maps.finish().unwrap();
}

/// Two frames of two by three pixels.
fn write_frames(path: &Path) {
    let mut writer = ArrayWriter::<u8>::create(path, &[2, 2, 3]).unwrap();
    writer.extend(&[10, 20, 30, 40, 50, 60, 60, 50, 40, 30, 20, 10]).unwrap();
    writer.finish().unwrap();
}

const JOURNAL: &str = "{\"what\":\"trajectory\"}\n";

fn in_a_session(work: impl FnOnce(&SessionLayout)) {
    // In shared memory where possible, because this runs many times per second.
    let fast = Path::new("/dev/shm");
    let folder = if fast.is_dir() { tempfile::tempdir_in(fast) } else { tempfile::tempdir() };
    let folder = folder.unwrap();
    work(&SessionLayout::new(folder.path()));
}
