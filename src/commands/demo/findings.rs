//! What the demo found, in lines for the terminal and remarks for the report.

use crate::prove::{ConcealedEffect, Judgement, SealedTruth};
use evrig_analysis::diagnose::{Diagnosis, ForwardSimulation};
use evrig_report::number::significant;
use evrig_report::verdict::{headline, removed};
use evrig_report::words::{enumeration, quantity_words, value_words};

/// The diagnosis, the opened truth with its judgement, and the forward simulation.
pub(super) struct DemoFindings<'a> {
    pub(super) diagnosis: &'a Diagnosis,
    pub(super) opened: Option<&'a (SealedTruth, Judgement)>,
    pub(super) run: Option<&'a ForwardSimulation>,
}

impl DemoFindings<'_> {
    /// One line each, every line ended.
    pub(super) fn text(&self) -> String {
        let found = format!("{} {}", headline(self.diagnosis), removed(self.diagnosis));
        let lines = [
            ("where", self.place()),
            ("found", found.trim_end().to_owned()),
            ("generated", self.generated()),
            ("concealed", self.concealed()),
        ];
        let lines = lines.iter().filter(|(_, text)| !text.is_empty());
        lines.map(|(name, text)| format!("{name:<10} {text}\n")).collect()
    }

    /// For the top of the report.
    pub(super) fn remarks(&self) -> Vec<String> {
        let concealed = self.concealed();
        let remark = format!("Concealed in this session: {concealed}");
        if concealed.is_empty() { Vec::new() } else { vec![remark] }
    }

    /// The stratum with the largest misfit.
    fn place(&self) -> String {
        let strata = &self.diagnosis.mismatch.strata;
        strata.first().map(|worst| worst.description.clone()).unwrap_or_default()
    }

    /// Numbers of generated events before and after, relative to the recording.
    fn generated(&self) -> String {
        let ratio = |run: &ForwardSimulation| {
            if !run.left_out.is_empty() {
                return None;
            }
            let measure = run.measures.get("count_ratio")?;
            Some([measure.baseline?, measure.r#final?].map(|ratio| significant(ratio, 3)))
        };
        self.run.and_then(ratio).map_or_else(String::new, |[before, after]| {
            format!(
                "{before} times as many events as recorded without the named effects, {after} \
                 with them"
            )
        })
    }

    /// What was concealed, and whether the answer is right.
    fn concealed(&self) -> String {
        let Some((truth, judgement)) = self.opened else { return String::new() };
        let effects: Vec<String> = truth.effects.iter().map(effect_words).collect();
        let covered = judgement.parameters.iter().filter_map(|check| check.is_covered);
        let is_covered = covered.fold(None, |all, one| Some(all.unwrap_or(true) && one));
        let off = judgement.parameters.iter().map(|check| check.relative_error).fold(0.0, f64::max);
        let verdict = match (judgement.is_top1, judgement.is_top1_or_equivalent, is_covered) {
            (true, _, Some(true)) => "right, and the interval holds the concealed value".to_owned(),
            (true, ..) => format!("right; the value is {}\u{a0}% off", significant(100.0 * off, 2)),
            (false, true, _) => "one of several that cannot be distinguished".to_owned(),
            (false, false, _) => "wrong".to_owned(),
        };
        format!("{}. The answer is {verdict}.", enumeration(&effects))
    }
}

/// An effect and its concealed parameters.
fn effect_words(concealed: &ConcealedEffect) -> String {
    let name = concealed.effect().map_or(concealed.id.as_str(), |effect| effect.name());
    let parameter = |(key, value): (&String, &f64)| {
        format!("{} {}", quantity_words(key).0, value_words(key, *value))
    };
    let parameters: Vec<String> = concealed.parameters.iter().map(parameter).collect();
    format!("{name}, {}", parameters.join(", "))
}
