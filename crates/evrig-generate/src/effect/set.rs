//! A set of effects, as descriptions and command lines write it.

use super::error::EffectError;
use super::library::Effect;
use super::region::Region;
use evrig_core::effect_id::EffectId;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use serde_json::{Map, Value};
use std::collections::BTreeMap;

/// An effect, and where it acts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AppliedEffect {
    /// What.
    pub effect: Effect,
    /// Where; everywhere when not given.
    pub region: Option<Region>,
}

/// Effects that act together, in the order of the light's way.
///
/// In a file it is a table of tables, `{ refractory_period = { refractory_us = 800 } }`; a
/// `region` beside the parameters limits one effect, a `region` beside the effects all others;
/// a list in place of a table gives one effect several strengths in several regions.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct EffectSet(Vec<AppliedEffect>);

impl EffectSet {
    /// No effect.
    #[must_use]
    pub const fn none() -> Self {
        Self(Vec::new())
    }

    /// These effects, whatever the order in which they are given.
    ///
    /// # Errors
    /// A parameter or region out of range.
    pub fn new(effects: impl IntoIterator<Item = AppliedEffect>) -> Result<Self, EffectError> {
        let mut effects: Vec<AppliedEffect> = effects.into_iter().collect();
        for applied in &effects {
            applied.effect.check()?;
            applied.region.map_or(Ok(()), |region| region.check(applied.effect.id()))?;
        }
        effects.sort_by_key(|applied| (applied.effect.model().stage(), applied.effect.id()));
        Ok(Self(effects))
    }

    /// Effects from words such as `refractory_period:refractory_us=800`; commas between parameters.
    ///
    /// # Errors
    /// The first word that is no effect, or an effect that [`EffectSet::new`] refuses.
    pub fn from_words(words: &[impl AsRef<str>]) -> Result<Self, EffectError> {
        let effects: Result<Vec<_>, _> = words.iter().map(|word| one(word.as_ref())).collect();
        Self::new(effects?)
    }

    /// The effects with their regions, in the order of the light's way.
    pub fn iter(&self) -> impl Iterator<Item = &AppliedEffect> {
        self.0.iter()
    }

    /// Whether nothing acts.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Both sets together.
    #[must_use]
    pub fn and(&self, more: &Self) -> Self {
        let mut effects = [self.0.as_slice(), more.0.as_slice()].concat();
        effects.sort_by_key(|applied| (applied.effect.model().stage(), applied.effect.id()));
        Self(effects)
    }

    fn from_table(mut table: BTreeMap<String, Value>) -> Result<Self, EffectError> {
        let common = table.remove("region");
        let mut effects = Vec::new();
        for (name, value) in table {
            let id: EffectId = name.parse()?;
            let several = match value {
                Value::Array(several) => several,
                one => vec![one],
            };
            for one in several {
                effects.push(applied(id, one, common.as_ref())?);
            }
        }
        Self::new(effects)
    }
}

impl From<Effect> for AppliedEffect {
    fn from(effect: Effect) -> Self {
        Self { effect, region: None }
    }
}

fn one(word: &str) -> Result<AppliedEffect, EffectError> {
    let not_an_effect = || EffectError::NotAnEffect { text: word.to_owned() };
    let (name, rest) = word.split_once(':').unwrap_or((word, ""));
    let id: EffectId = name.trim().parse()?;
    let mut parameters = Map::new();
    for setting in rest.split(',').filter(|setting| !setting.trim().is_empty()) {
        let (key, value) = setting.split_once('=').ok_or_else(not_an_effect)?;
        let value: f64 = value.trim().parse().map_err(|_| not_an_effect())?;
        parameters.insert(key.trim().to_owned(), value.into());
    }
    applied(id, Value::Object(parameters), None)
}

fn applied(
    id: EffectId,
    value: Value,
    common: Option<&Value>,
) -> Result<AppliedEffect, EffectError> {
    let unreadable = |reason: String| EffectError::Unreadable { id, reason };
    let Value::Object(mut table) = value else {
        return Err(unreadable("expected a table of parameters".to_owned()));
    };
    let region = table.remove("region").or_else(|| common.cloned());
    let region = region.map(serde_json::from_value).transpose();
    let region = region.map_err(|error| unreadable(format!("region: {error}")))?;
    Ok(AppliedEffect { effect: Effect::from_table(id, table)?, region })
}

impl Serialize for EffectSet {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        use serde::ser::Error;
        let mut all: BTreeMap<&str, Vec<Value>> = BTreeMap::new();
        for applied in &self.0 {
            let tagged = serde_json::to_value(applied.effect).map_err(S::Error::custom)?;
            let mut table = tagged[applied.effect.id().as_str()].clone();
            if let Some(region) = applied.region {
                table["region"] = serde_json::to_value(region).map_err(S::Error::custom)?;
            }
            all.entry(applied.effect.id().as_str()).or_default().push(table);
        }
        let short = |mut several: Vec<Value>| match several.len() {
            1 => several.remove(0),
            _ => Value::Array(several),
        };
        let all: BTreeMap<_, _> = all.into_iter().map(|(id, all)| (id, short(all))).collect();
        all.serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for EffectSet {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        use serde::de::Error;
        Self::from_table(BTreeMap::deserialize(deserializer)?).map_err(D::Error::custom)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effect::{RefractoryPeriod, ThresholdAsymmetry};

    #[test]
    fn a_table_of_effects_is_read_and_written_back() {
        let text = "refractory_period = { refractory_us = 800 }\n\
             threshold_asymmetry = { on_off_ratio = 0.8, region = { x_px = [10, 20] } }\n\
             region = { y_px = [0, 100] }";
        let effects: EffectSet = toml::from_str(text).unwrap();
        let found: Vec<&AppliedEffect> = effects.iter().collect();
        let everywhere = Some(Region { x_px: None, y_px: Some([0.0, 100.0]) });
        let refractory = RefractoryPeriod { refractory_us: 800.0, compares_on: 0.0 }.into();
        assert!(found.contains(&&AppliedEffect { effect: refractory, region: everywhere }));
        let asymmetry = ThresholdAsymmetry { on_off_ratio: 0.8 }.into();
        let own = Some(Region { x_px: Some([10.0, 20.0]), y_px: None });
        assert!(found.contains(&&AppliedEffect { effect: asymmetry, region: own }));
        let json = serde_json::to_string(&effects).unwrap();
        assert_eq!(serde_json::from_str::<EffectSet>(&json).unwrap(), effects);
    }

    #[test]
    fn words_of_a_command_line_are_read() {
        let words = ["shot_noise:rms_thresholds=0.3,bandwidth_hz=200", "event_drop:fraction=0.1"];
        assert_eq!(EffectSet::from_words(&words).unwrap().iter().count(), 2);
    }

    #[test]
    fn what_is_wrong_is_named() {
        let error = |word: &str| EffectSet::from_words(&[word]).unwrap_err().to_string();
        assert!(error("refractory:refractory_us=1").contains("refractory_period"));
        assert!(error("refractory_period:refractory_us").contains("is not an effect"));
        assert!(error("refractory_period:dead_us=3").contains("refractory_us"));
        assert!(error("refractory_period:refractory_us=-3").contains("0 to"));
        assert!(error("refractory_period:refractory_us=NaN").contains("refractory_us"));
        let empty = "event_drop = { fraction = 0.1, region = { x_px = [9, 9] } }";
        assert!(toml::from_str::<EffectSet>(empty).unwrap_err().to_string().contains("x_px"));
    }

    #[test]
    fn one_effect_has_several_strengths_in_several_regions() {
        let text = "event_drop = [{ fraction = 0.1, region = { x_px = [0, 9] } }, \
             { fraction = 0.5, region = { x_px = [9, 18] } }]";
        let effects: EffectSet = toml::from_str(text).unwrap();
        assert_eq!(effects.iter().count(), 2);
        let json = serde_json::to_string(&effects).unwrap();
        assert_eq!(serde_json::from_str::<EffectSet>(&json).unwrap(), effects);
    }
}
