//! Labelled horizontal bars from zero, for half the page's width.

use super::svg::{Anchor, Area, Canvas};
use super::{Drawing, Ink};
use crate::number::significant;

/// One bar.
#[derive(Debug, Clone, PartialEq)]
pub struct LabelledBar {
    /// Label, in lines of text above the bar.
    pub label: String,
    /// Length.
    pub value: f64,
    /// Ink.
    pub ink: Ink,
}

const WIDTH: f64 = 460.0;
const BAR_HEIGHT: f64 = 14.0;
const LINE_HEIGHT: f64 = 16.0;
/// Room for the value behind the longest bar.
const VALUE_WIDTH: f64 = 58.0;
/// Letters that fit on a line of [`WIDTH`] at the text size of the axes.
const MAX_LETTERS: usize = 66;

/// Draws bars on a common scale; values below zero have no length.
#[must_use]
pub fn draw(bars: &[LabelledBar]) -> Drawing {
    let longest = bars.iter().map(|bar| bar.value).fold(f64::MIN_POSITIVE, f64::max);
    let labels: Vec<Vec<String>> = bars.iter().map(|bar| lines(&bar.label)).collect();
    let height = |lines: &Vec<String>| lines.len() as f64 * LINE_HEIGHT + BAR_HEIGHT + 14.0;
    let mut canvas = Canvas::new(WIDTH, labels.iter().map(height).sum::<f64>() + 4.0);
    let mut y = 4.0;
    for (bar, lines) in bars.iter().zip(&labels) {
        for line in lines {
            y += LINE_HEIGHT;
            canvas.text("row-label", [0.0, y - 5.0], Anchor::Start, line);
        }
        let length = (bar.value / longest).clamp(0.0, 1.0) * (WIDTH - VALUE_WIDTH);
        let area = Area { x: 0.0, y, w: length.max(1.0), h: BAR_HEIGHT };
        canvas.rect(&format!("bar {}", bar.ink.class()), area);
        let behind = [area.right() + 8.0, y + BAR_HEIGHT - 3.0];
        canvas.text("row-value num", behind, Anchor::Start, &significant(bar.value, 2));
        y += BAR_HEIGHT + 14.0;
    }
    Drawing::single(canvas.finish())
}

/// A text in lines that fit.
fn lines(text: &str) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        match lines.last_mut() {
            Some(line) if line.chars().count() + word.chars().count() < MAX_LETTERS => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_longest_bar_fills_the_width_and_a_negative_value_has_no_length() {
        let bar = |value| LabelledBar { label: "gain".into(), value, ink: Ink::Real };
        let drawn = draw(&[bar(0.4), bar(0.1), bar(-1.0)]);
        let svg = drawn.wide();
        assert!(svg.contains("width=\"402\"") && svg.contains("width=\"100.5\""), "{svg}");
        assert!(svg.contains("width=\"1\"") && svg.contains(">\u{2212}1.0<"), "{svg}");
    }

    #[test]
    fn a_long_label_is_broken_between_words() {
        let text = "events of equal polarity to the pixel's last one come 0.31 thresholds late";
        let lines = lines(text);
        assert_eq!(lines.len(), 2);
        assert_eq!(lines.join(" "), text);
    }
}
