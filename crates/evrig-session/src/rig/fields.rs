//! Reading a description file key by key, so that all its mistakes are named at once, each with its
//! line.
//!
//! Serde stops at the first mistake and knows neither ranges nor suggestions;
//! here every key is asked for by name with its unit and range, and what was
//! never asked for is unknown.

mod texts;

use super::problems::{DescriptionError, Problems};
use std::cell::RefCell;
use std::fmt::Display;
use std::ops::{Range, RangeBounds};
use toml::Spanned;
use toml::de::{DeTable, DeValue};

type Value<'t> = Spanned<DeValue<'t>>;

/// One table of a description, with the keys that were asked for so far.
pub struct DescriptionFields<'a, 't> {
    /// The table's name with its parents, as messages print it; empty for the file itself.
    name: String,
    /// None for an absent table: reading it reports no further mistakes.
    table: Option<&'a DeTable<'t>>,
    at: Range<usize>,
    asked: RefCell<Vec<&'static str>>,
    /// Keys that were probably meant to be one that is missing.
    misspelt: RefCell<Vec<String>>,
    problems: &'a Problems,
}

/// Parses `text` and passes its top table to `read`; the error holds all mistakes found.
pub fn read_description<T>(
    file: &str,
    text: &str,
    read: impl FnOnce(&DescriptionFields<'_, '_>) -> T,
) -> Result<T, DescriptionError> {
    let problems = Problems::new(file, text);
    let (table, mistakes) = DeTable::parse_recoverable(text);
    for mistake in &mistakes {
        problems.add(mistake.span().unwrap_or(0..0), mistake.message());
    }
    if mistakes.is_empty() {
        let fields = DescriptionFields {
            name: String::new(),
            table: Some(table.get_ref()),
            at: 0..0,
            asked: RefCell::default(),
            misspelt: RefCell::default(),
            problems: &problems,
        };
        let value = read(&fields);
        fields.name_unknown_keys();
        problems.none_or(value)
    } else {
        Err(problems.into_error())
    }
}

impl<'a, 't> DescriptionFields<'a, 't> {
    fn get(&self, key: &'static str) -> Option<&'a Value<'t>> {
        self.asked.borrow_mut().push(key);
        self.table?.get(key)
    }

    fn required(&self, key: &'static str) -> Option<&'a Value<'t>> {
        let value = self.get(key);
        if value.is_none() && self.table.is_some() {
            let place = match self.name.as_str() {
                "" => "the file".to_owned(),
                name => format!("[{name}]"),
            };
            let near_miss = self.near_miss(key);
            // A misspelt key is one mistake, not a missing one and an unknown one.
            self.misspelt.borrow_mut().extend(near_miss.clone());
            self.problems.add_missing(self.at.clone(), key, &place, near_miss);
        }
        value
    }

    /// Reports the key as missing when it is absent; its value is read elsewhere.
    pub fn require(&self, key: &'static str) {
        self.required(key);
    }

    /// A key of this table that was probably meant to be `key`.
    fn near_miss(&self, key: &str) -> Option<String> {
        let keys = self.table?.keys().map(|found| found.get_ref().as_ref());
        closest(key, keys).map(str::to_owned)
    }

    /// The key's full name, as messages print it.
    fn full(&self, key: impl Display) -> String {
        if self.name.is_empty() { key.to_string() } else { format!("{}.{key}", self.name) }
    }

    /// Adds a mistake about this table as a whole.
    pub fn complain(&self, what: impl Display) {
        self.problems.add(self.at.clone(), format!("[{}]: {what}", self.name));
    }

    /// Adds a mistake about one of its keys.
    pub fn complain_about(&self, key: &'static str, what: impl Display) {
        let at = self.table.and_then(|table| table.get(key)).map_or(self.at.clone(), Spanned::span);
        self.problems.add(at, format!("{}: {what}", self.full(key)));
    }

    /// Whether the key is there.
    pub fn has(&self, key: &'static str) -> bool {
        self.get(key).is_some()
    }

    fn as_number(
        &self,
        key: &str,
        value: &Value<'_>,
        range: &impl RangeBounds<f64>,
    ) -> Option<f64> {
        let number = match value.get_ref() {
            DeValue::Float(float) => float.as_str().parse().ok(),
            DeValue::Integer(integer) => {
                i64::from_str_radix(integer.as_str(), integer.radix()).ok().map(|i| i as f64)
            }
            _ => None,
        };
        let complaint = match number {
            None => format!("{} is not a number", value.get_ref().type_str()),
            Some(number) if !number.is_finite() => format!("{number} is not a finite number"),
            Some(number) if !range.contains(&number) => {
                format!("{number} is outside {}", in_words(range))
            }
            Some(number) => return Some(number),
        };
        self.problems.add(value.span(), format!("{}: {complaint}", self.full(key)));
        None
    }

    /// A number within `range`; NaN after a mistake.
    pub fn number(&self, key: &'static str, range: impl RangeBounds<f64>) -> f64 {
        self.required(key).and_then(|value| self.as_number(key, value, &range)).unwrap_or(f64::NAN)
    }

    /// A number within `range`, if the key is there.
    pub fn optional_number(&self, key: &'static str, range: impl RangeBounds<f64>) -> Option<f64> {
        self.get(key).and_then(|value| self.as_number(key, value, &range))
    }

    /// `N` numbers within `range` each; NaN after a mistake.
    pub fn numbers<const N: usize>(
        &self,
        key: &'static str,
        range: impl RangeBounds<f64>,
    ) -> [f64; N] {
        let list = self.required(key).map_or_else(Vec::new, |_| self.list(key, &range));
        <[f64; N]>::try_from(list).unwrap_or_else(|list| {
            if self.has(key) {
                self.complain_about(key, format!("expected {N} numbers, got {}", list.len()));
            }
            [f64::NAN; N]
        })
    }

    /// As many numbers as are given, within `range` each; none when the key is absent.
    pub fn list(&self, key: &'static str, range: &impl RangeBounds<f64>) -> Vec<f64> {
        let Some(value) = self.get(key) else { return Vec::new() };
        match value.get_ref() {
            DeValue::Array(array) => array
                .iter()
                .map(|value| self.as_number(key, value, range).unwrap_or(f64::NAN))
                .collect(),
            other => {
                let got = other.type_str();
                self.complain_about(key, format!("expected a list of numbers, got {got}"));
                Vec::new()
            }
        }
    }

    /// `[lowest, highest]`, the second above the first.
    pub fn interval(&self, key: &'static str, range: impl RangeBounds<f64>) -> [f64; 2] {
        let [low, high] = self.numbers(key, range);
        if low >= high {
            self.complain_about(
                key,
                format!("the lowest ({low}) is not below the highest ({high})"),
            );
        }
        [low, high]
    }

    /// As [`Self::interval`], if the key is there.
    pub fn optional_interval(
        &self,
        key: &'static str,
        range: impl RangeBounds<f64>,
    ) -> Option<[f64; 2]> {
        self.has(key).then(|| self.interval(key, range))
    }

    /// A whole number within `range`; the lowest value of its type after a mistake.
    pub fn integer<I>(&self, key: &'static str, range: impl RangeBounds<f64>) -> I
    where
        I: TryFrom<i64> + Default,
    {
        self.required(key).and_then(|value| self.as_integer(key, value, &range)).unwrap_or_default()
    }

    /// A whole number within `range`, if the key is there.
    pub fn optional_integer<I: TryFrom<i64>>(
        &self,
        key: &'static str,
        range: impl RangeBounds<f64>,
    ) -> Option<I> {
        self.get(key).and_then(|value| self.as_integer(key, value, &range))
    }

    fn as_integer<I: TryFrom<i64>>(
        &self,
        key: &str,
        value: &Value<'_>,
        range: &impl RangeBounds<f64>,
    ) -> Option<I> {
        let number = self.as_number(key, value, range)?;
        let whole = (number.fract() == 0.0).then(|| I::try_from(number as i64).ok()).flatten();
        if whole.is_none() {
            let what = format!("{}: {number} is not a whole number in range", self.full(key));
            self.problems.add(value.span(), what);
        }
        whole
    }

    /// True or false, if the key is there.
    pub fn optional_bool(&self, key: &'static str) -> Option<bool> {
        let value = self.get(key)?;
        if value.get_ref().as_bool().is_none() {
            let got = value.get_ref().type_str();
            self.complain_about(key, format!("expected true or false, got {got}"));
        }
        value.get_ref().as_bool()
    }

    /// Passes the sub-table `key` to `read`; when it is absent, one mistake and an empty table.
    pub fn table<T>(
        &self,
        key: &'static str,
        read: impl FnOnce(&DescriptionFields<'_, 't>) -> T,
    ) -> T {
        self.descend(key, self.required(key), read)
    }

    /// Passes the sub-table `key` to `read`, if it is there.
    pub fn optional_table<T>(
        &self,
        key: &'static str,
        read: impl FnOnce(&DescriptionFields<'_, 't>) -> T,
    ) -> Option<T> {
        let value = self.get(key)?;
        Some(self.descend(key, Some(value), read))
    }

    fn descend<T>(
        &self,
        key: &str,
        value: Option<&Value<'t>>,
        read: impl FnOnce(&DescriptionFields<'_, 't>) -> T,
    ) -> T {
        let table = value.and_then(|value| value.get_ref().as_table());
        if let (Some(value), None) = (value, table) {
            let got = value.get_ref().type_str();
            self.problems
                .add(value.span(), format!("{}: expected a table, got {got}", self.full(key)));
        }
        let at = value.map_or(self.at.clone(), Spanned::span);
        let asked = RefCell::default();
        let fields = DescriptionFields {
            name: self.full(key),
            table,
            at,
            asked,
            misspelt: RefCell::default(),
            problems: self.problems,
        };
        let result = read(&fields);
        fields.name_unknown_keys();
        result
    }

    /// Passes each table of the list `key` (`[[key]]`) to `read`, with its number from 0.
    pub fn tables<T>(
        &self,
        key: &'static str,
        mut read: impl FnMut(usize, &DescriptionFields<'_, 't>) -> T,
    ) -> Vec<T> {
        let Some(value) = self.required(key) else { return Vec::new() };
        let Some(array) = value.get_ref().as_array() else {
            self.complain_about(key, format!("expected a list of tables, written [[{key}]]"));
            return Vec::new();
        };
        let numbered = array.iter().enumerate();
        numbered
            .map(|(i, value)| {
                self.descend(&format!("{key} {}", i + 1), Some(value), |fields| read(i, fields))
            })
            .collect()
    }

    /// Keys of a table whose keys are names, not vocabulary, with whole numbers in `range`.
    pub fn named_integers(
        &self,
        known: &'static [&'static str],
        range: impl RangeBounds<f64>,
    ) -> Vec<(&'static str, u16)> {
        let found = known.iter().filter_map(|key| {
            let value = self.optional_integer(key, (range.start_bound(), range.end_bound()))?;
            Some((*key, value))
        });
        found.collect()
    }

    fn name_unknown_keys(&self) {
        let asked = self.asked.borrow();
        let misspelt = self.misspelt.borrow();
        for key in self.table.iter().flat_map(|table| table.keys()) {
            let name = key.get_ref().as_ref();
            if !asked.contains(&name) && !misspelt.iter().any(|key| key == name) {
                let suggestion = closest(name, asked.iter().copied());
                self.problems.add_unknown(key.span(), &self.full(name), suggestion, &asked);
            }
        }
    }
}

/// The candidate most similar to `word`, by the Jaro-Winkler similarity, if that exceeds 0.8.
pub fn closest<'c>(word: &str, candidates: impl IntoIterator<Item = &'c str>) -> Option<&'c str> {
    let likeness = |candidate: &str| strsim::jaro_winkler(word, candidate);
    candidates
        .into_iter()
        .map(|candidate| (likeness(candidate), candidate))
        .filter(|(likeness, _)| *likeness > 0.8)
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, candidate)| candidate)
}

fn in_words(range: &impl RangeBounds<f64>) -> String {
    use std::ops::Bound::{Excluded, Included, Unbounded};
    match (range.start_bound(), range.end_bound()) {
        (Included(low), Included(high)) => format!("{low} to {high}"),
        (Excluded(low), Unbounded) => format!("what is allowed: above {low}"),
        (Included(low), Unbounded) => format!("what is allowed: {low} or more"),
        (Excluded(low), Included(high)) => format!("what is allowed: above {low}, up to {high}"),
        (low, high) => format!("{low:?} to {high:?}"),
    }
}

/// Everything above zero.
pub(super) const POSITIVE: (std::ops::Bound<f64>, std::ops::Bound<f64>) =
    (std::ops::Bound::Excluded(0.0), std::ops::Bound::Unbounded);

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<(f64, String), DescriptionError> {
        read_description("file.toml", text, |fields| {
            let name = fields.text("name");
            fields.table("arm", |arm| (arm.number("radius_mm", POSITIVE), name))
        })
    }

    #[test]
    fn a_right_file_gives_its_values() {
        assert_eq!(read("name = 'a'\n[arm]\nradius_mm = 12").unwrap(), (12.0, "a".to_owned()));
    }

    #[test]
    fn an_unknown_key_is_refused_with_its_line_and_a_suggestion() {
        let error = read("name = 'a'\n[arm]\nradius_mm = 12\nradus_mm = 3").unwrap_err();
        let report = error.to_string();
        assert!(report.starts_with("file.toml:4: "), "{report}");
        assert!(
            report.contains("`arm.radus_mm`") && report.contains("did you mean `radius_mm`?"),
            "{report}"
        );
    }

    #[test]
    fn all_mistakes_are_named_at_once() {
        let error = read("nam = 'a'\n[arm]\nradius_mm = -1\nspeed = 2").unwrap_err();
        let report = error.to_string();
        assert_eq!(error.problems().len(), 3, "{report}");
        for part in ["`name` is missing", "it has `nam`", "-1 is outside", "`arm.speed`"] {
            assert!(report.contains(part), "`{part}` is not in: {report}");
        }
    }

    #[test]
    fn nan_and_infinity_are_named() {
        for value in ["nan", "inf", "-inf"] {
            let error = read(&format!("name = 'a'\n[arm]\nradius_mm = {value}")).unwrap_err();
            assert!(error.to_string().contains("is not a finite number"), "{error}");
        }
    }

    #[test]
    fn a_missing_table_is_one_complaint_not_one_for_each_of_its_keys() {
        let error = read("name = 'a'").unwrap_err();
        assert_eq!(error.problems().len(), 1, "{error}");
    }

    #[test]
    fn what_is_no_toml_is_named_with_its_line() {
        let error = read("name = 'a'\n[arm\nradius_mm = 12").unwrap_err();
        assert!(error.to_string().contains('2'), "{error}");
        assert!(!error.problems().is_empty());
    }
}
