//! A pose of the event camera that differs from the stated one.

use super::{LibraryEffect, PLAIN, needs_surroundings};
use evrig_core::effect_id::EffectId;

pub(super) static EFFECT: LibraryEffect = LibraryEffect {
    id: EffectId::Misregistration,
    equation: "u_real = s R(a) u + (dx, dy)",
    source: "Hartley and Zisserman, Multiple View Geometry, 2004, section 2.4",
    competing: &[EffectId::ClockOffset, EffectId::RollingShutter],
    separating_recording: "the circle in the opposite direction: a shift keeps its sign, a delay \
         changes it",
    requires: needs_surroundings,
    describe: |values| {
        format!(
            "the event camera's image is shifted by ({:.2}, {:.2}) px against the map",
            values[0], values[1]
        )
    },
    ..PLAIN
};
