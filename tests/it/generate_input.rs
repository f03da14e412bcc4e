//! Invalid frames and settings are reported by the commands; black and saturated pixels are valid.

use crate::sessions::run_json as evrig;
use evrig::format::npy::ArrayWriter;
use evrig::session::Session;
use std::path::{Path, PathBuf};

/// Frames of 24 x 16 with a moving wave between black and saturation.
fn clip(root: &Path, n: u64) -> PathBuf {
    let path = root.join("clip.npy");
    let mut writer = ArrayWriter::<u8>::create(&path, &[n, 16, 24]).unwrap();
    for k in 0..n {
        let wave = |i: usize| 127.5 + 300.0 * (0.5 * (i % 24) as f64 + 0.4 * k as f64).sin();
        let frame: Vec<u8> = (0..24 * 16).map(|i| wave(i).clamp(0.0, 255.0) as u8).collect();
        writer.extend(&frame).unwrap();
    }
    writer.finish().unwrap();
    path
}

/// Path of a session of such frames.
fn session(root: &Path) -> String {
    let (frames, session) = (clip(root, 30), root.join("session"));
    let [frames, session] = [frames, session].map(|path| path.to_str().unwrap().to_owned());
    let (code, stderr, _) =
        evrig(&["import", "frames", &frames, "--fps", "100", "--out", &session]);
    assert_eq!(code, 0, "{stderr}");
    session
}

#[test]
fn non_increasing_times_and_changing_sizes_are_reported() {
    let directory = tempfile::tempdir().unwrap();
    let root = directory.path();
    let frames = clip(root, 3);
    let out = root.join("session");
    for (times, expected) in
        [("0\n5\n5\n", "frame 2 at 5000 us"), ("0\n9\n4\n", "frame 2 at 4000 us")]
    {
        let file = root.join("times.txt");
        std::fs::write(&file, times).unwrap();
        let [frames, file, out] = [&frames, &file, &out].map(|path| path.to_str().unwrap());
        let (code, stderr, _) =
            evrig(&["import", "frames", frames, "--timestamps", file, "--out", out]);
        assert_eq!(code, 1, "{stderr}");
        assert!(stderr.contains(expected), "{stderr}");
    }
    let folder = root.join("images");
    std::fs::create_dir(&folder).unwrap();
    for (name, side) in [("1.pgm", 4), ("2.pgm", 5)] {
        let mut image = format!("P5 {side} {side} 255\n").into_bytes();
        image.extend(vec![90; side * side]);
        std::fs::write(folder.join(name), image).unwrap();
    }
    let [folder, out] = [&folder, &out].map(|path| path.to_str().unwrap());
    let (code, stderr, _) = evrig(&["import", "frames", folder, "--fps", "10", "--out", out]);
    assert_eq!(code, 1, "{stderr}");
    assert!(
        stderr.contains("2.pgm") && stderr.contains("5 x 5") && stderr.contains("4 x 4"),
        "{stderr}"
    );
}

#[test]
fn black_and_saturated_pixels_give_valid_events_in_every_model() {
    let directory = tempfile::tempdir().unwrap();
    let session = session(directory.path());
    for preset in ["DVS346", "Raw2DVS346", "RGB2DVS346", "ESIM", "v2e-noisy"] {
        let name = preset.to_lowercase();
        let (code, stderr, made) =
            evrig(&["generate", &session, "--preset", preset, "--name", &name]);
        assert_eq!(code, 0, "{preset}: {stderr}");
        assert!(made["events"].as_u64().unwrap() > 1_000, "{preset}: {made}");
        let (events, tally) = Session::open(Path::new(&session)).unwrap().events(&name).unwrap();
        assert_eq!((tally.outside, tally.sorted_in), (0, 0));
        let inside = made["first_us"].as_i64().unwrap()..=made["last_us"].as_i64().unwrap();
        assert!(events.as_slice().t.iter().all(|t| inside.contains(t)), "{preset}");
    }
}

#[test]
fn settings_out_of_range_exit_with_2_and_are_named() {
    let directory = tempfile::tempdir().unwrap();
    let session = session(directory.path());
    let cases: [(&[&str], &str); 8] = [
        (&["--k", "1,1,-1,0,0,0"], "k3"),
        (&["--k", "1,0,0,0,0,0"], "k2"),
        (&["--k", "1,1,1"], "3 numbers"),
        (&["--knob", "contrast-sensitivity=-4"], "k1 is -4"),
        (&["--knob", "contrast=4"], "contrast-sensitivity"),
        (&["--preset", "DVS345"], "DVS346"),
        (&["--colour", "purple"], "purple"),
        (&["--effect", "refractory_period:refractory_us=-1"], "refractory_us"),
    ];
    for (arguments, expected) in cases {
        let (code, stderr, _) = evrig(&[&["generate", &session], arguments].concat());
        assert_eq!(code, 2, "{arguments:?}: {stderr}");
        assert!(stderr.contains(expected), "{arguments:?}: {stderr}");
        assert!(stderr.starts_with("error: ") && stderr.lines().count() == 1, "{stderr}");
    }
}

#[test]
fn missing_inputs_are_reported_with_the_command_that_makes_them() {
    let directory = tempfile::tempdir().unwrap();
    let session = session(directory.path());
    let cases: [(&[&str], &str); 5] = [
        (&["generate", "--from", "scene"], "evrig scene"),
        (&["generate", "--in-plane"], "evrig track"),
        (&["generate", "--preset", "tuned"], "evrig calibrate"),
        (&["generate", "--from", "raw"], "raw"),
        (&["calibrate"], "real"),
    ];
    for (arguments, expected) in cases {
        let (verb, rest) = arguments.split_first().unwrap();
        let (code, stderr, _) = evrig(&[&[*verb, &session], rest].concat());
        assert_eq!(code, 1, "{arguments:?}: {stderr}");
        assert!(stderr.contains(expected), "{arguments:?}: {stderr}");
        assert!(stderr.starts_with("error: ") && stderr.lines().count() == 1, "{stderr}");
    }
}

#[test]
fn a_sweep_shows_the_effect_of_one_knob_and_the_frame_rhythm_is_reported() {
    let directory = tempfile::tempdir().unwrap();
    let session = session(directory.path());
    let (code, stderr, swept) =
        evrig(&["sweep", &session, "--knob", "contrast-sensitivity=2..8", "--steps", "3"]);
    assert_eq!(code, 0, "{stderr}");
    let counts: Vec<u64> =
        swept["steps"].as_array().unwrap().iter().map(|s| s["events"].as_u64().unwrap()).collect();
    assert!(counts.len() == 3 && counts.windows(2).all(|pair| pair[0] < pair[1]), "{counts:?}");
    let page = std::fs::read_to_string(swept["path"].as_str().unwrap()).unwrap();
    assert!(page.contains("contrast-sensitivity = 2.00") && page.contains("<svg"), "a page");
    let (_, _, made) = evrig(&["generate", &session]);
    let rhythm = made["frame_rhythm"].as_f64().unwrap();
    assert!((0.0..1.0).contains(&rhythm), "{rhythm}");
}
