//! Small sessions: a bar that moves over a grid, and the events it causes.

use assert_cmd::Command;
use evrig::event::{Event, Events};
use evrig::format::npy::{ArrayWriter, NpzWriter};
use serde_json::Value;
use std::path::{Path, PathBuf};

const WIDTH: u16 = 24;
const HEIGHT: u16 = 10;
/// Gives too few events for a diagnosis, which would take seconds.
const FEW_FRAMES: u16 = 12;

pub(crate) fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

pub(crate) fn evrig() -> Command {
    Command::cargo_bin("evrig").unwrap()
}

/// Exit code, result and standard error of a command run with `--json`.
pub(crate) fn json(command: &mut Command) -> (i32, Value, String) {
    let output = command.arg("--json").output().unwrap();
    let value = serde_json::from_slice(&output.stdout).unwrap_or(Value::Null);
    let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
    (output.status.code().unwrap_or(-1), value, stderr)
}

/// Exit code, standard error and result of evrig with `--json`.
pub(crate) fn run_json(arguments: &[&str]) -> (i32, String, Value) {
    let (code, value, stderr) = json(evrig().args(arguments));
    (code, stderr, value)
}

/// Exit code and both outputs of a command.
pub(crate) fn run(command: &mut Command) -> (i32, String) {
    let output = command.output().unwrap();
    let printed = [output.stderr, output.stdout].concat();
    (output.status.code().unwrap(), String::from_utf8(printed).unwrap())
}

/// The Python of `EVRIG_PYTHON`; prints why a test is skipped when there is none.
pub(crate) fn python(packages: &str) -> Option<String> {
    let python = std::env::var("EVRIG_PYTHON").ok().filter(|path| !path.is_empty());
    if python.is_none() {
        eprintln!("skipped: set EVRIG_PYTHON to a Python with {packages}");
    }
    python
}

/// A dataset of `n` sessions `s0`, `s1`, ... that differ in the bar's start and in the number of
/// missing events.
pub(crate) fn dataset(root: &Path, n: u16) -> PathBuf {
    dataset_of(root, &vec![FEW_FRAMES; usize::from(n)])
}

/// A dataset with one session for each number of frames.
pub(crate) fn dataset_of(root: &Path, n_frames: &[u16]) -> PathBuf {
    let dataset = root.join("dataset");
    let folder = root.join("material");
    std::fs::create_dir_all(&folder).unwrap();
    for (i, n_frames) in (0..).zip(n_frames) {
        let frames = folder.join(format!("{i}.npy"));
        let events = folder.join(format!("{i}.npz"));
        material(&frames, &events, i, *n_frames);
        let session = dataset.join(format!("s{i}"));
        let import = ["import", "frames", text(&frames), "--fps", "100", "--events", text(&events)];
        evrig().args(import).arg("--out").arg(&session).assert().code(0);
    }
    dataset
}

fn material(frames: &Path, events: &Path, seed: u16, n_frames: u16) {
    let size = usize::from(WIDTH) * usize::from(HEIGHT);
    let bright = |x: u16, k: u16| (x + 3 * seed + WIDTH - k % WIDTH) % WIDTH < 5;
    let shape = [u64::from(n_frames), u64::from(HEIGHT), u64::from(WIDTH)];
    let mut writer = ArrayWriter::<u8>::create(frames, &shape).unwrap();
    let mut recorded = Events::new();
    for k in 0..n_frames {
        // Several levels, because a single one would be taken for saturation.
        let pixel =
            |i: usize| if bright(i as u16 % WIDTH, k) { 180 + 3 * (i % 7) as u8 } else { 40 };
        writer.extend(&(0..size).map(pixel).collect::<Vec<u8>>()).unwrap();
        for x in 0..WIDTH {
            if k > 0 && bright(x, k) != bright(x, k - 1) {
                for y in (0..HEIGHT).filter(|y| (x + y + k) % (5 + seed) != 0) {
                    let delay = i64::from((y * 7 + x * 3 + seed) % 40) * 25;
                    let t = i64::from(k) * 10_000 - 5_000 + delay;
                    recorded.push(Event { t, x, y, on: bright(x, k) });
                }
            }
        }
    }
    writer.finish().unwrap();
    recorded.sort_by_time();
    let mut npz = NpzWriter::create(events).unwrap();
    let rows = recorded.as_slice().iter().flat_map(|e| [e.t, e.x.into(), e.y.into(), e.on.into()]);
    npz.add::<i64>("events", &[recorded.len() as u64, 4], rows).unwrap();
    npz.finish().unwrap();
}

/// Every file below a directory with its bytes, except locks and the files of Slurm jobs.
pub(crate) fn tree(root: &Path) -> Vec<(String, Vec<u8>)> {
    let mut files = Vec::new();
    let mut folders = vec![root.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).unwrap() {
            let path = entry.unwrap().path();
            let name = path.strip_prefix(root).unwrap().to_str().unwrap().to_owned();
            if path.is_dir() {
                if name != "batch/slurm" {
                    folders.push(path);
                }
            } else if path.file_name().unwrap() != "lock" {
                files.push((name, std::fs::read(&path).unwrap()));
            }
        }
    }
    files.sort();
    files
}

/// A copy of a directory.
pub(crate) fn copy(from: &Path, to: &Path) {
    for (name, bytes) in tree(from) {
        let path = to.join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, bytes).unwrap();
    }
}
