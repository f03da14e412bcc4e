//! One number of a comparison, with all that is needed to read it.

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
    /// Its name for people.
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
    /// Largest error of the arithmetic itself (a bound, not a spread), in the value's unit;
    /// absent where it is nil. The standard error does not contain it.
    pub numerical_error: Option<f64>,
    /// What two streams of one law, with these numbers of events, show on average: distances
    /// cannot be negative, so chance alone puts them above zero.
    pub chance_level: Option<f64>,
    /// Range that the authors of the measure call healthy, ends included.
    pub healthy: Option<[f64; 2]>,
    /// The same quantity of the real stream alone, where there is one.
    pub real: Option<f64>,
    /// The same quantity of the simulated stream alone, where there is one.
    pub simulated: Option<f64>,
}

/// What is fixed about a measure.
pub(super) struct Definition {
    pub(super) id: MeasureId,
    pub(super) name: &'static str,
    pub(super) formula: &'static str,
    pub(super) source: &'static str,
    pub(super) unit: &'static str,
    pub(super) clusters: Cluster,
    pub(super) healthy: Option<[f64; 2]>,
}

/// Source of the five measures with a healthy range.
pub(super) const AUTHORS: &str = "the measures the authors of Raw2Event (Ning et al.) report";

impl Definition {
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

impl Measure {
    /// Whether the value lies in the healthy range; none without a range or a value.
    #[must_use]
    pub fn is_healthy(&self) -> Option<bool> {
        let [low, high] = self.healthy?;
        let value = self.estimate.value;
        value.is_finite().then_some(low <= value && value <= high)
    }

    /// Adds what each stream shows alone.
    pub(super) fn of_each(self, real: f64, simulated: f64) -> Self {
        let known = |value: f64| value.is_finite().then_some(value);
        Self { real: known(real), simulated: known(simulated), ..self }
    }
}
