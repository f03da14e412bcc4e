//! Checks of a header before the crate `npyz` parses it.
//!
//! Its parser backtracks at brackets, so that a header of some hundred bytes of nested
//! brackets would not terminate in practice; it trusts a header's length, and multiplies the sides
//! of a shape without an overflow check.

use npyz::NpyHeader;
use std::io::{Error, ErrorKind, Read};

/// Arrays of records of numbers, the most that is read here, have brackets in brackets in braces.
const MAX_BRACKET_DEPTH: usize = 6;

/// A header of a thousand fields is shorter.
const MAX_HEADER_BYTES: usize = 1 << 18;

/// Reads a header and leaves the reader at the data.
///
/// # Errors
/// When the reader ends before, or this is no header of an array of numbers.
pub(super) fn read_header(reader: &mut impl Read) -> Result<NpyHeader, Error> {
    let mut header = [0; 8].to_vec();
    reader.read_exact(&mut header)?;
    if !header.starts_with(b"\x93NUMPY") {
        return Err(wrong("it does not begin as one"));
    }
    let at_text = if header[6] == 1 { 10 } else { 12 };
    header.resize(at_text, 0);
    reader.read_exact(&mut header[8..])?;
    let n_bytes = header[8..].iter().rev().fold(0, |n, byte| (n << 8) | usize::from(*byte));
    if n_bytes > MAX_HEADER_BYTES {
        return Err(wrong(&format!("its header would have {n_bytes} bytes")));
    }
    header.resize(at_text + n_bytes, 0);
    reader.read_exact(&mut header[at_text..])?;
    if nested(&header[at_text..]) > MAX_BRACKET_DEPTH {
        return Err(wrong("its header has more brackets in brackets than one of plain numbers"));
    }
    if !is_countable(&header[at_text..]) {
        return Err(wrong("its shape has more elements than can be counted"));
    }
    if let Some(text) = without_titles(&header[at_text..]) {
        header.truncate(at_text);
        header.extend(text);
    }
    NpyHeader::from_reader(header.as_slice())
}

/// The header's text with `('name', type)` for each `(('title', 'name'), type)`, which the crate
/// does not parse, padded to the same length. None where there is no title.
fn without_titles(text: &[u8]) -> Option<Vec<u8>> {
    let text = std::str::from_utf8(text).ok().filter(|text| text.contains("(("))?;
    let n_bytes = text.len();
    let mut plain = String::with_capacity(n_bytes);
    let mut rest = text;
    while let Some((before, titled)) = rest.split_once("((") {
        let (pair, behind) = titled.split_once(')')?;
        let (_title, name) = pair.split_once(',')?;
        plain.push_str(before);
        plain.push('(');
        plain.push_str(name.trim());
        rest = behind;
    }
    plain.push_str(rest.trim_end());
    let n_blanks = n_bytes.saturating_sub(plain.len() + 1);
    plain.extend(std::iter::repeat_n(' ', n_blanks));
    plain.push('\n');
    Some(plain.into_bytes())
}

/// How many brackets are open at most.
fn nested(text: &[u8]) -> usize {
    let mut open = 0_usize;
    let depths = text.iter().map(|byte| {
        match byte {
            b'(' | b'[' | b'{' => open += 1,
            b')' | b']' | b'}' => open = open.saturating_sub(1),
            _ => {}
        }
        open
    });
    depths.max().unwrap_or(0)
}

/// Whether the product of the numbers from the shape on is one.
fn is_countable(text: &[u8]) -> bool {
    let key = b"shape";
    let at = text.windows(key.len()).position(|word| word == key).unwrap_or(0);
    let numbers =
        text[at..].split(|byte| !byte.is_ascii_digit()).filter(|digits| !digits.is_empty());
    let mut values = numbers.map(|digits| str::from_utf8(digits).ok()?.parse::<u64>().ok());
    values.try_fold(1_u64, |product, value| product.checked_mul(value?)).is_some()
}

fn wrong(what: &str) -> Error {
    Error::new(ErrorKind::InvalidData, what)
}
