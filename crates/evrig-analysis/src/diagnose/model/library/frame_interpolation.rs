//! A signal between frames that is not linear.

use super::{
    CandidateEffect, CandidateParameter, CandidateStage, EffectId, Evidence, PLAIN, PredictedPixel,
};

pub(super) const CANDIDATE: CandidateEffect = CandidateEffect {
    id: EffectId::FrameInterpolation,
    equation: "x = x_linear + s (x_cubic - x_linear) between frames",
    source: "Catmull and Rom, 1974; Hu, Liu and Delbruck, v2e, CVPRW 2021 \
             (why frames are interpolated)",
    stage: CandidateStage::Light,
    parameters: &[CandidateParameter::linear("share", [-0.5, 2.5], 0.02)],
    starting_points: |_| vec![vec![0.5], vec![1.0]],
    apply: |values, _, view| bend(values[0], view),
    competing: &[EffectId::ExposureBlur, EffectId::ShotNoise, EffectId::FrameNoise],
    separating_recording: "frames twice as often, or a pass at half the speed",
    requires: needs_frames,
    describe: |values| {
        format!(
            "between frames the signal is not linear: {:.2} of the difference to a cubic fits \
             better",
            values[0]
        )
    },
    ..PLAIN
};

fn needs_frames(evidence: &Evidence) -> Result<(), String> {
    if evidence.facts.from_scene {
        Err("the signal comes from a map of the target, not from frames".into())
    } else if evidence.facts.is_motion_compensated {
        Err("between frames the signal is interpolated along optical flow".into())
    } else if evidence.facts.frame_us < 3.0 * evidence.step_us {
        Err("the frame rate is as high as the sampling rate of the signal".into())
    } else {
        Ok(())
    }
}

/// Adds a share of the difference between cubic and linear interpolation.
fn bend(share: f64, view: &mut PredictedPixel<'_>) {
    let evidence = view.evidence;
    let at = |t_us: i64| {
        let since = (t_us - evidence.window_us[0]) as f64 - evidence.start_us;
        since / evidence.step_us
    };
    let light = &view.pixel.light;
    let value = |position: f64| {
        let i = position.round();
        let inside = i >= 0.0 && (i as usize) < light.len();
        inside.then(|| f64::from(light[i as usize])).filter(|v| v.is_finite())
    };
    for four in evidence.facts.aps_us.windows(4) {
        let places = [at(four[0]), at(four[1]), at(four[2]), at(four[3])];
        let values = places.map(value);
        let [Some(a), Some(b), Some(c), Some(d)] = values else { continue };
        let [from, to] = [places[1], places[2]];
        let (m0, m1) = ((c - a) / 2.0, (d - b) / 2.0);
        let first = from.ceil().max(0.0) as usize;
        for i in first..((to.ceil().max(0.0) as usize).min(light.len())) {
            let u = (i as f64 - from) / (to - from);
            let over = u * (1.0 - u) * ((1.0 - u) * (m0 - (c - b)) - u * (m1 - (c - b)));
            view.signal[i] += (share * over) as f32;
        }
    }
}
