//! Words and units of the keys by which results name their quantities.

use super::number::significant;
use evrig_analysis::diagnose::{ConfidenceInterval, FittedEffect};
use evrig_core::effect_id::EffectId;

/// Units as they end a key or stand within it, and as they are written.
const UNITS: [(&str, &str); 13] = [
    ("hz_per_s", "Hz/s"),
    ("thresholds_per_s", "thresholds/s"),
    ("events_per_s", "events/s"),
    ("per_s", "1/s"),
    ("thresholds", "thresholds"),
    ("us", "µs"),
    ("ms", "ms"),
    ("s", "s"),
    ("hz", "Hz"),
    ("px", "px"),
    ("mm", "mm"),
    ("dn", "DN"),
    ("ppm", "ppm"),
];

/// The words of a key such as `cutoff_hz_at_white`, and its unit; empty where the key has none.
#[must_use]
pub fn quantity_words(key: &str) -> (String, &'static str) {
    let padded = format!("_{key}_");
    let unit = UNITS.iter().find(|(suffix, _)| padded.contains(&format!("_{suffix}_")));
    let (rest, unit) = match unit {
        Some((suffix, unit)) => (padded.replacen(&format!("_{suffix}_"), "_", 1), *unit),
        None => (padded, ""),
    };
    let words = rest.trim_matches('_').replace("on_off", "ON/OFF").replace('_', " ");
    (words, unit)
}

/// A value with its unit; times from a millisecond on in milliseconds.
fn with_unit(value: f64, unit: &str, digits: usize) -> String {
    let (value, unit) =
        if unit == "µs" && value.abs() >= 1e3 { (value * 1e-3, "ms") } else { (value, unit) };
    let space = if unit.is_empty() { "" } else { "\u{a0}" };
    format!("{}{space}{unit}", significant(value, digits))
}

/// An estimate with its unit and its 90 % interval, where known.
#[must_use]
pub fn estimate_words(key: &str, estimate: &ConfidenceInterval) -> String {
    let (_, unit) = quantity_words(key);
    let value = with_unit(estimate.value, unit, 4);
    match estimate.ci90 {
        // A setting that was chosen among few has no interval.
        [Some(low), Some(high)] if low < high => format!(
            "{value} (90\u{a0}% interval {} to {})",
            with_unit(low, unit, 4),
            with_unit(high, unit, 4)
        ),
        _ => value,
    }
}

/// A value by its key, without an interval.
#[must_use]
pub fn value_words(key: &str, value: f64) -> String {
    with_unit(value, quantity_words(key).1, 4)
}

/// The parameters of an effect by words, each with its interval.
#[must_use]
pub fn parameter_words(effect: &FittedEffect) -> String {
    let words = |(key, value): (&String, &ConfidenceInterval)| {
        format!("{} {}", quantity_words(key).0, estimate_words(key, value))
    };
    effect.parameters.iter().map(words).collect::<Vec<String>>().join(", ")
}

/// A sentence with times of a millisecond and more, given in microseconds, in milliseconds.
#[must_use]
pub fn readable_times(text: &str) -> String {
    let mut words: Vec<String> = text.split(' ').map(str::to_owned).collect();
    for at in (1..words.len()).filter(|at| text.split(' ').nth(*at) == Some("us")) {
        // "from 22590 to 1277002 us" has two of them.
        let is_range = at >= 3 && words[at - 2] == "to";
        let places = if is_range { vec![at - 3, at - 1] } else { vec![at - 1] };
        let values: Vec<f64> = places.iter().filter_map(|i| words[*i].parse().ok()).collect();
        if values.len() == places.len() && values.iter().any(|value| value.abs() >= 1e3) {
            for (place, value) in places.into_iter().zip(values) {
                words[place] = significant(value * 1e-3, 3);
            }
            "ms".clone_into(&mut words[at]);
        }
    }
    words.join(" ")
}

/// A list in a sentence: "a, b and c".
#[must_use]
pub fn enumeration(words: &[String]) -> String {
    match words {
        [] => String::new(),
        [one] => one.clone(),
        [first @ .., last] => format!("{} and {last}", first.join(", ")),
    }
}

/// The effect's name within a sentence.
#[must_use]
pub fn name_in_sentence(effect: EffectId) -> String {
    let name = effect.name();
    let is_word = name.chars().nth(1).is_some_and(char::is_lowercase);
    if is_word { format!("{}{}", name[..1].to_lowercase(), &name[1..]) } else { name.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_parameter_of_the_library_has_words_without_its_unit() {
        assert_eq!(quantity_words("refractory_us"), ("refractory".to_owned(), "µs"));
        assert_eq!(quantity_words("cutoff_hz_at_white"), ("cutoff at white".to_owned(), "Hz"));
        assert_eq!(quantity_words("on_off_ratio"), ("ON/OFF ratio".to_owned(), ""));
        assert_eq!(quantity_words("max_events_per_s"), ("max".to_owned(), "events/s"));
        for effect in EffectId::ALL {
            for key in effect.parameters() {
                let (words, _) = quantity_words(key);
                assert!(!words.is_empty() && !words.contains('_'), "{key}: {words}");
            }
        }
    }

    #[test]
    fn a_long_time_is_written_in_milliseconds() {
        let estimate = ConfidenceInterval { value: 4512.3, ci90: [Some(4480.0), Some(4544.0)] };
        assert_eq!(
            estimate_words("refractory_us", &estimate),
            "4.512\u{a0}ms (90\u{a0}% interval 4.480\u{a0}ms to 4.544\u{a0}ms)"
        );
    }

    #[test]
    fn long_times_in_sentences_are_in_milliseconds() {
        let description = "events 22590 to 1277002 us after the pixel's last one come late";
        let read = "events 22.6 to 1280 ms after the pixel's last one come late";
        assert_eq!(readable_times(description), read);
        assert_eq!(readable_times("a jitter of 800 us"), "a jitter of 800 us");
        assert_eq!(readable_times("stamps are 4356 us late"), "stamps are 4.36 ms late");
    }

    #[test]
    fn names_keep_their_abbreviations_in_a_sentence() {
        assert_eq!(name_in_sentence(EffectId::RefractoryPeriod), "refractory period");
        assert_eq!(name_in_sentence(EffectId::ApsCoupling), "APS coupling");
    }
}
