//! Whole diagnoses that take minutes each.

use super::*;

#[test]
fn a_filter_behind_the_pixel_is_distinguished_from_a_refractory_period() {
    let diagnosis = found(EffectId::RefractoryPeriod, &[20_000.0_f64.ln(), 1.0]);
    let us = value(&diagnosis, "refractory_us");
    assert!((us / 20_000.0 - 1.0).abs() < 0.05, "{us}");
    assert_eq!(value(&diagnosis, "compares_on"), 1.0);
}

#[test]
fn a_bandwidth_is_recovered() {
    let start = [20.0_f64.ln(), 1.0, 0.02_f64.ln()];
    let diagnosis = found(EffectId::PhotoreceptorBandwidth, &start);
    let hz = value(&diagnosis, "cutoff_hz_at_white");
    // The fitted floor is correlated with the cutoff at white.
    assert!((hz / 20.0 - 1.0).abs() < 0.15, "{hz}");
}

#[test]
fn a_clock_offset_is_distinguished_from_a_pole() {
    let diagnosis = found(EffectId::ClockOffset, &[6_000.0]);
    let us = value(&diagnosis, "offset_us");
    assert!((us - 6_000.0).abs() < 300.0, "{us}");
    assert_eq!(diagnosis.effects[0].indistinguishable, [EffectId::PixelLatency]);
    let pole = found(EffectId::FixedPole, &[12.0_f64.ln()]);
    let hz = value(&pole, "cutoff_hz");
    assert!((hz / 12.0 - 1.0).abs() < 0.1, "{hz}");
}

#[test]
fn threshold_asymmetry_and_leak_are_distinguished() {
    let ratio = value(&found(EffectId::ThresholdAsymmetry, &[0.3]), "on_off_ratio");
    assert!((ratio / 0.3_f64.exp() - 1.0).abs() < 0.03, "{ratio}");
    let leak = value(&found(EffectId::JunctionLeak, &[3.0]), "rate_hz");
    assert!((leak - 3.0).abs() < 0.3, "{leak}");
}
