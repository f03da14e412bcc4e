//! A light that nothing changes is scored as it is, without a copy.

use super::*;

/// The same texture with half of its contrast.
struct Pale;

impl Drive for Pale {
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
        out.iter_mut().for_each(|level| *level *= 0.5);
        is_known
    }
    fn error(&self, place: [f64; 2]) -> f32 {
        Texture.error(place)
    }
}

#[test]
fn a_light_that_nothing_changes_scores_as_its_copy_does() {
    let real = plant(None, &[]);
    let plain = Hypothesis::baseline(&real);
    // A leak of nothing adds nothing, to a copy.
    let copied = plain.with(library(EffectId::PhotocurrentLeak), &[0.0]);
    let is_plain = |hypothesis: &Hypothesis| hypothesis.leaves_light(&real.pixels[0]);
    assert!(is_plain(&plain) && !is_plain(&copied));
    assert!(!is_plain(&plain.with_nuisance(Nuisance::ShiftX, 0.1)));
    let scores = |evidence: &Evidence| {
        [&plain, &copied].map(|h| fit::as_it_is(evidence, h.clone()).cells.log_likelihood)
    };
    let [own, of_copy] = scores(&real);
    assert_eq!(own, of_copy);
    // Where the light bends was asked by now: another one bends elsewhere.
    let [pale, of_copy] = scores(&real.in_light_of(&Pale));
    assert_eq!(pale, of_copy);
    assert_ne!(own, pale);
}
