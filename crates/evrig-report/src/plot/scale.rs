//! Scales from data values to drawing coordinates, with ticks.

/// Linear or logarithmic.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ScaleKind {
    /// Linear.
    Linear,
    /// Logarithmic; values above 0.
    Log,
}

/// A map of the data interval onto the drawing interval.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxisScale {
    kind: ScaleKind,
    data: [f64; 2],
    paper: [f64; 2],
    is_turned: bool,
}

/// A tick; a minor one has no label.
#[derive(Debug, Clone, PartialEq)]
pub struct Tick {
    /// In data units.
    pub value: f64,
    /// Label; empty for a minor tick.
    pub label: String,
}

impl AxisScale {
    /// A scale over a data interval, which is widened where empty or invalid.
    #[must_use]
    pub fn new(kind: ScaleKind, data: [f64; 2], paper: [f64; 2]) -> Self {
        Self { kind, data: drawable(kind, data), paper, is_turned: false }
    }

    /// The data interval that is drawn.
    #[must_use]
    pub fn data(&self) -> [f64; 2] {
        self.data
    }

    /// The same scale with the drawing interval reversed.
    #[must_use]
    pub fn turned(self) -> Self {
        Self { paper: [self.paper[1], self.paper[0]], is_turned: !self.is_turned, ..self }
    }

    /// Position of a value in the drawing; NaN where undefined (0 on a log scale).
    #[must_use]
    pub fn position(&self, value: f64) -> f64 {
        let [low, high] = self.data.map(|v| self.bend(v));
        let share = (self.bend(value) - low) / (high - low);
        self.paper[0] + share * (self.paper[1] - self.paper[0])
    }

    fn bend(&self, value: f64) -> f64 {
        match self.kind {
            ScaleKind::Linear => value,
            ScaleKind::Log if value > 0.0 => value.log10(),
            ScaleKind::Log => f64::NAN,
        }
    }

    /// Ticks in ascending order, at most about `max_labels` of them labelled.
    #[must_use]
    pub fn ticks(&self, max_labels: usize) -> Vec<Tick> {
        let max_labels = max_labels.max(2);
        match self.kind {
            ScaleKind::Linear => linear_ticks(self.data, max_labels),
            ScaleKind::Log => log_ticks(self.data, max_labels),
        }
    }

    /// The scale for the page's script: kind, then the data interval from left to right or upwards.
    #[must_use]
    pub fn describe(&self) -> String {
        let kind = match self.kind {
            ScaleKind::Linear => "lin",
            ScaleKind::Log => "log",
        };
        let [from, to] = if self.is_turned { [self.data[1], self.data[0]] } else { self.data };
        format!("{kind} {from:e} {to:e}")
    }
}

fn drawable(kind: ScaleKind, [low, high]: [f64; 2]) -> [f64; 2] {
    let finite = low.is_finite() && high.is_finite();
    match kind {
        ScaleKind::Linear if finite && high > low => [low, high],
        ScaleKind::Linear if finite => {
            let half = if low == 0.0 { 1.0 } else { low.abs() * 0.5 };
            [low - half, low + half]
        }
        ScaleKind::Log if finite && low > 0.0 && high > low => [low, high],
        ScaleKind::Log if finite && low > 0.0 => [low / 3.0, low * 3.0],
        ScaleKind::Linear => [0.0, 1.0],
        ScaleKind::Log => [1.0, 10.0],
    }
}

/// The smallest of 1, 2, 5 times a power of ten that cuts `span` into at most `n` parts.
fn step(span: f64, n: usize) -> f64 {
    let rough = span / n as f64;
    let magnitude = 10_f64.powf(rough.log10().floor());
    let digit = rough / magnitude;
    let round = [1.0, 2.0, 5.0].into_iter().find(|d| digit <= *d + 1e-9).unwrap_or(10.0);
    round * magnitude
}

fn linear_ticks([low, high]: [f64; 2], max_labels: usize) -> Vec<Tick> {
    let step = step(high - low, max_labels);
    let decimals = (-step.log10().floor()).max(0.0) as usize;
    let first = (low / step - 1e-6).ceil() as i64;
    let last = (high / step + 1e-6).floor() as i64;
    (first..=last)
        .map(|i| {
            let value = i as f64 * step;
            Tick { value, label: plain(value, decimals) }
        })
        .collect()
}

fn log_ticks([low, high]: [f64; 2], max_labels: usize) -> Vec<Tick> {
    let first = low.log10().floor() as i32;
    let last = high.log10().ceil() as i32;
    let n_decades = (last - first).max(1) as usize;
    let labelled: &[u8] = match high / low {
        ratio if ratio < 6.0 => &[1, 2, 3, 4, 5, 6, 7, 8, 9],
        ratio if ratio < 60.0 => &[1, 2, 5],
        _ => &[1],
    };
    let every = n_decades.div_ceil(max_labels).max(1) as i32;
    let mut ticks = Vec::new();
    for exponent in first..=last {
        for digit in 1..=9_u8 {
            let value = f64::from(digit) * 10_f64.powi(exponent);
            if value < low * (1.0 - 1e-9) || value > high * (1.0 + 1e-9) {
                continue;
            }
            let has_label = labelled.contains(&digit) && exponent.rem_euclid(every) == 0;
            let label = if has_label { power_label(digit, exponent) } else { String::new() };
            ticks.push(Tick { value, label });
        }
    }
    ticks
}

/// Plain digits near one, a power of ten elsewhere.
fn power_label(digit: u8, exponent: i32) -> String {
    if (-2..=3).contains(&exponent) {
        return plain(f64::from(digit) * 10_f64.powi(exponent), (-exponent).max(0) as usize);
    }
    let power = format!("10{}", superscript(exponent));
    if digit == 1 { power } else { format!("{digit}·{power}") }
}

/// An integer in superscript digits.
#[must_use]
pub fn superscript(n: i32) -> String {
    let raise = |c: char| match c {
        '-' => '⁻',
        '1' => '¹',
        '2' => '²',
        '3' => '³',
        '4'..='9' => char::from_u32('⁴' as u32 + (c as u32 - '4' as u32)).unwrap_or(c),
        _ => '⁰',
    };
    n.to_string().chars().map(raise).collect()
}

/// Fixed decimals, a true minus sign, thousands grouped by thin spaces.
#[must_use]
pub fn plain(value: f64, decimals: usize) -> String {
    let text = format!("{:.decimals$}", value.abs());
    let (whole, fraction) = text.split_once('.').unwrap_or((&text, ""));
    let is_zero = text.chars().all(|c| c == '0' || c == '.');
    let mut grouped = String::new();
    if value < 0.0 && !is_zero {
        grouped.push('−');
    }
    for (i, c) in whole.chars().enumerate() {
        if i > 0 && whole.len() > 4 && (whole.len() - i).is_multiple_of(3) {
            grouped.push('\u{202f}');
        }
        grouped.push(c);
    }
    if !fraction.is_empty() {
        grouped.push('.');
        grouped.push_str(fraction);
    }
    grouped
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn labels(scale: AxisScale, n: usize) -> Vec<String> {
        scale.ticks(n).into_iter().map(|t| t.label).filter(|l| !l.is_empty()).collect()
    }

    #[test]
    fn ticks_are_round_numbers_inside_the_interval() {
        let scale = AxisScale::new(ScaleKind::Linear, [0.0, 1.03], [0.0, 100.0]);
        assert_eq!(labels(scale, 6), ["0.0", "0.2", "0.4", "0.6", "0.8", "1.0"]);
        let scale = AxisScale::new(ScaleKind::Linear, [-12_000.0, 31_000.0], [0.0, 100.0]);
        assert_eq!(
            labels(scale, 5),
            ["−10\u{202f}000", "0", "10\u{202f}000", "20\u{202f}000", "30\u{202f}000"]
        );
    }

    #[test]
    fn decades_are_labelled_as_powers_far_from_one() {
        let scale = AxisScale::new(ScaleKind::Log, [1e-5, 2e-1], [0.0, 100.0]);
        assert_eq!(labels(scale, 6), ["10⁻⁵", "10⁻⁴", "10⁻³", "0.01", "0.1"]);
        assert_eq!(superscript(-20), "⁻²⁰");
    }

    #[test]
    fn a_decade_is_as_long_as_the_next() {
        let scale = AxisScale::new(ScaleKind::Log, [1.0, 100.0], [0.0, 200.0]);
        assert!((scale.position(10.0) - 100.0).abs() < 1e-9);
        assert!(scale.position(0.0).is_nan(), "zero has no place on a log scale");
    }

    /// Any sign and size that a plot may meet, and the values that are no numbers.
    fn value() -> impl Strategy<Value = f64> {
        prop_oneof![
            8 => (-1.0..1.0_f64, -90..90_i32).prop_map(|(v, e)| v * 10_f64.powi(e)),
            1 => prop::sample::select(vec![0.0, f64::NAN, f64::INFINITY, f64::NEG_INFINITY]),
        ]
    }

    proptest! {
        #[test]
        fn any_interval_can_be_drawn_with_few_ticks(a in value(), b in value(), is_log: bool) {
            let kind = if is_log { ScaleKind::Log } else { ScaleKind::Linear };
            let scale = AxisScale::new(kind, [a, b], [0.0, 10.0]);
            let ticks = scale.ticks(6);
            prop_assert!(ticks.iter().filter(|t| !t.label.is_empty()).count() <= 12);
            prop_assert!(scale.position(scale.data()[1]).is_finite());
        }
    }
}
