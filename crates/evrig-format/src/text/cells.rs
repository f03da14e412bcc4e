//! The cells of a line as numbers.

use crate::npy::Column;

/// What separates the cells of a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Separator {
    Comma,
    Semicolon,
    Tab,
    Blanks,
}

/// A cell's number; whole numbers stay exact.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Number {
    Int(i64),
    Float(f64),
}

impl Separator {
    /// The separator of a line: the first of semicolon, tab and comma that is in it, else blanks.
    pub(super) fn of(line: &[u8]) -> Self {
        let known = [(b';', Self::Semicolon), (b'\t', Self::Tab), (b',', Self::Comma)];
        let found = known.into_iter().find(|(byte, _)| line.contains(byte));
        found.map_or(Self::Blanks, |(_, separator)| separator)
    }

    /// The byte that separates.
    const fn byte(self) -> u8 {
        match self {
            Self::Comma => b',',
            Self::Semicolon => b';',
            Self::Tab => b'\t',
            Self::Blanks => b' ',
        }
    }

    /// The cells of a line, without blanks and quotes around them.
    pub(super) fn split(self, line: &[u8]) -> impl Iterator<Item = &[u8]> {
        let is_separator = move |byte: &u8| *byte == self.byte();
        let is_kept = move |cell: &&[u8]| self != Self::Blanks || !cell.is_empty();
        line.split(is_separator).map(unquoted).filter(is_kept)
    }
}

fn unquoted(cell: &[u8]) -> &[u8] {
    let cell = cell.trim_ascii();
    cell.strip_prefix(b"\"").and_then(|rest| rest.strip_suffix(b"\"")).unwrap_or(cell)
}

/// A cell as text.
pub(super) fn text(cell: &[u8]) -> String {
    String::from_utf8_lossy(cell).into_owned()
}

/// The beginning of a line, for an error.
pub(super) fn shorten(line: &[u8]) -> String {
    let text = String::from_utf8_lossy(line);
    let short: String = text.chars().take(60).collect();
    if short.len() < text.len() { format!("{short} ...") } else { short }
}

/// Whether a cell is a number.
pub(super) fn is_number(cell: &[u8], separator: Separator) -> bool {
    number(cell, separator).is_some()
}

/// Parses the cells of a line into `row`.
pub(super) fn parse_row(
    line: &[u8],
    separator: Separator,
    row: &mut Vec<Number>,
) -> Result<(), String> {
    row.clear();
    if parse_plain_row(line, separator, row) {
        return Ok(());
    }
    row.clear();
    for cell in separator.split(line) {
        let Some(number) = number(cell, separator) else {
            return Err(format!("expected numbers, found `{}`", shorten(cell)));
        };
        row.push(number);
    }
    Ok(())
}

fn number(cell: &[u8], separator: Separator) -> Option<Number> {
    if let Some(whole) = whole(cell) {
        return Some(Number::Int(whole));
    }
    let text = std::str::from_utf8(cell).ok()?;
    let parsed = match separator {
        Separator::Semicolon if text.contains(',') => text.replacen(',', ".", 1).parse(),
        _ => text.parse::<f64>(),
    };
    match parsed {
        Ok(value) if value.is_finite() => Some(Number::Float(value)),
        _ => truth(text).map(Number::Int),
    }
}

/// A whole number of up to 18 digits, which cannot overflow.
fn whole(cell: &[u8]) -> Option<i64> {
    let (is_negative, digits) = match cell.strip_prefix(b"-") {
        Some(digits) => (true, digits),
        None => (false, cell),
    };
    if !(1..=18).contains(&digits.len()) {
        return None;
    }
    let mut value = 0_i64;
    for digit in digits {
        value = match digit {
            b'0'..=b'9' => value * 10 + i64::from(digit - b'0'),
            _ => return None,
        };
    }
    Some(if is_negative { -value } else { value })
}

/// The most digits of a decimal whose quotient by a power of ten is the nearest number (Clinger 1990):
/// the digits and the power are exact.
const MAX_EXACT_DIGITS: usize = 15;

/// Parses cells of plain digits, with a sign and a decimal point or without, in one pass, several
/// times faster than cell by cell. False where a cell is anything else.
fn parse_plain_row(line: &[u8], separator: Separator, row: &mut Vec<Number>) -> bool {
    const POWERS: [f64; MAX_EXACT_DIGITS + 1] =
        [1.0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15];
    let end = separator.byte();
    let (mut value, mut n_digits, mut n_behind) = (0_i64, 0, 0);
    let (mut has_point, mut is_negative) = (false, false);
    for byte in line.iter().chain(std::iter::once(&end)) {
        match *byte {
            digit @ b'0'..=b'9' if n_digits < 18 => {
                value = value * 10 + i64::from(digit - b'0');
                n_digits += 1;
                n_behind += usize::from(has_point);
            }
            b'.' if !has_point && n_digits <= MAX_EXACT_DIGITS => has_point = true,
            b'-' if n_digits == 0 && !has_point && !is_negative => is_negative = true,
            byte if byte == end && n_digits > 0 => {
                let signed = if is_negative { -value } else { value };
                if !has_point {
                    row.push(Number::Int(signed));
                } else if n_digits <= MAX_EXACT_DIGITS && value > 0 {
                    row.push(Number::Float(signed as f64 / POWERS[n_behind]));
                } else if value == 0 && !is_negative {
                    row.push(Number::Float(0.0));
                } else {
                    return false;
                }
                (value, n_digits, n_behind) = (0, 0, 0);
                (has_point, is_negative) = (false, false);
            }
            // Several blanks separate as one.
            b' ' if end == b' ' && !has_point && !is_negative => {}
            _ => return false,
        }
    }
    true
}

fn truth(text: &str) -> Option<i64> {
    match text.to_ascii_lowercase().as_str() {
        "true" | "on" => Some(1),
        "false" | "off" => Some(0),
        _ => text.parse::<i64>().ok(),
    }
}

/// Appends a number; a column becomes one of floats with its first fraction.
pub(super) fn push(column: &mut Column, number: Number) {
    match (&mut *column, number) {
        (Column::Int(values), Number::Int(value)) => values.push(value),
        (Column::Int(values), Number::Float(value)) => {
            let mut floats: Vec<f64> = values.iter().map(|value| *value as f64).collect();
            floats.push(value);
            *column = Column::Float(floats);
        }
        (Column::Float(values), Number::Int(value)) => values.push(value as f64),
        (Column::Float(values), Number::Float(value)) => values.push(value),
    }
}
