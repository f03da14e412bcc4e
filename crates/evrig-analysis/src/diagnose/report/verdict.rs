//! The parts of a report that follow from scores and tests.

use crate::diagnose::test::two_sample_test::StructureTest;
use crate::diagnose::{DiagnosisVerdict, FitReport, HeldOutScores, ResidualStructure};
use std::collections::BTreeMap;

impl DiagnosisVerdict {
    /// Whether effects are reported as named.
    pub(crate) fn names_effects(self) -> bool {
        matches!(self, Self::Explained | Self::PartlyExplained)
    }

    /// Combines the verdict with missing isolated events and departures of the frames or the
    /// sensor-wide statistics.
    pub(crate) fn combined_with(self, are_missing: bool, is_departed: bool) -> Self {
        let own = match self {
            Self::NoMismatch | Self::MinorMismatch if are_missing => Self::Unexplained,
            Self::Explained if are_missing => Self::PartlyExplained,
            verdict => verdict,
        };
        match own {
            Self::NoMismatch | Self::MinorMismatch if is_departed => Self::Explained,
            Self::Unexplained if is_departed => Self::PartlyExplained,
            verdict => verdict,
        }
    }
}

pub(crate) fn scores([baseline, r#final, upper_bound]: [f64; 3], share: Option<f64>) -> FitReport {
    let upper_bound_source = "hazard_recalibration".into();
    FitReport {
        heldout_nats_per_event: HeldOutScores {
            baseline,
            r#final,
            upper_bound,
            upper_bound_source,
        },
        share_of_excess_removed: share,
        forward_simulation: BTreeMap::new(),
    }
}

pub(crate) fn residual_structure(structure: &StructureTest) -> ResidualStructure {
    ResidualStructure {
        nats_per_event: structure.nats,
        error: structure.error,
        nats_without_light_features: structure.without_light_features,
        accuracy: structure.accuracy,
        top_features: structure.by.iter().take(4).map(|(key, _)| (*key).to_owned()).collect(),
    }
}
