//! The simulated rig and its paths, with frames that are small and quick to render.

use evrig::pipeline::align;
use evrig::rig::Rig;
use evrig::session::{Manifest, Session};
use evrig::sim::world::WorldDescription;
use evrig::sim::{Simulation, simulate};
use evrig::trajectory::{OptionalSegments, Trajectory};
use std::path::Path;

/// A small target below both cameras, which share one position; the tag keeps its size.
#[allow(dead_code)]
pub(crate) const CORNER: [(&str, &str); 6] = [
    ("[0.0, 18.0, -13.0]", "[0.0, 0.0, -13.0]"),
    ("[0.0, -18.0, -13.0]", "[0.0, 0.0, -13.0]"),
    ("size_px = [346, 260]", "size_px = [112, 80]"),
    ("size_px = [692, 520]", "crop_origin_px = [422, 172]\nsize_px = [372, 240]"),
    ("picture_side_mm = 43.05", "picture_side_mm = 14.35"),
    ("gap_mm = 4.1\n", "gap_mm = 3.0\n"),
];

/// The bundled rig with each first text, which must occur, replaced by the second.
pub(crate) fn small_rig(replaced: &[(&str, &str)]) -> Rig {
    let mut text = include_str!("../../rig/sim.toml").to_owned();
    for (from, to) in replaced {
        assert!(text.contains(from), "{from}");
        text = text.replace(from, to);
    }
    Rig::parse("small.toml", &text).unwrap()
}

/// What all small trajectories begin with.
const PATH_START: &str = r#"
schema = "evrig.trajectory/1"
name = "small"
plane = "image"
[start]
x_mm = 270.0
y_mm = 0.0
z_mm = 100.0
r_deg = 90.0
[rates]
speed_mm_per_s = 20.0
acceleration_mm_per_s2 = 400.0
"#;

/// A trajectory of segments: kind, label, and values in TOML.
pub(crate) fn small_trajectory(segments: &[(&str, &str, &str)]) -> Trajectory {
    let mut text = PATH_START.to_owned();
    for (kind, label, values) in segments {
        text += &format!("[[segment]]\nkind = \"{kind}\"\nlabel = \"{label}\"\n{values}\n");
    }
    Trajectory::parse("small.toml", &text).unwrap()
}

/// A path around a corner, which moves the tag along both axes.
#[allow(dead_code)]
pub(crate) fn corner_path() -> Trajectory {
    small_trajectory(&[
        ("dwell", "before", "duration_s = 0.2"),
        ("line", "there", "by_mm = [3.0, 0.0]"),
        ("line", "down", "by_mm = [0.0, 2.0]"),
        ("line", "back", "by_mm = [-3.0, 0.0]"),
        ("dwell", "after", "duration_s = 0.2"),
    ])
}

/// A recording by both cameras in the simulated world described by `world`.
#[allow(dead_code)]
pub(crate) fn simulated(rig: &Rig, trajectory: &Trajectory, world: &str, out: &Path) -> Manifest {
    let path = trajectory.path(rig, OptionalSegments::Included).unwrap();
    let world = WorldDescription::parse("w.toml", world).unwrap();
    let (path, world) = (&path, &world);
    let simulation = Simulation { rig, trajectory, path, world, seed: 5, out, duration: None };
    simulate(&simulation, &mut |_| {}).unwrap()
}

/// A recording along `corner_path`.
#[allow(dead_code)]
pub(crate) fn corner_session(world: &str, out: &Path) -> Session {
    simulated(&small_rig(&CORNER), &corner_path(), world, out);
    Session::open(out).unwrap()
}

/// The same recording, synchronized and registered.
#[allow(dead_code)]
pub(crate) fn aligned_session(out: &Path) -> Session {
    let session = corner_session("", out);
    let aligned = align(&session, false, &|_| {});
    aligned.scene.unwrap();
    session
}
