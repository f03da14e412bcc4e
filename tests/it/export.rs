//! The files of `evrig export` are read back by evrig and by common libraries.
//!
//! The libraries need a Python with the packages of `.ci/python-packages.txt`, named by
//! `EVRIG_PYTHON`; these tests are skipped when it is unset.

use crate::sessions::{self, python, run, text};
use crate::small_rig;
use std::path::{Path, PathBuf};

/// The start of the real recording, truncated inside a packet: some tens of frames and their
/// events.
fn street(directory: &Path) -> PathBuf {
    let bytes = std::fs::read("tests/data/davis346-street.aedat4").unwrap();
    let cut = directory.join("cut.aedat4");
    std::fs::write(&cut, &bytes[..1_500_000]).unwrap();
    let session = directory.join("street");
    let (code, printed) = evrig(&["import", "aedat4", text(&cut), "--out", text(&session)]);
    // A truncated file is imported up to the cut, which counts as a loss.
    assert_eq!(code, 3, "{printed}");
    session
}

fn evrig(arguments: &[&str]) -> (i32, String) {
    run(sessions::evrig().args(arguments))
}

#[test]
fn every_format_is_read_back_unchanged_by_common_libraries() {
    let Some(python) = python("h5py, pyarrow, dv-processing and mcap") else { return };
    let directory = tempfile::tempdir().unwrap();
    let session = street(directory.path());
    for file in ["real.npz", "real.h5", "real.parquet", "real.aedat4", "real.mcap"] {
        let out = directory.path().join(file);
        let (code, printed) =
            evrig(&["export", text(&session), "--stream", "real", "--out", text(&out)]);
        assert_eq!(code, 0, "{file}: {printed}");
    }
    let read = std::process::Command::new(python)
        .arg("tests/python/read_exports.py")
        .arg(directory.path())
        .output()
        .unwrap();
    assert!(read.status.success(), "{}", String::from_utf8_lossy(&read.stderr));
    eprintln!("{}", String::from_utf8_lossy(&read.stdout));
}

/// HDF5 2.0 refuses chunks whose dimensions are encoded in more bytes than they need; former
/// versions do not. `EVRIG_OLD_H5PY_PYTHON` names a Python with h5py 3.11.
#[test]
fn a_recording_of_several_chunks_is_read_by_the_oldest_and_the_newest_h5py() {
    let Some(newest) = python("h5py") else { return };
    let directory = tempfile::tempdir().unwrap();
    let (session, out) = (directory.path().join("street"), directory.path().join("real.h5"));
    let recording = "tests/data/davis346-street.aedat4";
    let (code, printed) = evrig(&["import", "aedat4", recording, "--out", text(&session)]);
    assert_eq!(code, 0, "{printed}");
    let (code, printed) =
        evrig(&["export", text(&session), "--stream", "real", "--out", text(&out)]);
    assert_eq!(code, 0, "{printed}");
    let oldest = std::env::var_os("EVRIG_OLD_H5PY_PYTHON").map(PathBuf::from);
    for program in oldest.into_iter().chain([newest.into()]) {
        let read = std::process::Command::new(program)
            .args(["tests/python/read_hdf5.py", text(&out), "78830"])
            .output()
            .unwrap();
        assert!(read.status.success(), "{}", String::from_utf8_lossy(&read.stderr));
        eprintln!("{}", String::from_utf8_lossy(&read.stdout));
    }
}

#[test]
fn metadata_of_images_clocks_and_seeds_is_exported_unchanged_in_every_format() {
    let Some(python) = python("h5py, dv-processing and mcap") else { return };
    let directory = tempfile::tempdir().unwrap();
    let session = directory.path().join("session");
    small_rig::aligned_session(&session);
    let arguments = ["generate", text(&session), "--from", "scene", "--seed", "77"];
    let (code, printed) = evrig(&arguments);
    assert_eq!(code, 0, "{printed}");
    for stream in ["real", "scene"] {
        for ending in ["npz", "h5", "parquet", "aedat4", "mcap"] {
            let out = directory.path().join(format!("{stream}.{ending}"));
            let arguments = ["export", text(&session), "--stream", stream, "--out", text(&out)];
            let (code, printed) = evrig(&arguments);
            assert_eq!(code, 0, "{stream} {ending}: {printed}");
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

/// Also needs `rerun-sdk` in the version of `re_sdk` in Cargo.toml.
#[cfg(feature = "rerun")]
#[test]
fn an_rrd_file_is_read_back_by_the_package_of_rerun() {
    let Some(python) = python("rerun-sdk 0.26.2") else { return };
    let directory = tempfile::tempdir().unwrap();
    let session = directory.path().join("session");
    small_rig::aligned_session(&session);
    for file in ["real.rrd", "real.npz"] {
        let out = directory.path().join(file);
        let (code, printed) =
            evrig(&["export", text(&session), "--stream", "real", "--out", text(&out)]);
        assert_eq!(code, 0, "{file}: {printed}");
    }
    let mut read = std::process::Command::new(python);
    let read = read.arg("tests/python/read_rrd.py").arg(directory.path()).output().unwrap();
    assert!(read.status.success(), "{}", String::from_utf8_lossy(&read.stderr));
    eprintln!("{}", String::from_utf8_lossy(&read.stdout));
}

#[cfg(not(feature = "rerun"))]
#[test]
fn rrd_export_without_its_feature_is_refused_with_the_alternatives() {
    let directory = tempfile::tempdir().unwrap();
    let session = street(directory.path());
    let out = directory.path().join("real.rrd");
    let (code, printed) =
        evrig(&["export", text(&session), "--stream", "real", "--out", text(&out)]);
    assert_eq!(code, 1, "{printed}");
    assert!(printed.contains("--features rerun") && printed.contains("--format mcap"), "{printed}");
    assert!(!out.exists());
}

#[test]
fn an_exported_stream_is_imported_unchanged() {
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
        let (code, printed) =
            evrig(&["export", text(&session), "--stream", "real", "--out", text(&out)]);
        assert_eq!(code, 0, "{printed}");
        let back = directory.path().join(format!("back-{file}"));
        let times = directory.path().join("times.txt");
        let first = wanted.as_slice().t[0];
        std::fs::write(&times, format!("t_us\n{first}\n{}\n", first + 100_000)).unwrap();
        let times = text(&times);
        let import =
            ["import", "frames", text(&frames), "--timestamps", times, "--events", text(&out)];
        let (code, printed) = evrig(&[&import[..], &["--out", text(&back)]].concat());
        assert_eq!(code, 0, "{printed}");
        assert!(open(&back).events("real").unwrap().0 == wanted, "{file}");
    }
}

#[test]
fn frames_and_events_of_one_name_can_both_be_exported() {
    let directory = tempfile::tempdir().unwrap();
    let session = street(directory.path());
    let (code, printed) = evrig(&["generate", text(&session), "--from", "aps"]);
    assert_eq!(code, 0, "{printed}");
    let out = directory.path().join("aps.npz");
    let arguments = ["export", text(&session), "--stream", "aps", "--out", text(&out)];
    let (code, printed) = evrig(&arguments);
    assert_eq!(code, 0, "{printed}");
    assert!(printed.contains("--kind frames") && printed.contains("events ["), "{printed}");
    let (code, printed) = evrig(&[&arguments[..], &["--kind", "frames"]].concat());
    assert_eq!(code, 0, "{printed}");
    assert!(printed.contains("frames [14, 260, 346]"), "{printed}");
}

#[test]
fn invalid_exports_give_a_one_line_error_and_no_file() {
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
        let (code, printed) = evrig(&[&arguments[..], &more[..]].concat());
        assert_eq!(code, 1, "{stream} {more:?}: {printed}");
        assert!(printed.contains(expected), "{stream} {more:?}: {printed}");
        assert!(printed.starts_with("error: ") && printed.lines().count() == 1, "{printed}");
    }
    assert!(!h5.exists());
    assert!(std::fs::read(&inside).unwrap() == before, "the recording is unchanged");
}
