//! How the law of the event model is sampled.

use serde::{Deserialize, Serialize};

/// How the voltmeter's law is drawn from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum VoltmeterLaw {
    /// The stated equation, exactly.
    #[default]
    Exact,
    /// The published program's shortcuts, for comparison with its output.
    Reference,
}

impl VoltmeterLaw {
    /// All laws.
    pub const ALL: [Self; 2] = [Self::Exact, Self::Reference];

    /// The name on the command line and in files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Exact => "exact",
            Self::Reference => "reference",
        }
    }
}

named!(VoltmeterLaw, "law");
