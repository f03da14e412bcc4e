use super::*;
use crate::{HostTime, PacketArrival, RigLogWriter};
use evrig_core::event::{Event, Events};
use evrig_core::geometry::Size;
use evrig_core::time::Stamp;
use evrig_format::aedat4::{Compression, StreamSpec, Writer};
use std::path::PathBuf;

const N_PACKETS: i64 = 40;
const PACKET: i64 = 100;

fn host(ms: i64) -> HostTime {
    HostTime {
        monotonic: Stamp::from_micros(ms * 1_000),
        unix: Stamp::from_micros(1_700_000_000_000_000 + ms * 1_000),
    }
}

/// A recording of 40 packets, 100 ms apart, whose recorder died: no table, no footer, no manifest.
fn cut_off(folder: &Path) -> PathBuf {
    let root = folder.join("session");
    std::fs::create_dir(&root).unwrap();
    let layout = SessionLayout::new(&root);
    let mut journal = Journal::open(&layout.journal()).unwrap();
    let descriptions = json!({
        "rig": {"name": "sim", "text": "the rig's text"},
        "trajectory": {"name": "circle", "text": "the path's text"},
        "clocks": {"reference": "host"},
    });
    journal.note("recording", &descriptions).unwrap();
    journal.note("device", &json!({"name": "davis", "says": {"source": "here"}})).unwrap();
    journal.note("device", &json!({"name": "pi", "description": {"source": "there"}})).unwrap();
    journal.note("trajectory", &json!({})).unwrap();
    journal.note("first step", &json!({"unix_ns": 1_700_000_000_000_000_123_i64})).unwrap();
    let specs = [StreamSpec::events(Size::DAVIS346, "DAVIS346_1")];
    let mut file = Writer::create(layout.davis(), Compression::None, &specs).unwrap();
    let mut log = RigLogWriter::create(&layout.rig_log()).unwrap();
    for packet in 0..N_PACKETS {
        let stamps = packet * 100_000..packet * 100_000 + PACKET;
        let [first_us, last_us] = [stamps.start, stamps.end - 1];
        let events: Events = stamps.map(|t| Event { t, x: 7, y: 9, on: true }).collect();
        file.write_events(0, events.as_slice()).unwrap();
        let (stream, count, arrived) = (0, PACKET as u64, host(packet * 100));
        log.arrival(&PacketArrival { stream, count, first_us, last_us, arrived }).unwrap();
    }
    drop((file, log));
    root
}

fn cut(path: &Path, share: f64) {
    let bytes = std::fs::read(path).unwrap();
    std::fs::write(path, &bytes[..(bytes.len() as f64 * share) as usize]).unwrap();
}

fn resealed(root: &Path) -> Manifest {
    match repair(root).unwrap() {
        Repair::Resealed(manifest) => *manifest,
        Repair::NotNeeded => panic!("the session was cut off"),
    }
}

#[test]
fn a_cut_off_recording_is_sealed_as_recovered_and_then_verifies() {
    let folder = tempfile::tempdir().unwrap();
    let root = cut_off(folder.path());
    assert!(Session::open(&root).unwrap_err().to_string().contains("--repair"));
    let manifest = resealed(&root);
    assert_eq!(manifest.status, SessionStatus::Recovered);
    assert_eq!(manifest.streams[0].count, (N_PACKETS * PACKET) as u64);
    let recording = manifest.recording.as_ref().unwrap();
    assert_eq!(recording.rig, "the rig's text");
    assert_eq!(recording.trajectory, "the path's text");
    assert_eq!(recording.trajectory_began_ns, Some(1_700_000_000_000_000_123));
    assert_eq!(recording.devices[0].description["source"], "here", "the former key");
    assert_eq!(recording.devices[1].description["source"], "there");
    assert!(manifest.losses[0].what.contains("cut off in state trajectory"), "{manifest:?}");
    assert!(verify(&Session::open(&root).unwrap()).unwrap().holds());
    assert_eq!(repair(&root).unwrap(), Repair::NotNeeded);
}

#[test]
fn events_that_had_arrived_and_are_not_in_the_file_are_counted_as_lost() {
    let folder = tempfile::tempdir().unwrap();
    let root = cut_off(folder.path());
    cut(&SessionLayout::new(&root).davis(), 0.5);
    let manifest = resealed(&root);
    let held = manifest.streams[0].count;
    assert!(held > 0 && held < (N_PACKETS * PACKET) as u64);
    let missing = manifest.losses.iter().find(|loss| loss.count > 0).unwrap();
    let n_logged = manifest.streams.iter().find(|stream| stream.name == "davis-arrivals");
    assert_eq!(missing.count, n_logged.unwrap().count * PACKET as u64 - held);
    assert!(manifest.files["davis.aedat4"].damage.is_some());
    assert!(verify(&Session::open(&root).unwrap()).unwrap().holds());
}

#[test]
fn files_cut_anywhere_are_repaired_and_verify() {
    let folder = tempfile::tempdir().unwrap();
    for (n, share) in [0.0, 0.001, 0.01, 0.3, 0.77, 0.999].into_iter().enumerate() {
        let part = folder.path().join(n.to_string());
        std::fs::create_dir(&part).unwrap();
        let root = cut_off(&part);
        let layout = SessionLayout::new(&root);
        cut(&layout.davis(), share);
        cut(&layout.rig_log(), share);
        cut(&layout.journal(), share);
        let manifest = resealed(&root);
        assert!(manifest.files.contains_key("davis.aedat4"), "share {share}");
        assert!(verify(&Session::open(&root).unwrap()).unwrap().holds(), "share {share}");
        // A line that was cut is ended before the next one is appended.
        let journal = std::fs::read_to_string(layout.journal()).unwrap();
        let last = journal.lines().last().unwrap();
        assert!(serde_json::from_str::<serde_json::Value>(last).is_ok(), "{journal}");
    }
}

#[test]
fn a_manifest_that_is_no_json_is_set_aside_and_one_of_another_schema_is_left_alone() {
    let folder = tempfile::tempdir().unwrap();
    let root = cut_off(folder.path());
    let manifest = SessionLayout::new(&root).manifest();
    std::fs::write(&manifest, "{\"schema\": \"evrig.session/9\"}").unwrap();
    assert!(repair(&root).unwrap_err().to_string().contains("evrig.session/9"));
    std::fs::write(&manifest, "{\"schema\": ").unwrap();
    let resealed = resealed(&root);
    assert!(resealed.losses.iter().any(|loss| loss.stream == "session.json"));
    assert_eq!(std::fs::read(root.join("session.json.damaged")).unwrap(), b"{\"schema\": ");
}

#[test]
fn a_sealed_session_that_was_changed_is_not_sealed_again() {
    let folder = tempfile::tempdir().unwrap();
    let root = cut_off(folder.path());
    resealed(&root);
    cut(&SessionLayout::new(&root).davis(), 0.9);
    let message = repair(&root).unwrap_err().to_string();
    assert!(message.contains("changed since"), "{message}");
}

#[test]
fn a_recording_under_way_is_left_alone() {
    let folder = tempfile::tempdir().unwrap();
    let root = cut_off(folder.path());
    let held = Journal::open(&SessionLayout::new(&root).journal()).unwrap();
    let message = repair(&root).unwrap_err().to_string();
    assert!(message.contains("being recorded"), "{message}");
    drop(held);
    resealed(&root);
}

#[test]
fn a_folder_without_a_journal_is_no_session() {
    let folder = tempfile::tempdir().unwrap();
    let message = repair(folder.path()).unwrap_err().to_string();
    assert!(message.contains("nothing was recorded"), "{message}");
}
