//! The concealed truth of a trial.

use evrig_core::effect_id::EffectId;
use evrig_core::geometry::Rectangle;
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::collections::BTreeMap;

/// Source of the sessions of trials.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Family {
    /// The simulated rig.
    World,
    /// A third-party simulator.
    #[serde(alias = "foreign")]
    ThirdParty,
    /// A real recording with an effect applied to it.
    Plasmode,
}

impl Family {
    /// The name as files and tables write it.
    #[must_use]
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::World => "world",
            Self::ThirdParty => "third_party",
            Self::Plasmode => "plasmode",
        }
    }
}

/// One hidden effect.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ConcealedEffect {
    /// Its id, from [`EffectId`] or, when it is outside the library, the world's own name for it.
    pub id: String,
    /// Its parameters by key.
    pub parameters: BTreeMap<String, f64>,
    /// How strong it is, in units of the least strength of the plan's table.
    pub strength: f64,
}

impl ConcealedEffect {
    /// The library's name for it; `None` when the library does not know it.
    #[must_use]
    pub fn effect(&self) -> Option<EffectId> {
        self.id.parse().ok()
    }

    /// Its parameters as a description of the world has them: whole numbers as such, since some
    /// are counts.
    #[must_use]
    pub fn description(&self) -> serde_json::Value {
        let number = |value: f64| match value {
            whole if whole.fract() == 0.0 && whole.abs() < 1e15 => json!(whole as i64),
            other => json!(other),
        };
        let parameters = self.parameters.iter();
        parameters.map(|(key, &value)| (key.clone(), number(value))).collect()
    }
}

/// A trial to be made.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ConcealedTrial {
    /// Its name, a folder's name.
    pub name: String,
    /// Whose session it is.
    pub family: Family,
    /// Name of the target image; empty where the family has none.
    pub image: String,
    /// The trajectory's name; empty where the family has none.
    pub trajectory: String,
    /// Seed of the session.
    pub seed: u64,
    /// What is hidden in it.
    pub truth: SealedTruth,
}

/// What is hidden in a trial.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SealedTruth {
    /// `evrig.truth/1`.
    pub schema: String,
    /// The hidden effects, none in a clean session.
    pub effects: Vec<ConcealedEffect>,
    /// The pixels to which they are limited; all when absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub region: Option<Rectangle>,
    /// Random digits, so that the truth cannot be guessed from its checksum.
    pub nonce: String,
}

impl SealedTruth {
    /// Nothing hidden, and no secret about it.
    #[must_use]
    pub fn nothing() -> Self {
        let (effects, region) = (Vec::new(), None);
        Self { schema: "evrig.truth/1".into(), effects, region, nonce: String::new() }
    }

    /// Whether nothing is hidden.
    #[must_use]
    pub fn is_clean(&self) -> bool {
        self.effects.is_empty()
    }

    /// Whether something is hidden that the library does not know.
    #[must_use]
    pub fn is_outside_library(&self) -> bool {
        self.effects.iter().any(|concealed| concealed.effect().is_none())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rectangles_share_what_lies_in_both() {
        let a = Rectangle { x_px: [0, 10], y_px: [0, 10] };
        let b = Rectangle { x_px: [5, 20], y_px: [8, 9] };
        assert_eq!((a.area(), b.area(), a.shared(&b)), (100, 15, 5));
        let apart = Rectangle { x_px: [10, 12], y_px: [0, 10] };
        assert_eq!(a.shared(&apart), 0);
    }
}
