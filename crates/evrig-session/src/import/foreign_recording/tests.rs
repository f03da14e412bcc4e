//! Recordings written by hand become sessions with everything that was planted.

use super::*;
use crate::{Session, StreamKind};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;

/// An AEDAT 3.1 file: four packets of 100 events, a frame behind each, and an inertial sample.
fn aedat3() -> Vec<u8> {
    let mut bytes = b"#!AER-DAT3.1\r\n#!END-HEADER\r\n".to_vec();
    let words = |words: &[u32]| words.iter().flat_map(|w| w.to_le_bytes()).collect::<Vec<u8>>();
    let mut put = |kind: u16, n: u32, body: Vec<u8>| {
        bytes.extend([kind.to_le_bytes(), 1_u16.to_le_bytes()].concat());
        bytes.extend(words(&[body.len() as u32 / n, 4, 0, n, n, n]));
        bytes.extend(body);
    };
    for k in 0..4_u32 {
        let event = |i: u32| [((i % 4) << 17) | ((i % 3) << 2) | 3, 10_000 * k + 100 * i];
        put(1, 100, (0..100).flat_map(|i| words(&event(i))).collect());
        let t = 10_000 * k;
        let mut frame = words(&[0b11, t, t + 900, t + 100, t + 500, 4, 3, 0, 0]);
        frame.extend((0..12_u16).flat_map(|i| (i * 100).to_le_bytes()));
        put(2, 1, frame);
        let values = [0.0_f32, 0.0, 1.0, k as f32, 0.0, 0.0, 30.0];
        let values = values.iter().flat_map(|v| v.to_le_bytes());
        put(3, 1, words(&[1, t]).into_iter().chain(values).collect());
    }
    bytes
}

fn import(path: &Path, topic: Option<&str>) -> (tempfile::TempDir, Result<Manifest, String>) {
    let directory = tempfile::tempdir().unwrap();
    let options = EventTableOptions { table: topic.map(str::to_owned), ..Default::default() };
    let request = ImportRecording { file: path, size: None, options };
    let made = import_recording(&request, &directory.path().join("session"));
    (directory, made.map_err(|error| error.to_string()))
}

fn streams(manifest: &Manifest) -> Vec<(&str, u64)> {
    manifest.streams.iter().map(|stream| (stream.name.as_str(), stream.count)).collect()
}

#[test]
fn frames_and_inertial_samples_come_with_the_events() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.aedat");
    std::fs::write(&path, aedat3()).unwrap();
    let (made, manifest) = import(&path, None);
    let manifest = manifest.unwrap();
    assert_eq!(streams(&manifest), [("real", 400), ("aps", 4), ("imu", 4)]);
    assert_eq!(manifest.losses, []);
    let session = Session::open(&made.path().join("session")).unwrap();
    let (events, _) = session.events("real").unwrap();
    assert_eq!(events.as_slice().t[101], 10_100);
    assert_eq!(session.stream(StreamKind::Events, "real").unwrap().size, Some(Size::new(4, 3)));
    let frames: Vec<_> = session.davis_frames("aps").unwrap().map(|f| f.unwrap().frame).collect();
    assert_eq!(frames[3].timing.mid_exposure(0).as_micros(), 30_300);
    assert!(!made.path().join("session/converted.aedat4").exists());
}

#[test]
fn a_file_cut_anywhere_gives_what_precedes_the_cut_and_a_loss() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.aedat");
    let whole = aedat3();
    for end in (whole.len() / 5..whole.len()).step_by(97) {
        std::fs::write(&path, &whole[..end]).unwrap();
        let (_directory, manifest) = import(&path, None);
        let manifest = manifest.unwrap();
        // Packets of events, a frame and a sample, behind a header of 28 bytes.
        let (heads, lengths) = (28, [828, 88, 64]);
        let (round, rest) = ((end - heads) / 980, (end - heads) % 980);
        let expected = 100 * round + (rest.saturating_sub(28) / 8).min(100);
        assert_eq!(streams(&manifest)[0].1, expected as u64, "{end}");
        let losses: Vec<&str> = manifest.losses.iter().map(|loss| loss.what.as_str()).collect();
        // Between two packets a cut is not to be seen.
        let is_between = [0, lengths[0], lengths[0] + lengths[1]].contains(&rest);
        assert!(is_between || losses.iter().any(|what| what.contains("cut")), "{end}: {losses:?}");
    }
}

/// A CDR message `event_camera_msgs/EventPacket` of the encoding `mono` with one event.
fn packet(t_us: u32, x: u16, width: u32) -> Vec<u8> {
    let mut bytes = vec![0, 1, 0, 0];
    let mut put = |field: &[u8], align: usize| {
        let at = (bytes.len() - 4).next_multiple_of(align);
        bytes.resize(4 + at, 0);
        bytes.extend(field);
    };
    put(&(t_us / 1_000_000).to_le_bytes(), 4);
    put(&(t_us % 1_000_000 * 1_000).to_le_bytes(), 4);
    // The frame's name, height and width.
    [1, 0].iter().for_each(|n: &u32| put(&n.to_le_bytes(), 4));
    bytes.truncate(bytes.len() - 4);
    bytes.push(0);
    let mut put = |field: &[u8], align: usize| {
        let at = (bytes.len() - 4).next_multiple_of(align);
        bytes.resize(4 + at, 0);
        bytes.extend(field);
    };
    [10, width].iter().for_each(|n: &u32| put(&n.to_le_bytes(), 4));
    [0, 0].iter().for_each(|n: &u64| put(&n.to_le_bytes(), 8));
    put(&5_u32.to_le_bytes(), 4);
    put(b"mono\0", 1);
    put(&[0], 1);
    put(&8_u32.to_le_bytes(), 4);
    put(&(u64::from(x) << 32).to_le_bytes(), 1);
    bytes
}

/// An MCAP file of two cameras, of 30 and of 20 events.
fn two_cameras(path: &Path) {
    let mut file = mcap::Writer::new(BufWriter::new(File::create(path).unwrap())).unwrap();
    let kind = "event_camera_msgs/msg/EventPacket";
    let schema = file.add_schema(kind, "ros2msg", b"").unwrap();
    for (topic, n, width) in [("/right/events", 20, 60), ("/left/events", 30, 40)] {
        let channel_id = file.add_channel(schema, topic, "cdr", &BTreeMap::new()).unwrap();
        for i in 0..n {
            let time = u64::from(i) * 1_000_000;
            let header = mcap::records::MessageHeader {
                channel_id,
                sequence: i,
                log_time: time,
                publish_time: time,
            };
            let message = packet(5_000_000 + i * 1_000, i as u16, width);
            file.write_to_known_channel(&header, &message).unwrap();
        }
    }
    file.finish().unwrap();
}

#[test]
fn several_cameras_are_named_or_one_is_chosen_by_its_topic() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.mcap");
    two_cameras(&path);
    let (_made, manifest) = import(&path, None);
    let manifest = manifest.unwrap();
    let names: Vec<(&str, u64)> = streams(&manifest);
    assert_eq!(names, [("real", 30), ("real-1", 20)]);
    let decisions = manifest.decisions.join("\n");
    assert!(decisions.contains("(`/left/events` of"), "{decisions}");
    assert!(decisions.contains("(`/right/events` of"), "{decisions}");
    let (_made, manifest) = import(&path, Some("/right/events"));
    let manifest = manifest.unwrap();
    assert_eq!(streams(&manifest), [("real", 20)]);
    assert_eq!(manifest.streams[0].size, Some(Size::new(60, 10)));
    assert!(manifest.decisions.join("\n").contains("/left/events"));
    let (_made, refused) = import(&path, Some("/middle/events"));
    let refused = refused.unwrap_err();
    assert!(refused.contains("it has: /right/events, /left/events"), "{refused}");
}

#[test]
fn sqlite_is_refused_with_the_command_that_converts_it() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.db3");
    std::fs::write(&path, b"SQLite format 3\0 and more").unwrap();
    let (_made, refused) = import(&path, None);
    assert!(refused.unwrap_err().contains("mcap convert"));
    assert!(crate::import::detect(directory.path()).unwrap_err().to_string().contains("mcap"));
}
