//! Number formatting, with digits according to the error.

use super::plot::scale::{plain, superscript};
use evrig_core::stats::Estimate;

/// A formatted value and its error.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Quantity {
    /// The value to the error's second digit; "unknown" without samples.
    pub value: String,
    /// The standard error; "" where unknown.
    pub error: String,
}

impl std::fmt::Display for Quantity {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if self.error.is_empty() {
            f.write_str(&self.value)
        } else {
            write!(f, "{} ± {}", self.value, self.error)
        }
    }
}

/// Value and standard error with the error rounded to two digits and the value to the same place.
///
/// Without a finite error above zero the value is given to three digits.
#[must_use]
pub fn quantity(estimate: &Estimate) -> Quantity {
    let Estimate { value, standard_error, .. } = *estimate;
    if !value.is_finite() {
        return Quantity { value: "unknown".to_owned(), error: String::new() };
    }
    if !(standard_error.is_finite() && standard_error > 0.0) {
        return Quantity { value: significant(value, 3), error: String::new() };
    }
    let place = exponent(standard_error, 2) - 1;
    let largest = exponent(value, 2).max(place + 1);
    if !(-5..6).contains(&largest) {
        let unit = 10_f64.powi(largest);
        let decimals = (largest - place).max(0) as usize;
        let power = format!("10{}", superscript(largest));
        return Quantity {
            value: format!("{}·{power}", plain(value / unit, decimals)),
            error: format!("{}·{power}", plain(standard_error / unit, decimals)),
        };
    }
    let decimals = (-place).max(0) as usize;
    let rounded = |v: f64| plain(round_to(v, place), decimals);
    Quantity { value: rounded(value), error: rounded(standard_error) }
}

/// A number of things: "1 event", "2 events".
#[must_use]
pub fn counted(n: u64, noun: &str) -> String {
    format!("{n} {noun}{}", if n == 1 { "" } else { "s" })
}

/// "2nd", "11th", "101st".
#[must_use]
pub fn ordinal(n: usize) -> String {
    let ending = match (n % 100, n % 10) {
        (11..=13, _) => "th",
        (_, 1) => "st",
        (_, 2) => "nd",
        (_, 3) => "rd",
        _ => "th",
    };
    format!("{n}{ending}")
}

/// A value to `digits` significant digits; with powers of ten outside 1e-4 to 1e6.
#[must_use]
pub fn significant(value: f64, digits: usize) -> String {
    if !value.is_finite() {
        return "unknown".to_owned();
    }
    if value == 0.0 {
        return "0".to_owned();
    }
    let digits = digits.max(1);
    let exponent = exponent(value, digits);
    if (-4..6).contains(&exponent) {
        let place = exponent - (digits as i32 - 1);
        return plain(round_to(value, place), (-place).max(0) as usize);
    }
    let mantissa = plain(value / 10_f64.powi(exponent), digits - 1);
    format!("{mantissa}·10{}", superscript(exponent))
}

/// An integer with grouped thousands.
#[must_use]
pub fn count(n: u64) -> String {
    let digits = n.to_string();
    let mut grouped = String::with_capacity(digits.len() * 2);
    for (i, c) in digits.chars().enumerate() {
        if i > 0 && digits.len() > 4 && (digits.len() - i).is_multiple_of(3) {
            grouped.push('\u{202f}');
        }
        grouped.push(c);
    }
    grouped
}

/// Decimal exponent of a value after rounding to `digits` digits (0.0996 to two is 0.10).
fn exponent(value: f64, digits: usize) -> i32 {
    if value == 0.0 {
        return i32::MIN / 2;
    }
    let text = format!("{:.*e}", digits - 1, value.abs());
    text.split_once('e').and_then(|(_, e)| e.parse().ok()).unwrap_or(0)
}

/// Rounded to a multiple of ten to the power `place`.
fn round_to(value: f64, place: i32) -> f64 {
    if place <= 0 {
        return value;
    }
    let unit = 10_f64.powi(place);
    (value / unit).round() * unit
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shown(value: f64, error: f64) -> String {
        quantity(&Estimate::normal(value, error, 10)).to_string()
    }

    #[test]
    fn one_thing_has_no_plural_and_ordinals_end_as_spoken() {
        assert_eq!([counted(1, "event"), counted(0, "event")], ["1 event", "0 events"]);
        assert_eq!(
            [2, 3, 11, 101, 112, 20].map(ordinal),
            ["2nd", "3rd", "11th", "101st", "112th", "20th"]
        );
    }

    #[test]
    fn the_error_decides_how_many_digits_are_shown() {
        assert_eq!(shown(1.312_99, 0.020_71), "1.313 ± 0.021");
        assert_eq!(shown(812.4, 14.0), "812 ± 14");
        assert_eq!(shown(-0.5, 0.099_6), "−0.50 ± 0.10");
        assert_eq!(shown(123_456.0, 2_345.0), "123\u{202f}500 ± 2300");
        assert_eq!(shown(0.0, 0.31), "0.00 ± 0.31");
        assert_eq!(shown(3.2e-9, 1.1e-10), "3.20·10⁻⁹ ± 0.11·10⁻⁹");
    }

    #[test]
    fn what_is_not_known_is_not_shown() {
        assert_eq!(quantity(&Estimate::unknown()).to_string(), "unknown");
        assert_eq!(shown(1.234_5, f64::NAN), "1.23");
        assert_eq!(shown(1.234_5, 0.0), "1.23");
    }

    #[test]
    fn thousands_are_set_apart_from_five_digits_on() {
        assert_eq!(count(9_999), "9999");
        assert_eq!(count(78_830), "78\u{202f}830");
        assert_eq!(count(1_234_567), "1\u{202f}234\u{202f}567");
        assert_eq!(significant(0.000_012_3, 2), "1.2·10⁻⁵");
        assert_eq!(significant(99.96, 3), "100");
    }
}
