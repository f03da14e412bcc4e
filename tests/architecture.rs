//! The house keeps its own rules: layers, bans, small rooms.

#![allow(clippy::expect_used, clippy::unwrap_used)]

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

/// The rooms from the ground up. A room uses rooms of lower rank only; rooms of
/// one rank that are listed apart do not know each other.
const RANKS: &[&[&str]] = &[
    &["units"],
    &["time"],
    &["stats"],
    &["geometry"],
    &["event"],
    &["frame"],
    &["imu"],
    &["drive"],
    &["effect_id"],
    &["format"],
    &["rig"],
    &["trajectory"],
    &["session"],
    &["device"],
    &["record"],
    &["generate"],
    &["clock"],
    &["roi"],
    &["filter"],
    &["scene"],
    &["predict"],
    &["calibrate"],
    &["compare"],
    &["diagnose"],
    &["report"],
    &["pipeline"],
    &["export"],
    &["batch"],
    &["prove"],
    &["live"],
    &["cli"],
    &["commands"],
];

/// Acquisition and analysis meet only in the files of a session.
const ACQUISITION: &[&str] = &["device", "record"];
const ANALYSIS: &[&str] = &[
    "clock",
    "roi",
    "filter",
    "scene",
    "predict",
    "calibrate",
    "compare",
    "diagnose",
    "report",
    "pipeline",
    "export",
    "batch",
];

/// A file's lines before its tests.
const MAX_LINES: usize = 400;

struct Source {
    path: PathBuf,
    room: String,
    /// Lines before the test module.
    code: Vec<String>,
}

fn sources() -> Vec<Source> {
    let mut files = Vec::new();
    collect(Path::new("src"), &mut files);
    assert!(files.len() > 10, "the sources are where this test looks for them");
    files.into_iter().map(read).collect()
}

fn collect(directory: &Path, files: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(directory).expect("src can be listed") {
        let path = entry.expect("an entry of src").path();
        if path.is_dir() {
            collect(&path, files);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            files.push(path);
        }
    }
}

fn read(path: PathBuf) -> Source {
    let text = fs::read_to_string(&path).expect("a source file is text");
    let code = text
        .lines()
        .take_while(|line| !line.starts_with("#[cfg(test)]"))
        .map(str::to_owned)
        .collect();
    let below_src = path.strip_prefix("src").expect("sources lie below src");
    let first = below_src.components().next().expect("a file has a name");
    let room = first.as_os_str().to_string_lossy().trim_end_matches(".rs").to_owned();
    Source { path, room, code }
}

fn rank(room: &str) -> Option<usize> {
    RANKS.iter().position(|rooms| rooms.contains(&room))
}

/// Every room named behind `crate::` on a line that is not a comment.
fn rooms_used(source: &Source) -> BTreeSet<String> {
    let code = source.code.iter().filter(|line| !line.trim_start().starts_with("//"));
    code.flat_map(|line| line.split("crate::").skip(1).map(str::to_owned).collect::<Vec<_>>())
        .flat_map(|rest| names_at_start(&rest))
        .filter(|name| rank(name).is_some())
        .collect()
}

/// `event::Events` gives `event`; `{event::Events, time}` gives both.
fn names_at_start(path: &str) -> Vec<String> {
    let word = |text: &str| -> String {
        text.trim_start().chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect()
    };
    match path.strip_prefix('{') {
        Some(group) => group.split(',').map(word).collect(),
        None => vec![word(path)],
    }
}

#[test]
fn every_room_has_its_place_in_the_order() {
    for source in sources() {
        let is_entrance = ["lib", "main"].contains(&source.room.as_str());
        assert!(
            is_entrance || rank(&source.room).is_some(),
            "{}: room `{}` is not in the order of tests/architecture.rs",
            source.path.display(),
            source.room
        );
    }
}

#[test]
fn a_room_uses_only_rooms_below_it() {
    for source in sources() {
        let Some(own) = rank(&source.room) else { continue };
        for used in rooms_used(&source) {
            assert!(
                rank(&used) <= Some(own),
                "{}: `{}` uses `{used}`, which lies above it",
                source.path.display(),
                source.room
            );
        }
    }
}

#[test]
fn acquisition_and_analysis_meet_only_in_a_session() {
    for source in sources() {
        let used = rooms_used(&source);
        let both = |side: &[&str], other: &[&str]| {
            side.contains(&source.room.as_str()) && other.iter().any(|room| used.contains(*room))
        };
        assert!(
            !both(ACQUISITION, ANALYSIS) && !both(ANALYSIS, ACQUISITION),
            "{}: acquisition and analysis touch: {used:?}",
            source.path.display()
        );
    }
}

#[test]
fn the_simulated_world_and_the_models_do_not_know_each_other() {
    for source in sources() {
        let text = source.code.join("\n");
        let is_world = source.path.starts_with("src/device/sim")
            || source.path == Path::new("src/device/sim.rs");
        if is_world {
            for room in ["crate::generate", "crate::diagnose", "crate::predict"] {
                assert!(!text.contains(room), "{}: uses {room}", source.path.display());
            }
        }
        if ["generate", "diagnose", "predict"].contains(&source.room.as_str()) {
            assert!(!text.contains("device::sim"), "{}: uses the world", source.path.display());
        }
    }
}

#[test]
fn printing_clap_and_anyhow_stay_in_the_commands() {
    for source in sources() {
        let room = source.room.as_str();
        let bans: &[&str] = match room {
            "commands" => &[],
            "cli" | "main" => &["anyhow::", "println!", "eprintln!"],
            _ => &["anyhow::", "clap::", "println!", "eprintln!", "print!(", "dbg!("],
        };
        for (number, line) in source.code.iter().enumerate() {
            if line.trim_start().starts_with("//") {
                continue;
            }
            for ban in bans {
                assert!(
                    !line.contains(ban),
                    "{}:{}: `{ban}` belongs to the commands",
                    source.path.display(),
                    number + 1
                );
            }
        }
    }
}

#[test]
fn files_are_small_and_well_named() {
    const VAGUE: &[&str] = &["utils", "util", "helpers", "common", "manager", "misc", "mod"];
    for source in sources() {
        let n_lines = source.code.len();
        assert!(
            n_lines <= MAX_LINES,
            "{}: {n_lines} lines before its tests; the limit is {MAX_LINES}: split the idea",
            source.path.display()
        );
        let stem = source.path.file_stem().expect("a file has a stem").to_string_lossy();
        assert!(!VAGUE.contains(&&*stem), "{}: say what it is", source.path.display());
    }
}

#[test]
fn the_map_in_the_library_names_every_room() {
    let map = fs::read_to_string("src/lib.rs").expect("lib.rs is text");
    for source in sources().iter().filter(|source| rank(&source.room).is_some()) {
        let entry = format!("[`{}`]", source.room);
        assert!(map.contains(&entry), "src/lib.rs does not map {}", source.path.display());
    }
}
