//! A pose of the event camera that differs from the stated one.

use super::{
    CandidateEffect, CandidateParameter, CandidateStage, EffectId, PLAIN, needs_surroundings,
};
use crate::diagnose::model::image_pose::ImagePose;

pub(super) const CANDIDATE: CandidateEffect = CandidateEffect {
    id: EffectId::Misregistration,
    equation: "u_real = s R(a) u + (dx, dy)",
    source: "Hartley and Zisserman, Multiple View Geometry, 2004, section 2.4",
    stage: CandidateStage::Light,
    parameters: &[
        CandidateParameter::linear("shift_x_px", [-3.0, 3.0], 0.01),
        CandidateParameter::linear("shift_y_px", [-3.0, 3.0], 0.01),
        CandidateParameter::linear("rotation_deg", [-3.0, 3.0], 0.01),
        CandidateParameter::linear("scale", [0.95, 1.05], 1e-4),
    ],
    starting_points: |_| {
        let shifts = [[0.3, 0.3], [-0.3, 0.3], [0.3, -0.3], [-0.3, -0.3]];
        shifts.iter().map(|s| vec![s[0], s[1], 0.0, 1.0]).collect()
    },
    apply: |values, _, view| {
        view.displace(ImagePose {
            shift_px: [values[0], values[1]],
            rotation_deg: values[2],
            scale_change: values[3] - 1.0,
        });
    },
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
