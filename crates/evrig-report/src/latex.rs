//! Text and numbers in LaTeX.

use crate::number::Quantity;
use std::fmt::Write;

/// Text with every character that LaTeX takes as its own escaped.
#[must_use]
pub fn text(plain: &str) -> String {
    let mut escaped = String::with_capacity(plain.len());
    for c in plain.chars() {
        match c {
            '&' | '%' | '$' | '#' | '_' | '{' | '}' => escaped.extend(['\\', c]),
            '~' => escaped.push_str(r"\textasciitilde{}"),
            '^' => escaped.push_str(r"\textasciicircum{}"),
            '\\' => escaped.push_str(r"\textbackslash{}"),
            _ => escaped.push(c),
        }
    }
    escaped
}

/// A value with its error in math mode, bold where it is marked; a dash where it is unknown.
#[must_use]
pub fn quantity(quantity: &Quantity, is_marked: bool) -> String {
    if quantity.value == "unknown" {
        return "--".to_owned();
    }
    let mut shown = math(&quantity.value);
    if !quantity.error.is_empty() {
        let _ = write!(shown, r" \pm {}", math(&quantity.error));
    }
    if is_marked { format!(r"$\mathbf{{{shown}}}$") } else { format!("${shown}$") }
}

/// A number as [`number`](crate::number) writes it.
fn math(number: &str) -> String {
    let mut shown = String::new();
    let mut power = String::new();
    for c in number.chars() {
        match c {
            '\u{2212}' => shown.push('-'),
            '\u{202f}' => shown.push_str(r"\,"),
            '·' => shown.push_str(r" \cdot "),
            _ => match plain_digit(c) {
                Some(digit) => power.push(digit),
                None => shown.push(c),
            },
        }
    }
    if power.is_empty() { shown } else { format!("{shown}^{{{power}}}") }
}

/// The digit or sign that a superscript raises.
fn plain_digit(c: char) -> Option<char> {
    const RAISED: [char; 11] = ['⁻', '⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'];
    let at = RAISED.iter().position(|raised| *raised == c)?;
    "-0123456789".chars().nth(at)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::number;
    use evrig_core::stats::Estimate;

    #[test]
    fn numbers_have_the_digits_of_their_errors() {
        let shown =
            |value, error| quantity(&number::quantity(&Estimate::normal(value, error, 9)), false);
        assert_eq!(shown(1.312_99, 0.020_71), r"$1.313 \pm 0.021$");
        assert_eq!(shown(-0.5, 0.1), r"$-0.50 \pm 0.10$");
        assert_eq!(shown(123_456.0, 2_345.0), r"$123\,500 \pm 2300$");
        assert_eq!(shown(3.2e-9, 1.1e-10), r"$3.20 \cdot 10^{-9} \pm 0.11 \cdot 10^{-9}$");
        assert_eq!(shown(f64::NAN, f64::NAN), "--");
        let marked = quantity(&number::quantity(&Estimate::normal(2.0, 0.1, 9)), true);
        assert_eq!(marked, r"$\mathbf{2.00 \pm 0.10}$");
    }

    #[test]
    fn names_are_escaped() {
        assert_eq!(text("a_b & 50 % {x}"), r"a\_b \& 50 \% \{x\}");
        assert_eq!(text(r"C:\~"), r"C:\textbackslash{}\textasciitilde{}");
    }
}
