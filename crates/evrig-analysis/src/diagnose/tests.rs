//! Recovery of effects simulated with the model's own sampler.

mod clock_delay;
mod dead_pixels;
#[cfg(feature = "long-tests")]
mod effects_recovered;
mod fitted_camera;
mod laplace;
mod leak_near_prior_bound;
mod pixel_strata;
mod random_loss;
mod refractory_peaks;
#[cfg(feature = "long-tests")]
mod smooth_likelihood;
mod strengths_by_stratum;
mod unchanged_light;

use super::checks::acceptance;
use super::checks::accepted_effect;
use super::checks::effect_review;
use super::checks::null_distribution;
use super::checks::split_half;
use super::checks::strength_constancy;
use super::checks::two_sample_test;
use super::fit::bound_escape;
use super::fit::effect_scan;
use super::fit::fitted;
use super::fit::gauss_newton;
use super::fit::multistart;
use super::fit::spatial_region;
use super::fit::standard_errors;
use super::model::library;
use super::*;
use crate::predict::EventsByPixel;
use evrig_core::drive::{Drive, TimeGrid};
use evrig_core::effect_id::EffectId;
use evrig_core::event::Events;
use evrig_core::geometry::{Rectangle, Size};
use evrig_core::stats::SplitMix;

const END_US: i64 = 3_000_000;

/// A texture of plane waves on a circular path.
struct Texture;

impl Texture {
    fn value(u: f64, v: f64) -> f64 {
        let mut sum = 0.0;
        for i in 0..7 {
            let k = 0.22 + 0.13 * f64::from(i);
            let (s, c) = (f64::from(i) * 1.9).sin_cos();
            sum += (k * (u * c + v * s) + 1.7 * f64::from(i)).sin() * 0.55;
        }
        (sum - 1.2).min(0.0)
    }

    fn path(t_us: f64) -> [f64; 2] {
        let turn = t_us * 1e-6 * std::f64::consts::TAU / 2.0;
        [18.0 * turn.cos(), 18.0 * turn.sin()]
    }
}

impl Drive for Texture {
    fn size(&self) -> Size {
        Size::new(60, 60)
    }
    fn span_us(&self) -> [i64; 2] {
        [0, END_US]
    }
    fn white_dn(&self) -> f64 {
        200.0
    }
    fn sample(&self, [u, v]: [f64; 2], grid: TimeGrid, out: &mut [f32]) -> bool {
        for (i, out) in out.iter_mut().enumerate() {
            let [dx, dy] = Self::path(grid.at(i) as f64);
            *out = Self::value(u - dx, v - dy) as f32;
        }
        true
    }
    fn error(&self, _place: [f64; 2]) -> f32 {
        f32::NAN
    }
}

fn facts() -> SessionFacts {
    SessionFacts {
        from_scene: true,
        is_motion_compensated: false,
        aps_us: Vec::new(),
        frame_us: 25_000.0,
        white_dn: 200.0,
        light_per_pedestal: 1.0,
        offset_bound_us: 1_000.0,
        clock_tie: None,
        pixel_mm: None,
        testable_from_frames: Vec::new(),
        stamp_step_us: None,
    }
}

fn options() -> DiagnosisOptions {
    DiagnosisOptions {
        n_pixels: 60,
        few_events: 750,
        step_us: 2_000,
        n_null: 0,
        max_effects: 1,
        ..DiagnosisOptions::default()
    }
}

/// The same signal, changed.
struct Changed(fn(&mut [f32]));

impl Drive for Changed {
    fn size(&self) -> Size {
        Texture.size()
    }
    fn span_us(&self) -> [i64; 2] {
        Texture.span_us()
    }
    fn white_dn(&self) -> f64 {
        Texture.white_dn()
    }
    fn sample(&self, place: [f64; 2], grid: TimeGrid, out: &mut [f32]) -> bool {
        let is_known = Texture.sample(place, grid, out);
        (self.0)(out);
        is_known
    }
    fn error(&self, place: [f64; 2]) -> f32 {
        Texture.error(place)
    }
}

/// Six events in every pixel, all at the beginning.
fn filled() -> EventsByPixel {
    let filler: Events = (0..60_u16)
        .flat_map(|y| (0..60_u16).map(move |x| evrig_core::event::Event { t: 1, x, y, on: true }))
        .flat_map(|e| (0..6).map(move |i| evrig_core::event::Event { t: i, ..e }))
        .collect();
    EventsByPixel::new(filler.as_slice(), Size::new(60, 60), [0, END_US])
}

fn empty() -> Evidence {
    // Pixels are selected by their signal, so that events can be simulated in them afterwards.
    Evidence::new(&filled(), &Texture, facts(), &options()).unwrap()
}

fn library(id: EffectId) -> &'static library::CandidateEffect {
    LIBRARY.iter().find(|c| c.id == id).unwrap()
}

/// A review without other information.
fn judging<'a>(
    evidence: &'a Evidence,
    baseline: &'a fitted::FittedModel,
) -> effect_review::EffectReview<'a> {
    effect_review::EffectReview {
        evidence,
        baseline,
        before: None,
        null: &[],
        has_suggestive_effect: false,
        misses_isolated_events: false,
        seed: 3,
    }
}

/// An accepted effect with a significant gain.
fn one_taken() -> Vec<accepted_effect::AcceptedEffect> {
    vec![accepted_effect::AcceptedEffect {
        gain: 0.5,
        error: 0.05,
        competing_hypotheses: Vec::new(),
        indistinguishable: Vec::new(),
    }]
}

fn plant(id: Option<EffectId>, start: &[f64]) -> Evidence {
    plant_in(None, id, start)
}

fn plant_in(region: Option<Rectangle>, id: Option<EffectId>, start: &[f64]) -> Evidence {
    let evidence = empty();
    let mut hypothesis = Hypothesis::baseline(&evidence);
    if let Some(id) = id {
        let candidate = library(id);
        hypothesis = hypothesis.with_effect_in(candidate, start, region);
    }
    null_distribution::draw_recording(&evidence, &hypothesis, 17)
}

fn found(id: EffectId, start: &[f64]) -> Diagnosis {
    let diagnosis = diagnose(&plant(Some(id), start), &[], &options(), &mut |_| {}).diagnosis;
    let ids: Vec<EffectId> = diagnosis.effects.iter().map(|e| e.id).collect();
    assert_eq!(ids.first(), Some(&id), "{ids:?} {:?}", diagnosis.fit);
    diagnosis
}

fn value(diagnosis: &Diagnosis, key: &str) -> f64 {
    diagnosis.effects[0].parameters[key].value
}

#[test]
fn a_parameter_at_a_bound_is_reported_unless_it_is_hidden() {
    let evidence = empty();
    let parameter_at_bound = |id: EffectId, start: &[f64]| {
        let candidate = library(id);
        let hypothesis = Hypothesis::baseline(&evidence).with(candidate, start);
        acceptance::parameter_at_bound(&hypothesis, 0).map(|parameter| parameter.key)
    };
    assert_eq!(
        parameter_at_bound(EffectId::Adaptation, &[0.05_f64.ln(), 0.3]),
        Some("time_constant_s")
    );
    assert_eq!(parameter_at_bound(EffectId::Adaptation, &[0.5_f64.ln(), 0.98]), Some("fraction"));
    assert_eq!(parameter_at_bound(EffectId::Adaptation, &[0.5_f64.ln(), 0.3]), None);
    // An equal correlation is no bound of the law.
    assert_eq!(parameter_at_bound(EffectId::ThresholdMismatch, &[0.1_f64.ln(), 0.9]), None);
}

#[test]
fn a_nuisance_near_its_bound_is_moved_back() {
    let evidence = empty();
    let candidate = library(EffectId::PhotocurrentLeak);
    let ordinary = Hypothesis::baseline(&evidence).with(candidate, &[0.6]);
    let led_back = |hz| -> Vec<f64> {
        let elsewhere =
            bound_escape::moved_off_bounds(&ordinary.with_nuisance(Nuisance::LeakHz, hz));
        elsewhere.iter().map(|h| (h.nuisance(Nuisance::LeakHz) * 1e4).round() * 1e-4).collect()
    };
    assert!(led_back(0.15).is_empty() && led_back(0.0).is_empty());
    assert_eq!(led_back(0.3), [0.0375, 0.1125, 0.1875, 0.2625]);
    assert_eq!(led_back(0.293), led_back(0.3));
}

#[test]
fn no_effect_is_named_without_one() {
    let diagnosis = diagnose(&plant(None, &[]), &[], &options(), &mut |_| {}).diagnosis;
    assert_eq!(diagnosis.verdict, DiagnosisVerdict::NoMismatch, "{diagnosis:#?}");
    assert!(diagnosis.effects.is_empty());
    assert_eq!(diagnosis.share_removed(), None, "nothing is named that could remove any");
    assert!((diagnosis.nuisances["theta"].value / 0.25 - 1.0).abs() < 0.01);
    let json = serde_json::to_value(&diagnosis).unwrap();
    assert_eq!(json["schema"], "evrig.diagnosis/2");
    assert_eq!(json["verdict"], "no_mismatch");
    let scores = &json["fit"]["heldout_nats_per_event"];
    assert!(["baseline", "final", "upper_bound"].iter().all(|key| scores[key].is_number()));
    for key in
        ["mismatch", "effects", "nuisances", "residual_mismatch", "proposed_term", "cannot_judge"]
    {
        assert!(json.get(key).is_some(), "{key} is missing");
    }
}

#[test]
fn a_refractory_period_is_recovered() {
    let diagnosis = found(EffectId::RefractoryPeriod, &[4_000.0_f64.ln(), 0.0]);
    let us = value(&diagnosis, "refractory_us");
    assert!((us / 4_000.0 - 1.0).abs() < 0.05, "{us}");
    assert_eq!(diagnosis.verdict, DiagnosisVerdict::Explained);
    assert_eq!(value(&diagnosis, "compares_on"), 0.0);
    assert!(diagnosis.share_removed().is_some_and(|share| share > 0.8));
}

#[test]
fn an_effect_in_a_region_is_fitted_in_that_region() {
    let region = Rectangle { x_px: [0, 60], y_px: [0, 40] };
    // A freed nuisance keeps its prior elsewhere.
    let cases: [(EffectId, &[f64], &[f64], f64); 2] = [
        (EffectId::RefractoryPeriod, &[9.1, 0.0], &[9.09, 0.0], 9.1_f64.exp()),
        (EffectId::ThresholdAsymmetry, &[0.3], &[0.2], 0.3_f64.exp()),
    ];
    for (id, hidden, begun, expected) in cases {
        let planted = plant_in(Some(region), Some(id), hidden);
        let without = gauss_newton::fit(&planted, Hypothesis::baseline(&planted), 12, 1e-5);
        let candidate = library(id);
        let start = gauss_newton::score_model(&planted, without.hypothesis.with(candidate, begun));
        let start = spatial_region::start_in_region(&planted, &without, &start).unwrap_or(start);
        let fitted = spatial_region::choose_region(
            &planted,
            &without,
            gauss_newton::fit(&planted, start.hypothesis, 10, 1e-5),
        );
        assert_eq!(fitted.hypothesis.regions, [Some(region)], "{id}");
        let found = fitted.hypothesis.parameters_of(0)[0];
        assert!((found / expected - 1.0).abs() < 0.05, "{id}: {found}");
    }
}

#[test]
fn too_few_events_and_disjoint_times_are_refused_with_advice() {
    let events: Events =
        (0..50).map(|i| evrig_core::event::Event { t: i * 1_000, x: 3, y: 4, on: true }).collect();
    let size = Size::new(60, 60);
    let recording = EventsByPixel::new(events.as_slice(), size, [0, END_US]);
    let error = Evidence::new(&recording, &Texture, facts(), &options()).unwrap_err();
    assert!(error.to_string().contains("record for longer"), "{error}");
    let later = EventsByPixel::new(events.as_slice(), size, [10 * END_US, 11 * END_US]);
    let error = Evidence::new(&later, &Texture, facts(), &options()).unwrap_err();
    assert!(error.to_string().contains("check the clocks"), "{error}");
    // Enough events, but all before the signal is known.
    assert!(empty().n_events() > 300);
    let later = Changed(|light| light[..10].fill(f32::NAN));
    let error = Evidence::new(&filled(), &later, facts(), &options()).unwrap_err();
    assert!(error.to_string().starts_with("0 events have a known light"), "{error}");
}

#[test]
fn every_effect_is_testable_or_listed_as_untestable() {
    let evidence = empty();
    let cannot = effect_scan::cannot_judge(&evidence, false);
    for &id in EffectId::ALL {
        let is_judged = LIBRARY.iter().any(|c| c.id == id || c.inseparable.contains(&id))
            || sensor_wide::testable(&evidence, id).is_ok();
        assert!(is_judged || cannot.iter().any(|c| c.id == id), "{id}");
    }
    // A saturated readout shows only effects of the readout.
    let cannot = effect_scan::cannot_judge(&evidence, true);
    let is_listed = |id: EffectId| cannot.iter().any(|c| c.id == id);
    assert!(LIBRARY.iter().all(|candidate| is_listed(candidate.id)));
    assert!(!is_listed(EffectId::RowReadout) && !is_listed(EffectId::ReadoutSaturation));
    for candidate in LIBRARY {
        assert!(!candidate.equation.is_empty() && !candidate.source.is_empty(), "{}", candidate.id);
        assert!(
            !candidate.competing.is_empty() && !candidate.separating_recording.is_empty(),
            "{}",
            candidate.id
        );
        for parameter in candidate.parameters.iter().filter(|p| !p.is_hidden) {
            assert!(candidate.id.parameters().contains(&parameter.key), "{}", parameter.key);
        }
    }
}

#[test]
fn a_long_recording_is_subsampled_within_blocks() {
    let event = |i: i64| evrig_core::event::Event {
        t: 20 * (i % 3_600) + 75_000 * (i / 3_600),
        x: (i % 60) as u16,
        y: (i / 60 % 60) as u16,
        on: true,
    };
    let events: Events = (0..40 * 3_600).map(event).collect();
    let recording = EventsByPixel::new(events.as_slice(), Size::new(60, 60), [0, END_US]);
    let options = DiagnosisOptions { n_events: 400, ..options() };
    let evidence = Evidence::new(&recording, &Texture, facts(), &options).unwrap();
    assert_eq!(evidence.pixels.len(), 60);
    assert!((700..900).contains(&evidence.n_events()), "{} of 2400", evidence.n_events());
    for pixel in &evidence.pixels {
        let mut n_in_block = vec![0; evidence.blocks.n()];
        for spike in &pixel.spikes {
            n_in_block[evidence.blocks.of(spike.t_us as f64)] += 1;
            let instant = (spike.t_us as f64 - evidence.start_us) / evidence.step_us;
            assert!(pixel.light[instant as usize].is_finite());
        }
        assert!(n_in_block.iter().all(|n| (1..=2).contains(n)), "{n_in_block:?}");
        let n_known = pixel.light.iter().filter(|level| level.is_finite()).count();
        assert!((490..510).contains(&n_known), "{n_known} of {}", pixel.light.len());
    }
}

#[test]
fn a_strength_is_fixed_aside_within_its_range() {
    let drop = |fraction: f64| {
        Hypothesis::baseline(&empty()).with(library(EffectId::EventDrop), &[fraction])
    };
    let hypothesis = drop(0.2);
    let at = hypothesis.offset_of(0);
    let aside = acceptance::with_strength_fixed_aside(&hypothesis, 0).unwrap();
    let held = aside.each_ref().map(|aside| (aside.values[at], aside.ranges[at]));
    assert!((held[0].0 - 0.2 / 3.0).abs() < 1e-12 && (held[1].0 - 0.6).abs() < 1e-12);
    assert!(held.iter().all(|(value, range)| *range == [*value; 2]));
    // At a bound there is no value beyond.
    assert!(acceptance::with_strength_fixed_aside(&drop(0.9), 0).is_none());
}
