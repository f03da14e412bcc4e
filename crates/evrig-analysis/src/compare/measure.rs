//! One measure of a comparison, with its definition.

use evrig_core::stats::Estimate;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;

/// The measures, in the order in which they are reported.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[allow(missing_docs)] // Each is defined in the file of its name.
pub enum MeasureId {
    CountRatio,
    PolarityDelta,
    ActivePixelRatio,
    SpatialEntropyRatio,
    SpatialEmd,
    IntervalTv,
    IntervalEmd,
    IntervalKs,
    TemporalEmd,
    EventImageSsim,
    EventImagePsnr,
}

/// The value of a measure for equal streams.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum IdealValue {
    /// A ratio: one.
    One,
    /// A difference or a distance: zero.
    Zero,
    /// A likeness: the largest.
    Largest,
}

impl MeasureId {
    /// All, in their order.
    pub const ALL: [Self; 11] = [
        Self::CountRatio,
        Self::PolarityDelta,
        Self::ActivePixelRatio,
        Self::SpatialEntropyRatio,
        Self::SpatialEmd,
        Self::IntervalTv,
        Self::IntervalEmd,
        Self::IntervalKs,
        Self::TemporalEmd,
        Self::EventImageSsim,
        Self::EventImagePsnr,
    ];

    /// The value for equal streams.
    #[must_use]
    pub const fn ideal(self) -> IdealValue {
        match self {
            Self::CountRatio | Self::ActivePixelRatio | Self::SpatialEntropyRatio => {
                IdealValue::One
            }
            Self::PolarityDelta
            | Self::SpatialEmd
            | Self::IntervalTv
            | Self::IntervalEmd
            | Self::IntervalKs
            | Self::TemporalEmd => IdealValue::Zero,
            Self::EventImageSsim | Self::EventImagePsnr => IdealValue::Largest,
        }
    }
}

impl IdealValue {
    /// How far a value is from the ideal one, for the order of values only; a ratio and its inverse
    /// are equally far.
    #[must_use]
    pub fn shortfall(self, value: f64) -> f64 {
        match self {
            Self::One => value.ln().abs(),
            Self::Zero => value.abs(),
            Self::Largest => -value,
        }
    }
}

/// What a measure's error was resampled over.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Cluster {
    /// Equal parts of the window, all pixels of each.
    TimeBlock,
    /// Squares of pixels, the whole window of each.
    Tile,
}

/// A measure with its value, its error and its definition.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Measure {
    /// The measure.
    pub id: MeasureId,
    /// Name for display.
    pub name: Cow<'static, str>,
    /// Its formula.
    pub formula: Cow<'static, str>,
    /// Where the definition comes from.
    pub source: Cow<'static, str>,
    /// Unit of the value; "1" for a pure number.
    pub unit: Cow<'static, str>,
    /// Value and error; `null` where unknown. `n` counts what the value was formed from.
    pub estimate: Estimate,
    /// Why the value is unknown.
    pub unknown_because: Option<Cow<'static, str>>,
    /// What the error was resampled over.
    pub clusters: Cluster,
    /// Bound on the numerical error, in the value's unit; absent where it is 0. Not contained in
    /// the standard error.
    pub numerical_error: Option<f64>,
    /// Mean value for two streams of one distribution with these numbers of events: a distance is
    /// positive by chance alone.
    pub chance_level: Option<f64>,
    /// Range that the authors of the measure call healthy, ends included.
    pub healthy: Option<[f64; 2]>,
    /// The same quantity of the real stream alone, where there is one.
    pub real: Option<f64>,
    /// The same quantity of the simulated stream alone, where there is one.
    pub simulated: Option<f64>,
}

/// The constant part of a measure.
pub(super) struct MeasureDefinition {
    pub(super) id: MeasureId,
    pub(super) name: &'static str,
    pub(super) formula: &'static str,
    pub(super) source: &'static str,
    pub(super) unit: &'static str,
    pub(super) clusters: Cluster,
    pub(super) healthy: Option<[f64; 2]>,
}

/// Source of the five measures with a healthy range.
pub(super) const RAW2EVENT_MEASURES: &str =
    "the measures the authors of Raw2Event (Ning et al.) report";

impl MeasureDefinition {
    /// The measure with a value.
    pub(super) fn with(&self, estimate: Estimate) -> Measure {
        Measure {
            id: self.id,
            name: self.name.into(),
            formula: self.formula.into(),
            source: self.source.into(),
            unit: self.unit.into(),
            estimate,
            unknown_because: None,
            clusters: self.clusters,
            numerical_error: None,
            chance_level: None,
            healthy: self.healthy,
            real: None,
            simulated: None,
        }
    }

    /// The measure without one.
    pub(super) fn unknown(&self, because: &'static str) -> Measure {
        Measure { unknown_because: Some(because.into()), ..self.with(Estimate::unknown()) }
    }
}

/// Mean of the known distances between streams of one distribution, for [`Measure::chance_level`].
pub(super) fn chance_level(distances: impl Iterator<Item = f64>) -> Option<f64> {
    let known: Vec<f64> = distances.filter(|distance| distance.is_finite()).collect();
    (!known.is_empty()).then(|| known.iter().sum::<f64>() / known.len() as f64)
}

impl Measure {
    /// Whether the value lies in the healthy range; none without a range or a value.
    #[must_use]
    pub fn is_healthy(&self) -> Option<bool> {
        let [low, high] = self.healthy?;
        let value = self.estimate.value;
        value.is_finite().then_some(low <= value && value <= high)
    }

    /// Adds the values of the single streams.
    pub(super) fn of_each(self, real: f64, simulated: f64) -> Self {
        let known = |value: f64| value.is_finite().then_some(value);
        Self { real: known(real), simulated: known(simulated), ..self }
    }
}
