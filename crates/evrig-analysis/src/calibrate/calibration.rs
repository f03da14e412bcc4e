//! A complete calibration: regressions, passage fit, search, evaluation on held-out tiles.

use super::passage_fit::PassageFit;
use super::regression::Regressions;
use super::search::{HeldObjective, NO_VALUE, Objective, search};
use super::{BrightnessSeries, CalibrateError, TileSubset, fit, regress};
use evrig_core::event::EventSlice;
use evrig_generate::input::FramePreparation;
use evrig_generate::voltmeter::Coefficients;
use serde::{Deserialize, Serialize};

/// How to calibrate.
#[derive(Debug, Clone, Copy)]
pub struct CalibrationSettings {
    /// Published constants, for comparison and as a fallback start.
    pub published: Coefficients,
    /// Evaluations of the search; 0 for none.
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
    /// The objective; less is better.
    pub objective: String,
    /// Evaluations of the search.
    pub n_evaluations: usize,
    /// All candidates with their objectives.
    pub candidates: Vec<CandidateConstants>,
    /// Training and held-out pixels.
    pub split: PixelSplit,
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

/// Constants with their objective.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CandidateConstants {
    /// `published`, `regressions`, `passages` or `search`.
    pub name: String,
    /// The constants.
    pub k: Coefficients,
    /// The objective on the training tiles; `None` where it has no value.
    pub train: Option<f64>,
    /// The objective on the held-out tiles.
    pub held_out: Option<f64>,
}

/// Training and held-out pixels.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct PixelSplit {
    /// In words.
    pub how: String,
    /// Usable training pixels.
    pub n_train_pixels: usize,
    /// Usable held-out pixels.
    pub n_held_out_pixels: usize,
    /// Pixels that are dark or saturated in some frame.
    pub n_unusable_pixels: usize,
}

impl CandidateConstants {
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

    fn depends_on(&self) -> [bool; 6] {
        [false; 6]
    }

    fn nuisances(&self) -> Vec<f64> {
        self.objective.nuisances()
    }

    fn value(&self, _: [f64; 6], nuisances: &[f64], part: TileSubset) -> f64 {
        self.objective.value(self.k, nuisances, part)
    }

    fn at(&self, _: [f64; 6], part: TileSubset) -> HeldObjective<'_> {
        self.objective.at(self.k, part)
    }
}

impl Calibration {
    /// The schema's name.
    pub const SCHEMA: &'static str = "evrig.calibration/1";
}

/// Calibrates on the training tiles and evaluates on the held-out ones.
///
/// # Errors
/// When the events do not determine the constants.
pub fn calibrate(
    brightness: &BrightnessSeries,
    events: EventSlice<'_>,
    objective: &dyn Objective,
    settings: &CalibrationSettings,
) -> Result<Calibration, CalibrateError> {
    let (regressions, without_regressions) =
        match regress(brightness, events, TileSubset::Train, settings.seed) {
            Ok(regressions) => (Some(regressions), None),
            Err(error @ CalibrateError::TooFewBins { .. }) => (None, Some(error.to_string())),
            Err(error) => return Err(error),
        };
    let values = |k: &[super::Constant; 6]| k.map(|k| k.estimate.value);
    // Biased regressions can be far off; the published constants are the other start.
    let start = regressions.as_ref().map(|r| values(&r.k)).filter(|k| k[0] > 0.0);
    let from_regressions = start.and_then(|k| fit(brightness, events, TileSubset::Train, k).ok());
    let passages = match from_regressions {
        Some(passages) => passages,
        None => fit(brightness, events, TileSubset::Train, settings.published.k())?,
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
        // Each candidate gets its own nuisance parameters, fitted to a part of the data.
        let n_fit = 25 * objective.nuisances().len();
        let fixed = Fixed { objective: objective.thinned().unwrap_or(objective), k: k.k() };
        let found = search(&fixed, k.k(), n_fit, settings.seed);
        n_evaluations += found.n_evaluations + 2;
        let [train, held_out] = [TileSubset::Train, TileSubset::HeldOut]
            .map(|part| objective.value(k.k(), &found.nuisances, part));
        CandidateConstants::new(name, k, train, held_out)
    };
    let mut candidates: Vec<CandidateConstants> = candidates.into_iter().map(judge).collect();
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
        split: split(brightness),
        passages,
        regressions,
        without_regressions,
        preparation: FramePreparation::default(),
    })
}

/// The search from the best candidate, and its number of evaluations.
fn searched(
    objective: &dyn Objective,
    candidates: &[CandidateConstants],
    settings: &CalibrationSettings,
) -> (Option<CandidateConstants>, usize) {
    let start = best(candidates).map_or(settings.published, |best| best.k);
    let found = search(objective, start.k(), settings.n_evaluations, settings.seed);
    let candidate = within_ranges(found.k).map(|k| {
        let held_out = objective.value(found.k, &found.nuisances, TileSubset::HeldOut);
        CandidateConstants::new("search", k, found.train, held_out)
    });
    (candidate, found.n_evaluations)
}

/// The best candidate on the training tiles; the last of equals.
fn best(candidates: &[CandidateConstants]) -> Option<&CandidateConstants> {
    let judged = candidates.iter().filter_map(|c| c.train.map(|train| (train, c)));
    judged.reduce(|a, b| if b.0 <= a.0 { b } else { a }).map(|(_, candidate)| candidate)
}

/// Bound on the noise rate of any pixel, sigma squared over threshold squared, Hz.
const MAX_NOISE_HZ: f64 = 1_000.0;

/// Estimates may be negative within their error; a generator's constants may not.
fn within_ranges(k: [f64; 6]) -> Option<Coefficients> {
    let [k1, k2, k3, k4, k5, k6] = k;
    let (k2, k3, k6) = (k2.max(1e-9), k3.max(0.0), k6.max(0.0));
    // sqrt(L)/(L + k2) has its maximum at L = k2.
    let noisiest = k3 / (2.0 * k2.sqrt()) + k6;
    let is_usable = noisiest.powi(2) * 1e6 <= MAX_NOISE_HZ;
    Coefficients::new([k1, k2, k3, k4, k5, k6]).ok().filter(|_| is_usable)
}

fn split(brightness: &BrightnessSeries) -> PixelSplit {
    let is_train = |&&pixel: &&u32| brightness.part(pixel) == TileSubset::Train;
    let n_train_pixels = brightness.pixels().iter().filter(is_train).count();
    PixelSplit {
        how: format!("tiles of {0} x {0} pixels alternate in a checkerboard", super::TILE),
        n_train_pixels,
        n_held_out_pixels: brightness.pixels().len() - n_train_pixels,
        n_unusable_pixels: brightness.n_unusable(),
    }
}
