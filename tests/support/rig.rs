//! The description of the simulated rig with its devices at given ports and addresses.

use evrig::rig::Rig;
use std::fmt::Display;
use std::path::Path;

/// The rig with the arm at a port, the event camera and a small frame camera at addresses.
pub fn rig_on(arm: &Path, davis: impl Display, pi: impl Display) -> String {
    let sim = "transport = \"sim\"";
    let changes = [
        ("port = \"sim\"", format!("port = {arm:?}")),
        (sim, format!("transport = \"tcp://{davis}\"")),
        (sim, format!("transport = \"tcp://{pi}\"")),
        ("size_px = [692, 520]", "size_px = [64, 48]".to_owned()),
    ];
    changes.into_iter().fold(Rig::simulated().unwrap().text, |text, (from, to)| {
        assert!(text.contains(from), "{from}");
        text.replacen(from, &to, 1)
    })
}
