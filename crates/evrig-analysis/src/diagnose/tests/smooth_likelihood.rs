//! The engine with the smooth likelihood on recordings drawn from the other engine's law.

use super::*;
use crate::inference::diagnose_smooth;

/// Names and parameters that the smooth engine finds.
fn diagnosed(id: Option<EffectId>, start: &[f64]) -> Diagnosis {
    let options = DiagnosisOptions { max_effects: 2, ..options() };
    diagnose_smooth(&plant(id, start), &[], &options, &mut |_| {}).diagnosis
}

fn names(diagnosis: &Diagnosis) -> Vec<EffectId> {
    diagnosis.effects.iter().map(|effect| effect.id).collect()
}

#[test]
fn smooth_names_nothing_without_an_effect() {
    let diagnosis = diagnosed(None, &[]);
    assert!(diagnosis.effects.is_empty(), "{:?}", names(&diagnosis));
    assert_ne!(diagnosis.verdict, DiagnosisVerdict::Unexplained, "{:#?}", diagnosis.structure);
    let theta = diagnosis.nuisances["theta"].value;
    assert!((theta / 0.25 - 1.0).abs() < 0.02, "{theta}");
}

#[test]
fn smooth_recovers_strengths() {
    let planted = [
        (EffectId::RefractoryPeriod, vec![20_000.0_f64.ln(), 0.0], "refractory_us", 20_000.0, 0.05),
        (EffectId::FixedPole, vec![12.0_f64.ln()], "cutoff_hz", 12.0, 0.05),
        (
            EffectId::PhotoreceptorBandwidth,
            vec![20.0_f64.ln(), 1.0, 0.02_f64.ln()],
            "cutoff_hz_at_white",
            20.0,
            0.15,
        ),
        (EffectId::ThresholdAsymmetry, vec![0.3], "on_off_ratio", 0.3_f64.exp(), 0.03),
        (EffectId::JunctionLeak, vec![3.0], "rate_hz", 3.0, 0.1),
        (EffectId::EventDrop, vec![0.25], "fraction", 0.25, 0.2),
    ];
    for (id, start, key, truth, tolerance) in planted {
        let diagnosis = diagnosed(Some(id), &start);
        assert_eq!(names(&diagnosis), [id], "{:#?}", diagnosis.fit);
        let value = diagnosis.effects[0].parameters[key].value;
        assert!((value / truth - 1.0).abs() < tolerance, "{key}: {value}, not {truth}");
    }
}
