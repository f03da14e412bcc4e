//! Refractory period.

use super::{Candidate, EffectId, PLAIN, Parameter, logs};

pub(super) const CANDIDATE: Candidate = Candidate {
    id: EffectId::RefractoryPeriod,
    equation: "x_mem = x(t_i + t_r), no event in (t_i, t_i + t_r)",
    source: "Lichtsteiner, Posch and Delbruck, IEEE JSSC 43, 2008; Joubert et al., Front. Neurosci. 15, 2021",
    parameters: &[Parameter::log("refractory_us", [20.0, 200_000.0])],
    starts: |_| logs(&[300.0, 1_000.0, 3_000.0, 8_000.0, 25_000.0]),
    act: |values, _, view| view.law.blind_s = values[0] * 1e-6,
    rivals: &[EffectId::PhotoreceptorBandwidth, EffectId::EventDrop, EffectId::ReadoutSaturation],
    splitter: "a second, faster pass: a dead time takes a fixed time, a filter a fixed share of the contrast",
    agrees: |evidence, values| {
        // Intervals within the dead time are the few that noise and background make.
        let intervals = || {
            let pairs = evidence.pixels.iter().flat_map(|pixel| pixel.spikes.windows(2));
            pairs.map(|pair| (pair[1].t_us - pair[0].t_us) as f64)
        };
        let within = intervals().filter(|us| *us < 0.9 * values[0]).count();
        within * 25 < intervals().count()
    },
    says: |values| {
        format!(
            "after an event the pixel sees nothing for {:.0} us and then takes the light anew",
            values[0]
        )
    },
    ..PLAIN
};
