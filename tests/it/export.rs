//! What `evrig export` writes is read back, by our own readers and by the libraries users have.
//!
//! The second needs a Python with the packages of `.ci/python-packages.txt`, named by `EVRIG_PYTHON`;
//! says so and passes when that is unset.

use crate::small_rig;

use assert_cmd::Command;
use std::path::{Path, PathBuf};

/// The beginning of the real recording: some tens of frames and their events, cut in a packet.
fn street(directory: &Path) -> PathBuf {
    let bytes = std::fs::read("tests/data/davis346-street.aedat4").unwrap();
    let cut = directory.join("cut.aedat4");
    std::fs::write(&cut, &bytes[..1_500_000]).unwrap();
    let session = directory.join("street");
    let (code, said) = evrig(&["import", "aedat4", text(&cut), "--out", text(&session)]);
    // A cut file is taken in up to its cut, and that is a loss.
    assert_eq!(code, 3, "{said}");
    session
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

fn evrig(arguments: &[&str]) -> (i32, String) {
    let output = Command::cargo_bin("evrig").unwrap().args(arguments).output().unwrap();
    let said = [output.stderr, output.stdout].concat();
    (output.status.code().unwrap(), String::from_utf8(said).unwrap())
}

#[test]
fn every_format_is_read_back_the_same_by_the_libraries_of_its_users() {
    let Some(python) = std::env::var("EVRIG_PYTHON").ok().filter(|p| !p.is_empty()) else {
        eprintln!(
            "skipped: set EVRIG_PYTHON to a Python with h5py, pyarrow, dv-processing and mcap"
        );
        return;
    };
    let directory = tempfile::tempdir().unwrap();
    let session = street(directory.path());
    for file in ["real.npz", "real.h5", "real.parquet", "real.aedat4", "real.mcap"] {
        let out = directory.path().join(file);
        let (code, said) =
            evrig(&["export", text(&session), "--stream", "real", "--out", text(&out)]);
        assert_eq!(code, 0, "{file}: {said}");
    }
    let read = std::process::Command::new(python)
        .arg("tests/python/read_exports.py")
        .arg(directory.path())
        .output()
        .unwrap();
    assert!(read.status.success(), "{}", String::from_utf8_lossy(&read.stderr));
    eprintln!("{}", String::from_utf8_lossy(&read.stdout));
}

#[test]
fn what_is_known_of_images_clocks_and_seeds_goes_with_every_format_and_is_the_sessions_own() {
    let Some(python) = std::env::var("EVRIG_PYTHON").ok().filter(|p| !p.is_empty()) else {
        eprintln!("skipped: set EVRIG_PYTHON to a Python with h5py, dv-processing and mcap");
        return;
    };
    let directory = tempfile::tempdir().unwrap();
    let session = directory.path().join("session");
    small_rig::aligned_session(&session);
    let arguments = ["generate", text(&session), "--from", "scene", "--seed", "77"];
    let (code, said) = evrig(&arguments);
    assert_eq!(code, 0, "{said}");
    for stream in ["real", "scene"] {
        for ending in ["npz", "h5", "parquet", "aedat4", "mcap"] {
            let out = directory.path().join(format!("{stream}.{ending}"));
            let arguments = ["export", text(&session), "--stream", stream, "--out", text(&out)];
            let (code, said) = evrig(&arguments);
            assert_eq!(code, 0, "{stream} {ending}: {said}");
        }
    }
    let read = std::process::Command::new(python)
        .arg("tests/python/read_side.py")
        .args([&session, directory.path()])
        .output()
        .unwrap();
    assert!(read.status.success(), "{}", String::from_utf8_lossy(&read.stderr));
    eprintln!("{}", String::from_utf8_lossy(&read.stdout));
}

/// Needs `rerun-sdk` of the version of Cargo.toml's `re_sdk` beside the other packages.
#[cfg(feature = "rerun")]
#[test]
fn an_rrd_file_is_read_back_by_reruns_own_package() {
    let Some(python) = std::env::var("EVRIG_PYTHON").ok().filter(|p| !p.is_empty()) else {
        eprintln!("skipped: set EVRIG_PYTHON to a Python with rerun-sdk 0.26.2");
        return;
    };
    let directory = tempfile::tempdir().unwrap();
    let session = directory.path().join("session");
    small_rig::aligned_session(&session);
    for file in ["real.rrd", "real.npz"] {
        let out = directory.path().join(file);
        let (code, said) =
            evrig(&["export", text(&session), "--stream", "real", "--out", text(&out)]);
        assert_eq!(code, 0, "{file}: {said}");
    }
    let mut read = std::process::Command::new(python);
    let read = read.arg("tests/python/read_rrd.py").arg(directory.path()).output().unwrap();
    assert!(read.status.success(), "{}", String::from_utf8_lossy(&read.stderr));
    eprintln!("{}", String::from_utf8_lossy(&read.stdout));
}

#[cfg(not(feature = "rerun"))]
#[test]
fn an_evrig_without_rrd_files_says_how_to_have_them_and_leaves_none() {
    let directory = tempfile::tempdir().unwrap();
    let session = street(directory.path());
    let out = directory.path().join("real.rrd");
    let (code, said) = evrig(&["export", text(&session), "--stream", "real", "--out", text(&out)]);
    assert_eq!(code, 1, "{said}");
    assert!(said.contains("--features rerun") && said.contains("--format mcap"), "{said}");
    assert!(!out.exists());
}

#[test]
fn an_exported_stream_comes_back_in_as_it_was() {
    let directory = tempfile::tempdir().unwrap();
    let session = street(directory.path());
    let frames = directory.path().join("frames.npy");
    let mut writer =
        evrig::format::npy::ArrayWriter::<u8>::create(&frames, &[2, 260, 346]).unwrap();
    writer.extend(&vec![50; 2 * 260 * 346]).unwrap();
    writer.finish().unwrap();
    let open = |path: &Path| evrig::session::Session::open(path).unwrap();
    let (wanted, _) = open(&session).events("real").unwrap();
    assert!(wanted.len() > 1_000);
    for file in ["again.h5", "again.npz", "again.aedat4"] {
        let out = directory.path().join(file);
        let (code, said) =
            evrig(&["export", text(&session), "--stream", "real", "--out", text(&out)]);
        assert_eq!(code, 0, "{said}");
        let back = directory.path().join(format!("back-{file}"));
        let import = ["import", "frames", text(&frames), "--fps", "10", "--events", text(&out)];
        let (code, said) = evrig(&[&import[..], &["--out", text(&back)]].concat());
        assert_eq!(code, 0, "{said}");
        assert!(open(&back).events("real").unwrap().0 == wanted, "{file}");
    }
}

#[test]
fn of_one_name_for_frames_and_events_each_can_be_had() {
    let directory = tempfile::tempdir().unwrap();
    let session = street(directory.path());
    let (code, said) = evrig(&["generate", text(&session), "--from", "aps"]);
    assert_eq!(code, 0, "{said}");
    let out = directory.path().join("aps.npz");
    let arguments = ["export", text(&session), "--stream", "aps", "--out", text(&out)];
    let (code, said) = evrig(&arguments);
    assert_eq!(code, 0, "{said}");
    assert!(said.contains("--kind frames") && said.contains("events ["), "{said}");
    let (code, said) = evrig(&[&arguments[..], &["--kind", "frames"]].concat());
    assert_eq!(code, 0, "{said}");
    assert!(said.contains("frames [14, 260, 346]"), "{said}");
}

#[test]
fn what_cannot_be_exported_is_one_clear_error_and_leaves_no_file() {
    let directory = tempfile::tempdir().unwrap();
    let session = street(directory.path());
    let inside = session.join("davis.aedat4");
    let before = std::fs::read(&inside).unwrap();
    let h5 = directory.path().join("x.h5");
    let far = directory.path().join("no/such/folder/x.h5");
    for (stream, out, more, expected) in [
        ("nosuch", &h5, vec![], "it has: real"),
        ("aps", &h5, vec![], "only --format npz"),
        ("real", &h5, vec!["--canvas", "80"], "run `evrig filter`"),
        ("real", &h5, vec!["--filtered"], "run `evrig filter`"),
        ("real", &inside, vec![], "a file of the session itself"),
        ("real", &far, vec![], "No such file"),
    ] {
        let arguments = ["export", text(&session), "--stream", stream, "--out", text(out)];
        let (code, said) = evrig(&[&arguments[..], &more[..]].concat());
        assert_eq!(code, 1, "{stream} {more:?}: {said}");
        assert!(said.contains(expected), "{stream} {more:?}: {said}");
        assert!(said.starts_with("error: ") && said.lines().count() == 1, "{said}");
    }
    assert!(!h5.exists());
    assert!(std::fs::read(&inside).unwrap() == before, "the recording is as it was");
}
