//! The table of measures as plain text.

use super::measure::{MeasureRow, headline};
use super::number::quantity;
use std::fmt::Write;

const GAP: &str = "  ";

/// The headline and one aligned row per measure, without colour.
#[must_use]
pub fn measures(measures: &[MeasureRow]) -> String {
    let heads = ["", "measure", "value", "± error", "healthy", "verdict"].map(str::to_owned);
    let rows = measures.iter().map(|measure| {
        let shown = quantity(&measure.estimate);
        let error =
            if shown.error.is_empty() { String::new() } else { format!("± {}", shown.error) };
        let unit =
            if measure.unit.is_empty() { String::new() } else { format!(" {}", measure.unit) };
        [
            measure.verdict().mark().to_owned(),
            measure.name.clone(),
            shown.value,
            format!("{error}{unit}"),
            measure.range_text(),
            measure.verdict().word().to_owned(),
        ]
    });
    let rows: Vec<[String; 6]> = std::iter::once(heads).chain(rows).collect();
    let widths: [usize; 6] =
        std::array::from_fn(|i| rows.iter().map(|row| width(&row[i])).max().unwrap_or(0));
    let mut text = String::new();
    for row in &rows {
        let mut line = String::new();
        for (i, cell) in row.iter().enumerate() {
            let air = " ".repeat(widths[i] - width(cell));
            let cell = clean(cell);
            let _ = if i == 2 {
                write!(line, "{air}{cell}{GAP}")
            } else {
                write!(line, "{cell}{air}{GAP}")
            };
        }
        let _ = writeln!(text, "{}", line.trim_end());
    }
    format!("{}\n\n{text}", clean(&headline(measures)))
}

fn width(text: &str) -> usize {
    text.chars().count()
}

/// Replaces control characters, which could move the cursor or change colours.
fn clean(text: &str) -> String {
    text.chars().map(|c| if c.is_control() { '\u{fffd}' } else { c }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measure::tests::measure;

    #[test]
    fn columns_line_up_and_control_characters_do_not_reach_the_terminal() {
        let mut odd = measure(0.004, 0.000_31, None);
        odd.name = "Odd\u{1b}[31m".into();
        odd.unit = "px".into();
        let text = measures(&[measure(1.313, 0.021, Some([0.5, 2.0])), odd]);
        assert!(!text.contains('\u{1b}'));
        let lines: Vec<&str> = text.lines().skip(2).collect();
        assert_eq!(lines[0], "   measure              value  ± error       healthy   verdict");
        assert_eq!(lines[1], "✓  Event count ratio    1.313  ± 0.021       0.5 to 2  healthy");
        assert_eq!(
            lines[2],
            "·  Odd\u{fffd}[31m           0.00400  ± 0.00031 px            no range"
        );
    }
}
