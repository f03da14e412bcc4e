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
    if !(1..=MAX_DIGITS).contains(&digits.len()) {
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

/// The most digits that cannot overflow 64 bits.
const MAX_DIGITS: usize = 18;

/// Largest whole number up to which all are exact: the quotient of one by a power of ten up to 22 is
/// the number nearest to the decimal (Clinger 1990).
const MAX_EXACT: i64 = 1 << f64::MANTISSA_DIGITS;

/// Parses a line of plain numbers, several times faster than cell by cell, and gives what follows
/// it; none where a cell is anything else.
pub(super) fn parse_plain_row<'a>(
    lines: &'a [u8],
    separator: Separator,
    row: &mut Vec<Number>,
) -> Option<&'a [u8]> {
    row.clear();
    let mut rest = lines;
    loop {
        let (number, behind) = plain_number(without_blanks(rest))?;
        row.push(number);
        rest = without_blanks(behind);
        rest = match rest {
            [b'\n', next @ ..] | [b'\r', b'\n', next @ ..] => return Some(next),
            [] => return Some(rest),
            _ if separator == Separator::Blanks && rest.len() < behind.len() => rest,
            [byte, cell @ ..] if *byte == separator.byte() => cell,
            _ => return None,
        };
    }
}

fn without_blanks(mut bytes: &[u8]) -> &[u8] {
    while let [b' ', rest @ ..] = bytes {
        bytes = rest;
    }
    bytes
}

/// The number of digits, with a sign and a decimal point or without, at the beginning.
fn plain_number(bytes: &[u8]) -> Option<(Number, &[u8])> {
    const POWERS: [f64; MAX_DIGITS + 1] = [
        1.0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15, 1e16,
        1e17, 1e18,
    ];
    let unsigned = bytes.strip_prefix(b"-").unwrap_or(bytes);
    let is_negative = unsigned.len() < bytes.len();
    let (whole, rest) = digits(0, unsigned);
    let n_whole = unsigned.len() - rest.len();
    let [b'.', fraction @ ..] = rest else {
        let signed = if is_negative { whole.wrapping_neg() } else { whole };
        return (1..=MAX_DIGITS).contains(&n_whole).then_some((Number::Int(signed), rest));
    };
    let (value, rest) = digits(whole, fraction);
    let n_behind = fraction.len() - rest.len();
    let is_exact = (1..=MAX_DIGITS).contains(&(n_whole + n_behind)) && value <= MAX_EXACT;
    let magnitude = value as f64 / POWERS.get(n_behind)?;
    let signed = if is_negative { -magnitude } else { magnitude };
    is_exact.then_some((Number::Float(signed), rest))
}

/// Appends the digits at the beginning to a value, which is wrong where they are more than 18.
fn digits(mut value: i64, mut bytes: &[u8]) -> (i64, &[u8]) {
    while let [digit @ b'0'..=b'9', rest @ ..] = bytes {
        value = value.wrapping_mul(10).wrapping_add(i64::from(digit - b'0'));
        bytes = rest;
    }
    (value, bytes)
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
    match (column, number) {
        (Column::Short(values), Number::Int(value)) if i64::from(value as i16) == value => {
            values.push(value as i16);
        }
        (Column::Int(values), Number::Int(value)) => values.push(value),
        (Column::Float(values), Number::Float(value)) => values.push(value),
        (column, Number::Int(value)) => column.extend_integers(std::iter::once(value)),
        (column, Number::Float(value)) => column.extend_floats(std::iter::once(value)),
    }
}
