//! One calibration from end to end: regressions, passages, search, verdict on held-out tiles.

use super::passage_fit::PassageFit;
use super::regression::Regressions;
use super::search::{NO_VALUE, Objective, search};
use super::{CalibrateError, Light, Part, fit, regress};
use evrig_core::event::EventSlice;
use evrig_generate::input::FramePreparation;
use evrig_generate::voltmeter::Coefficients;
use serde::{Deserialize, Serialize};

/// How to calibrate.
#[derive(Debug, Clone, Copy)]
pub struct Settings {
    /// The published constants to compare with, and to start from where nothing better is known.
    pub published: Coefficients,
    /// Evaluations of the search; with 0 the best of the fits is taken.
    pub n_evaluations: usize,
    /// Seed of all draws.
    pub seed: u64,
}

/// The result: `k.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Calibration {
    /// `evrig.calibration/1`.
    pub schema: String,
    /// The constants to generate with: the best candidate on the training tiles.
    pub k: Coefficients,
    /// Which candidate that is.
    pub from: String,
    /// What candidates were judged by; less is better.
    pub objective: String,
    /// Evaluations of the search.
    pub n_evaluations: usize,
    /// Who was compared, and how each did.
    pub candidates: Vec<Candidate>,
    /// How pixels were split.
    pub split: Split,
    /// The fit over whole passages, with errors.
    pub passages: PassageFit,
    /// The paper's regressions, with errors; `None` where too few bins were filled.
    pub regressions: Option<Regressions>,
    /// Why there are no regressions.
    pub without_regressions: Option<String>,
    /// How frames have to be prepared for the constants to hold.
    #[serde(default)]
    pub preparation: FramePreparation,
}

/// Constants and how they did.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Candidate {
    /// `published`, `regressions`, `passages` or `search`.
    pub name: String,
    /// The constants.
    pub k: Coefficients,
    /// The objective on the training tiles; `None` where it has no value.
    pub train: Option<f64>,
    /// The objective on the held-out tiles.
    pub held_out: Option<f64>,
}

/// How pixels were split.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Split {
    /// In words.
    pub how: String,
    /// Usable pixels that the constants were fitted to.
    pub n_train_pixels: usize,
    /// Usable pixels that they were judged on.
    pub n_held_out_pixels: usize,
    /// Pixels left out as dark or cut off in some frame.
    pub n_unusable_pixels: usize,
}

impl Candidate {
    fn new(name: &str, k: Coefficients, train: f64, held_out: f64) -> Self {
        let known = |value: f64| (value.abs() < NO_VALUE).then_some(value);
        Self { name: name.to_owned(), k, train: known(train), held_out: known(held_out) }
    }
}

/// An objective of the nuisances alone.
struct Fixed<'a> {
    objective: &'a dyn Objective,
    k: [f64; 6],
}

impl Objective for Fixed<'_> {
    fn name(&self) -> &'static str {
        self.objective.name()
    }

    fn sees(&self) -> [bool; 6] {
        [false; 6]
    }

    fn nuisances(&self) -> Vec<f64> {
        self.objective.nuisances()
    }

    fn value(&self, _: [f64; 6], nuisances: &[f64], part: Part) -> f64 {
        self.objective.value(self.k, nuisances, part)
    }
}

impl Calibration {
    /// The schema's name.
    pub const SCHEMA: &'static str = "evrig.calibration/1";
}

/// Calibrates on the training tiles and judges on the held-out ones.
///
/// # Errors
/// When the events do not determine the constants.
pub fn calibrate(
    light: &Light,
    events: EventSlice<'_>,
    objective: &dyn Objective,
    settings: &Settings,
) -> Result<Calibration, CalibrateError> {
    let (regressions, without_regressions) =
        match regress(light, events, Part::Train, settings.seed) {
            Ok(regressions) => (Some(regressions), None),
            Err(error @ CalibrateError::TooFewBins { .. }) => (None, Some(error.to_string())),
            Err(error) => return Err(error),
        };
    let values = |k: &[super::Constant; 6]| k.map(|k| k.estimate.value);
    // Biased regressions can end far off; the published constants are the other place to start.
    let start = regressions.as_ref().map(|r| values(&r.k)).filter(|k| k[0] > 0.0);
    let from_regressions = start.and_then(|k| fit(light, events, Part::Train, k).ok());
    let passages = match from_regressions {
        Some(passages) => passages,
        None => fit(light, events, Part::Train, settings.published.k())?,
    };
    let mut candidates = vec![("published", settings.published)];
    let fitted = [
        ("regressions", regressions.as_ref().map(|r| values(&r.k))),
        ("passages", Some(values(&passages.k))),
    ];
    for (name, k) in fitted {
        candidates.extend(k.and_then(within_ranges).map(|k| (name, k)));
    }
    let mut n_evaluations = 0;
    let judge = |(name, k): (&str, Coefficients)| {
        // Each with the nuisances that suit it best: k is what is judged.
        // A part of the data tells them well enough.
        let n_fit = 25 * objective.nuisances().len();
        let fixed = Fixed { objective: objective.thinned().unwrap_or(objective), k: k.k() };
        let found = search(&fixed, k.k(), n_fit, settings.seed);
        n_evaluations += found.n_evaluations + 2;
        let [train, held_out] =
            [Part::Train, Part::HeldOut].map(|part| objective.value(k.k(), &found.nuisances, part));
        Candidate::new(name, k, train, held_out)
    };
    let mut candidates: Vec<Candidate> = candidates.into_iter().map(judge).collect();
    if settings.n_evaluations > 0 {
        let (found, n) = searched(objective, &candidates, settings);
        n_evaluations += n;
        candidates.extend(found);
    }
    let (k, from) = best(&candidates)
        .map_or((settings.published, "published".to_owned()), |best| (best.k, best.name.clone()));
    Ok(Calibration {
        schema: Calibration::SCHEMA.to_owned(),
        k,
        from,
        objective: objective.name().to_owned(),
        n_evaluations,
        candidates,
        split: split(light),
        passages,
        regressions,
        without_regressions,
        preparation: FramePreparation::default(),
    })
}

/// What a search from the best candidate finds, and the evaluations it took.
fn searched(
    objective: &dyn Objective,
    candidates: &[Candidate],
    settings: &Settings,
) -> (Option<Candidate>, usize) {
    let start = best(candidates).map_or(settings.published, |best| best.k);
    let found = search(objective, start.k(), settings.n_evaluations, settings.seed);
    let candidate = within_ranges(found.k).map(|k| {
        let held_out = objective.value(found.k, &found.nuisances, Part::HeldOut);
        Candidate::new("search", k, found.train, held_out)
    });
    (candidate, found.n_evaluations)
}

/// The candidate that does best on the training tiles; of equals the last, which is the later step.
fn best(candidates: &[Candidate]) -> Option<&Candidate> {
    let judged = candidates.iter().filter_map(|c| c.train.map(|train| (train, c)));
    judged.reduce(|a, b| if b.0 <= a.0 { b } else { a }).map(|(_, candidate)| candidate)
}

/// The rate, sigma squared over a threshold squared, at which the darkest pixel may fire by noise.
const MAX_NOISE_HZ: f64 = 1_000.0;

/// Estimates may lie beyond zero within their error; a generator's constants may not.
fn within_ranges(k: [f64; 6]) -> Option<Coefficients> {
    let [k1, k2, k3, k4, k5, k6] = k;
    let (k2, k3, k6) = (k2.max(1e-9), k3.max(0.0), k6.max(0.0));
    // sqrt(L)/(L + k2) is greatest at L = k2: a pixel as dark as that must not fire by noise alone.
    let noisiest = k3 / (2.0 * k2.sqrt()) + k6;
    let is_usable = noisiest.powi(2) * 1e6 <= MAX_NOISE_HZ;
    Coefficients::new([k1, k2, k3, k4, k5, k6]).ok().filter(|_| is_usable)
}

fn split(light: &Light) -> Split {
    let is_train = |&&pixel: &&u32| light.part(pixel) == Part::Train;
    let n_train_pixels = light.pixels().iter().filter(is_train).count();
    Split {
        how: format!(
            "tiles of {0} x {0} pixels alternate like the fields of a chessboard",
            super::TILE
        ),
        n_train_pixels,
        n_held_out_pixels: light.pixels().len() - n_train_pixels,
        n_unusable_pixels: light.n_unusable(),
    }
}
