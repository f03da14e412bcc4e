//! The event camera looks elsewhere than stated.

use super::{Candidate, EffectId, PLAIN, Parameter, Stage, needs_surroundings};

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
        let pixel = view.pixel;
        let x = f64::from(pixel.x) + 0.5 - view.evidence.middle[0];
        let y = f64::from(pixel.y) + 0.5 - view.evidence.middle[1];
        let (angle, grow) = (values[2].to_radians(), values[3] - 1.0);
        // What a pixel sees lies opposite to where its picture has gone.
        let dx = -(values[0] + grow * x - angle * y) as f32;
        let dy = -(values[1] + grow * y + angle * x) as f32;
        let [gx, gy] = &pixel.gradient;
        for ((signal, gx), gy) in view.signal.iter_mut().zip(gx).zip(gy) {
            *signal += dx * gx + dy * gy;
        }
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
