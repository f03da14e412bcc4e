//! Comparison measures as table rows: value, healthy range, verdict.

use super::figure::FileLink;
use super::number::quantity;
use evrig_core::stats::Estimate;

/// One comparison measure of real and simulated events.
#[derive(Debug, Clone, PartialEq)]
pub struct MeasureRow {
    /// Name in files, such as `count_ratio`.
    pub id: String,
    /// Name for display.
    pub name: String,
    /// Its formula.
    pub formula: String,
    /// Where the definition comes from.
    pub source: String,
    /// Unit of the value; empty for a ratio.
    pub unit: String,
    /// The value with its error.
    pub estimate: Estimate,
    /// Healthy range, ends included.
    pub healthy: Option<[f64; 2]>,
    /// The quantity for the real events alone, where there is one.
    pub real: Option<f64>,
    /// The quantity for the simulated events alone, where there is one.
    pub simulated: Option<f64>,
    /// The file that holds the numbers.
    pub data: Option<FileLink>,
}

/// Position of a value relative to its healthy range.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MeasureVerdict {
    /// The 90 % interval lies in the range.
    Healthy,
    /// The 90 % interval contains an end of the range.
    Borderline,
    /// The 90 % interval lies outside the range.
    Outside,
    /// There is no range to compare with.
    NoRange,
    /// There is no value.
    Unknown,
}

impl MeasureVerdict {
    /// The verdict in a word or two.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::Healthy => "healthy",
            Self::Borderline => "borderline",
            Self::Outside => "outside",
            Self::NoRange => "no range",
            Self::Unknown => "unknown",
        }
    }

    /// A symbol for the verdict.
    #[must_use]
    pub const fn mark(self) -> &'static str {
        match self {
            Self::Healthy => "✓",
            Self::Borderline => "≈",
            Self::Outside => "✗",
            Self::NoRange => "·",
            Self::Unknown => "?",
        }
    }

    /// The class in the style sheet.
    #[must_use]
    pub const fn class(self) -> &'static str {
        match self {
            Self::Healthy => "is-healthy",
            Self::Borderline => "is-borderline",
            Self::Outside => "is-outside",
            Self::NoRange | Self::Unknown => "is-open",
        }
    }
}

impl MeasureRow {
    /// The verdict on the value; without an interval the value alone decides.
    #[must_use]
    pub fn verdict(&self) -> MeasureVerdict {
        if !self.estimate.value.is_finite() {
            return MeasureVerdict::Unknown;
        }
        let Some([low, high]) = self.healthy else { return MeasureVerdict::NoRange };
        let [from, to] = self.interval();
        if from >= low && to <= high {
            MeasureVerdict::Healthy
        } else if to < low || from > high {
            MeasureVerdict::Outside
        } else {
            MeasureVerdict::Borderline
        }
    }

    /// The 90 % interval, or the bare value where no interval is known.
    #[must_use]
    pub fn interval(&self) -> [f64; 2] {
        let [from, to] = self.estimate.ci90;
        if from.is_finite() && to.is_finite() { [from, to] } else { [self.estimate.value; 2] }
    }

    /// Distance of a value from "identical", in healthy tolerances: ±1 is an end of the healthy
    /// range. NaN without a range.
    ///
    /// For a ratio (range around 1) identical is 1 and the scale logarithmic; for a distance (range
    /// from 0) identical is 0; otherwise it is the middle of the range.
    #[must_use]
    pub fn departure(&self, value: f64) -> f64 {
        match self.healthy {
            Some([low, high]) if 0.0 < low && low < 1.0 && high > 1.0 => {
                let end = if value >= 1.0 { high } else { low };
                let sign = if value >= 1.0 { 1.0 } else { -1.0 };
                if value > 0.0 { sign * value.ln() / end.ln() } else { f64::NEG_INFINITY }
            }
            Some([low, high]) if low == 0.0 && high > 0.0 => value / high,
            Some([low, high]) if high > low => (value - 0.5 * (low + high)) / (0.5 * (high - low)),
            _ => f64::NAN,
        }
    }

    /// The healthy range as text: "0.5 to 2", "at most 0.25".
    #[must_use]
    pub fn range_text(&self) -> String {
        let short = |v: f64| format!("{v}");
        match self.healthy {
            Some([0.0, high]) => format!("at most {}", short(high)),
            Some([low, high]) => format!("{} to {}", short(low), short(high)),
            None => String::new(),
        }
    }
}

/// One sentence on all measures: how many are healthy, and the farthest one.
#[must_use]
pub fn headline(measures: &[MeasureRow]) -> String {
    let judged: Vec<&MeasureRow> = measures
        .iter()
        .filter(|m| !matches!(m.verdict(), MeasureVerdict::NoRange | MeasureVerdict::Unknown))
        .collect();
    let n_healthy = judged.iter().filter(|m| m.verdict() == MeasureVerdict::Healthy).count();
    let farthest = judged
        .iter()
        .filter(|m| m.verdict() == MeasureVerdict::Outside)
        .max_by(|a, b| a.distance().total_cmp(&b.distance()));
    let are = if n_healthy == 1 { "is" } else { "are" };
    match (judged.len(), farthest) {
        (0, _) => "No measure has a healthy range.".to_owned(),
        (n, None) if n_healthy == n => {
            format!("Every measure is healthy ({n} of {n}).")
        }
        (n, None) => format!("{n_healthy} of {n} measures {are} healthy, none is clearly outside."),
        (n, Some(worst)) => format!(
            "{n_healthy} of {n} measures {are} healthy; {} departs most.",
            lower_first(&worst.name)
        ),
    }
}

/// A sentence for each measure outside its range, the farthest first.
#[must_use]
pub fn departing(measures: &[MeasureRow]) -> Vec<String> {
    let mut outside: Vec<&MeasureRow> =
        measures.iter().filter(|m| m.verdict() == MeasureVerdict::Outside).collect();
    outside.sort_by(|a, b| b.distance().total_cmp(&a.distance()));
    let unit =
        |m: &MeasureRow| if m.unit.is_empty() { String::new() } else { format!(" {}", m.unit) };
    let sentence = |m: &&MeasureRow| {
        format!("{}: {}{}; healthy is {}.", m.name, quantity(&m.estimate), unit(m), m.range_text())
    };
    outside.iter().map(sentence).collect()
}

impl MeasureRow {
    fn distance(&self) -> f64 {
        self.departure(self.estimate.value).abs()
    }
}

/// "Event count ratio" within a sentence, but "IoU" as it is.
fn lower_first(name: &str) -> String {
    let mut chars = name.chars();
    match (chars.next(), chars.clone().next()) {
        (Some(first), Some(second)) if second.is_lowercase() => {
            first.to_lowercase().chain(chars).collect()
        }
        _ => name.to_owned(),
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    pub(crate) fn measure(value: f64, error: f64, healthy: Option<[f64; 2]>) -> MeasureRow {
        MeasureRow {
            id: "count_ratio".into(),
            name: "Event count ratio".into(),
            formula: "N_sim / N_real".into(),
            source: "Ning et al.".into(),
            unit: String::new(),
            estimate: Estimate::normal(value, error, 100),
            healthy,
            real: Some(1000.0),
            simulated: Some(1000.0 * value),
            data: None,
        }
    }

    #[test]
    fn the_interval_and_not_the_value_decides() {
        let range = Some([0.5, 2.0]);
        assert_eq!(measure(1.9, 0.01, range).verdict(), MeasureVerdict::Healthy);
        assert_eq!(measure(1.9, 0.1, range).verdict(), MeasureVerdict::Borderline);
        assert_eq!(measure(2.1, 0.1, range).verdict(), MeasureVerdict::Borderline);
        assert_eq!(measure(2.5, 0.1, range).verdict(), MeasureVerdict::Outside);
        assert_eq!(measure(2.5, 0.1, None).verdict(), MeasureVerdict::NoRange);
        assert_eq!(measure(f64::NAN, 0.1, range).verdict(), MeasureVerdict::Unknown);
        assert_eq!(measure(1.0, f64::NAN, range).verdict(), MeasureVerdict::Healthy);
    }

    #[test]
    fn every_healthy_range_ends_one_tolerance_from_identical() {
        for (range, identical) in
            [([0.5, 2.0], 1.0), ([0.8, 1.2], 1.0), ([0.0, 0.25], 0.0), ([-2.0, 4.0], 1.0)]
        {
            let m = measure(1.0, 0.1, Some(range));
            assert!(m.departure(identical).abs() < 1e-12);
            assert!((m.departure(range[1]) - 1.0).abs() < 1e-12);
            if range[0] != 0.0 {
                assert!((m.departure(range[0]) + 1.0).abs() < 1e-12);
            }
        }
        assert_eq!(measure(1.0, 0.1, Some([0.5, 2.0])).departure(0.0), f64::NEG_INFINITY);
    }

    #[test]
    fn the_headline_names_what_departs_most() {
        let mut tv = measure(0.5, 0.01, Some([0.0, 0.25]));
        tv.name = "Interval total variation".into();
        let good = measure(1.0, 0.01, Some([0.5, 2.0]));
        let bad = measure(2.1, 0.001, Some([0.5, 2.0]));
        assert_eq!(
            departing(&[good.clone(), bad.clone(), tv.clone()]),
            [
                "Interval total variation: 0.500 ± 0.010; healthy is at most 0.25.",
                "Event count ratio: 2.1000 ± 0.0010; healthy is 0.5 to 2."
            ]
        );
        assert_eq!(
            headline(&[good.clone(), tv, bad]),
            "1 of 3 measures is healthy; interval total variation departs most."
        );
        assert!(headline(&[good]).contains("(1 of 1)"));
        assert!(headline(&[]).contains("No measure"));
    }
}
