//! Effects that are planted by drawing events from the model's own law are found with their size.

use super::fit::candidate::EffectCandidate;
use super::model::camera_model::CameraModel;
use super::*;
use crate::predict::pass::PixelPass;
use crate::predict::{EventsByPixel, HazardTerm, Spike, TermVisitor, visit};
use evrig_core::drive::{Drive, TimeGrid};
use evrig_core::effect_id::EffectId;
use evrig_core::event::{Event, Events};
use evrig_core::geometry::Size;
use evrig_core::stats::SplitMix;

const SIZE: Size = Size::new(60, 60);
const END_US: i64 = 3_000_000;

/// A texture of plane waves on a circular path.
struct Texture;

impl Texture {
    fn value(u: f64, v: f64) -> f64 {
        let wave = |i: i32| {
            let k = 0.22 + 0.13 * f64::from(i);
            let (s, c) = (f64::from(i) * 1.9).sin_cos();
            0.55 * (k * (u * c + v * s) + 1.7 * f64::from(i)).sin()
        };
        ((0..7).map(wave).sum::<f64>() - 1.2).min(0.0)
    }
}

impl Drive for Texture {
    fn size(&self) -> Size {
        SIZE
    }
    fn span_us(&self) -> [i64; 2] {
        [0, END_US]
    }
    fn white_dn(&self) -> f64 {
        200.0
    }
    fn sample(&self, [u, v]: [f64; 2], grid: TimeGrid, out: &mut [f32]) -> bool {
        for (i, out) in out.iter_mut().enumerate() {
            let (s, c) = (grid.at(i) as f64 * 1e-6 * std::f64::consts::PI).sin_cos();
            *out = Self::value(u - 18.0 * c, v - 18.0 * s) as f32;
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

/// Pixels of the texture; they are selected by their signal, each with eight events at the beginning.
fn textured() -> Evidence {
    let options =
        DiagnosisOptions { n_pixels: 40, few_events: 0, step_us: 2_000, ..Default::default() };
    let places = (0..8).flat_map(|t| (0..60).flat_map(move |y| (0..60).map(move |x| (t, x, y))));
    let events: Events = places.map(|(t, x, y)| Event { t, x, y, on: true }).collect();
    let recording = EventsByPixel::new(events.as_slice(), SIZE, [0, END_US]);
    Evidence::new(&recording, &Texture, facts(), &options).unwrap()
}

/// Draws an event after the last one.
struct NextEvent {
    last: usize,
    random: SplitMix,
    drawn: Option<Spike>,
}

impl TermVisitor for NextEvent {
    fn silence(&mut self, _block: usize, _compensator: f64) {}
    fn event(&mut self, _term: &HazardTerm) {}
    fn after(&mut self, pass: &PixelPass<'_>, index: usize) {
        if index == self.last {
            self.drawn = pass.draw_next(END_US as f64, &mut self.random).map(|next| next.spike);
        }
    }
}

/// The evidence with events drawn from a model.
fn drawn_from(evidence: &Evidence, model: &CameraModel) -> Evidence {
    let of_pixel = |number: usize| {
        let view = model.view(evidence, number, None);
        let mut spikes = vec![Spike { t_us: 10_000, on: true }];
        let mut random = SplitMix::new(17, number as u64);
        while spikes.len() < 2_000 {
            let last = spikes.len() - 1;
            let mut next = NextEvent { last, random, drawn: None };
            visit(&view.law, view.sampled(), &spikes, &evidence.blocks, &mut next);
            random = next.random;
            let Some(spike) = next.drawn else { break };
            spikes.push(spike);
        }
        spikes
    };
    evidence.with_events((0..evidence.pixels.len()).map(of_pixel).collect())
}

fn diagnosed(model: impl Fn(&Evidence) -> CameraModel) -> Diagnosis {
    let evidence = textured();
    let recorded = drawn_from(&evidence, &model(&evidence));
    diagnose(&recorded, &[], &DiagnosisOptions::default(), &mut |_| {}).diagnosis
}

fn with_effect(evidence: &Evidence, id: EffectId, values: &[f64]) -> CameraModel {
    let Some(EffectCandidate::Structural(term)) = EffectCandidate::structural(id) else {
        panic!("{id} is no term of the model")
    };
    CameraModel::baseline(evidence).with(term, values)
}

#[test]
fn a_pole_is_named_with_its_cutoff() {
    let found = diagnosed(|evidence| with_effect(evidence, EffectId::FixedPole, &[12.0]));
    let ids: Vec<EffectId> = found.effects.iter().map(|effect| effect.id).collect();
    assert_eq!(ids, [EffectId::FixedPole], "{:?}", found.fit);
    let cutoff = found.effects[0].parameters["cutoff_hz"].value;
    assert!((cutoff / 12.0 - 1.0).abs() < 0.15, "{cutoff} Hz");
    assert_eq!(found.verdict, DiagnosisVerdict::Explained);
}

#[test]
fn an_ordinary_camera_has_no_mismatch() {
    let found = diagnosed(CameraModel::baseline);
    assert!(found.effects.is_empty(), "{:?}", found.effects);
    assert_eq!(found.verdict, DiagnosisVerdict::NoMismatch);
}
