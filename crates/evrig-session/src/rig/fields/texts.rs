//! Keys whose values are texts.

use super::{DescriptionFields, Value};
use std::fmt::Display;
use std::str::FromStr;
use toml::de::DeValue;

/// Longest text of a description.
const MAX_TEXT_BYTES: usize = 1000;

impl DescriptionFields<'_, '_> {
    /// Text; empty after a mistake.
    pub fn text(&self, key: &'static str) -> String {
        self.required(key).and_then(|value| self.as_text(key, value)).unwrap_or_default()
    }

    /// The description, whose key depends on the version: `description`, or `says` where the
    /// table's `schema` is the `former` one. Complains unless `schema` is one of the two.
    pub fn description(&self, [current, former]: [&str; 2]) -> Option<String> {
        let schema = self.text("schema");
        if schema == former {
            return self.optional_text("says");
        }
        if !schema.is_empty() && schema != current {
            self.complain_about("schema", format!("`{schema}`: expected `{current}`"));
        }
        self.optional_text("description")
    }

    /// Text, if the key is there.
    pub fn optional_text(&self, key: &'static str) -> Option<String> {
        self.get(key).and_then(|value| self.as_text(key, value))
    }

    fn as_text(&self, key: &str, value: &Value<'_>) -> Option<String> {
        let text = value.get_ref().as_str();
        if text.is_some_and(|text| text.len() > MAX_TEXT_BYTES) {
            let what = format!("{}: more than {MAX_TEXT_BYTES} bytes of text", self.full(key));
            self.problems.add(value.span(), what);
            return None;
        }
        if text.is_none_or(str::is_empty) {
            let got = if text.is_some() { "an empty one" } else { value.get_ref().type_str() };
            self.problems
                .add(value.span(), format!("{}: expected a text, got {got}", self.full(key)));
        }
        text.filter(|text| !text.is_empty()).map(str::to_owned)
    }

    /// Texts; none when the key is absent.
    pub fn texts(&self, key: &'static str) -> Vec<String> {
        let Some(value) = self.get(key) else { return Vec::new() };
        match value.get_ref() {
            DeValue::Array(array) => {
                array.iter().filter_map(|value| self.as_text(key, value)).collect()
            }
            _ => self.as_text(key, value).into_iter().collect(),
        }
    }

    /// A text that [`FromStr`] understands; None after a mistake or when the key is absent.
    pub fn parsed<P>(&self, key: &'static str) -> Option<P>
    where
        P: FromStr,
        P::Err: Display,
    {
        let text = self.optional_text(key)?;
        text.parse().map_err(|error| self.complain_about(key, error)).ok()
    }
}
