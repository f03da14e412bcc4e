//! The event camera looks elsewhere than stated.

use super::{Candidate, EffectId, PLAIN, Parameter, Stage, needs_surroundings};
use crate::diagnose::model::image_pose::Placing;

pub(super) const CANDIDATE: Candidate = Candidate {
    id: EffectId::Misregistration,
    equation: "u_real = s R(a) u + (dx, dy)",
    source: "Hartley and Zisserman, Multiple View Geometry, 2004, section 2.4",
    stage: Stage::Light,
    parameters: &[
        Parameter::linear("shift_x_px", [-3.0, 3.0], 0.01),
        Parameter::linear("shift_y_px", [-3.0, 3.0], 0.01),
        Parameter::linear("rotation_deg", [-3.0, 3.0], 0.01),
        Parameter::linear("scale", [0.95, 1.05], 1e-4),
    ],
    starts: |_| {
        let shifts = [[0.3, 0.3], [-0.3, 0.3], [0.3, -0.3], [-0.3, -0.3]];
        shifts.iter().map(|s| vec![s[0], s[1], 0.0, 1.0]).collect()
    },
    act: |values, _, view| {
        view.displace(Placing {
            shift_px: [values[0], values[1]],
            rotation_deg: values[2],
            growth: values[3] - 1.0,
        });
    },
    rivals: &[EffectId::ClockOffset, EffectId::RollingShutter],
    splitter: "the circle run the other way round: a shift keeps its side, a delay changes it",
    needs: needs_surroundings,
    says: |values| {
        format!(
            "the event camera looks ({:.2}, {:.2}) px beside where the map has it",
            values[0], values[1]
        )
    },
    ..PLAIN
};
