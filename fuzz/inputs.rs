//! Every parser that takes bytes from outside, each as a function of any bytes: it may refuse them,
//! and must neither panic, nor run for ever, nor take memory without bound.
//!
//! The fuzz targets call these, and so does `tests/fuzz_corpus.rs` with what the fuzzers kept.

use evrig::device::pi::wire;
use evrig::device::sim::world::WorldDescription;
use evrig::format::aedat4::Reader;
use evrig::format::raw2event;
use evrig::rig::Rig;
use evrig::session::{Heard, Layout, Session, read_stage, repair, verify};
use evrig::trajectory::{Optional, Plan, Trajectory};
use std::path::Path;

/// Who takes bytes.
pub type Taker = fn(&[u8]);

/// What the inputs are called, and who takes them.
pub const ALL: [(&str, Taker); 8] = [
    ("aedat4", aedat4),
    ("dobot", dobot),
    ("pi", pi),
    ("rig_log", rig_log),
    ("raw2event", raw2event_files),
    ("descriptions", descriptions),
    ("manifest", manifest),
    ("journal", journal),
];

/// As an AEDAT4 file and as a socket: packets, then at most one error, and an end.
pub fn aedat4(bytes: &[u8]) {
    for reader in
        [Reader::new(bytes, "fuzz"), Reader::from_stream(bytes, "fuzz")].into_iter().flatten()
    {
        let n_errors = reader.filter(Result::is_err).count();
        assert!(n_errors <= 1);
    }
}

/// From the arm's serial line: nothing is lost, nothing grows.
pub fn dobot(bytes: &[u8]) {
    evrig::device::dobot::frame::fuzz(bytes);
}

/// From the network, as host and as agent read it, in pieces of any size: what was whole is a message
/// that can be written again, what was not is one error.
pub fn pi(bytes: &[u8]) {
    if let Some(preamble) = bytes.first_chunk() {
        let _ = wire::check_preamble(preamble);
    }
    let piece = 1 + bytes.first().copied().map_or(0, usize::from);
    let mut decoder = wire::Decoder::default();
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

/// As `rig.mcap`, read as it is recorded and as a session's file.
pub fn rig_log(bytes: &[u8]) {
    drop(Heard::of_rig_log(bytes));
    in_a_session(|layout| {
        std::fs::write(layout.rig_log(), bytes).unwrap();
        std::fs::write(layout.journal(), JOURNAL).unwrap();
        if repair(layout.root()).is_err() {
            return;
        }
        let Ok(session) = Session::open(layout.root()) else { return };
        let _ = verify(&session);
        let _ = session.rig_notes();
        for name in ["raw", "rgb"] {
            session.pi_pictures(name).into_iter().flatten().take(64).for_each(drop);
        }
    });
}

/// As the files of the published recorder: metadata, and raw samples.
pub fn raw2event_files(bytes: &[u8]) {
    let (records, n_left) = raw2event::parse_metadata(bytes, chrono_tz::UTC);
    assert!(records.len() <= bytes.len() && n_left <= bytes.len());
    let _ = raw2event::sensor_unit(&records);
    let samples: Vec<u16> =
        bytes.chunks_exact(2).map(|pair| u16::from_le_bytes([pair[0], pair[1]])).collect();
    let _ = raw2event::raw_justification(&samples);
}

/// As the description of a rig, of a trajectory on the simulated rig, and of a world.
pub fn descriptions(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    let _ = Rig::parse("fuzz.toml", text);
    let _ = WorldDescription::parse("fuzz.toml", text);
    if let (Ok(trajectory), Ok(rig)) = (Trajectory::parse("fuzz.toml", text), Rig::simulated()) {
        let _ = Plan::new(&trajectory, &rig, Optional::Included);
    }
}

/// As the manifest of a session and as the record of a stage, which the diagnosis reads: no stream of
/// it is outside its directory.
pub fn manifest(bytes: &[u8]) {
    in_a_session(|layout| {
        std::fs::write(layout.manifest(), bytes).unwrap();
        if let Ok(session) = Session::open(layout.root()) {
            let _ = verify(&session);
            let _ = session.rig();
            for stream in &session.manifest().streams {
                let _ = session.events(&stream.name);
                let _ = session.pi_pictures(&stream.name).map(Iterator::count);
            }
        }
        std::fs::write(layout.root().join("stage.json"), bytes).unwrap();
        let _ = read_stage(layout.root());
    });
}

/// As the journal of a session that was cut off.
pub fn journal(bytes: &[u8]) {
    in_a_session(|layout| {
        std::fs::write(layout.journal(), bytes).unwrap();
        let _ = repair(layout.root());
    });
}

const JOURNAL: &str = "{\"what\":\"trajectory\"}\n";

fn in_a_session(work: impl FnOnce(&Layout)) {
    // Shared memory, where there is some: this happens many times a second.
    let fast = Path::new("/dev/shm");
    let folder = if fast.is_dir() { tempfile::tempdir_in(fast) } else { tempfile::tempdir() };
    let folder = folder.unwrap();
    work(&Layout::new(folder.path()));
}
