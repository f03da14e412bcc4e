//! Values relative to their healthy ranges: an overview of all measures, and a strip per row.

use super::Drawing;
use super::svg::{Anchor, Area, Canvas};
use crate::figure::{Figure, Panel};
use crate::measure::{MeasureRow, MeasureVerdict};
use crate::number::quantity;

/// Range of the strips, in tolerances; beyond it an arrow is drawn.
const REACH: f64 = 3.0;
const ROW: f64 = 30.0;

/// All measures with a range on a common scale of tolerances.
#[must_use]
pub fn departures_figure(measures: &[MeasureRow]) -> Figure {
    let judged: Vec<&MeasureRow> = measures.iter().filter(|m| m.healthy.is_some()).collect();
    let values: Vec<String> = judged
        .iter()
        .map(|m| format!("{} {} ({})", m.name, quantity(&m.estimate), m.verdict().word()))
        .collect();
    Figure {
        title: "Similarity of recorded and generated events".to_owned(),
        caption: "Measures with 90\u{a0}% intervals, in healthy tolerances: 0 is identical, the \
            shaded range is healthy; ratios are on a log scale, distances are positive. Filled \
            circle: healthy; ring: borderline; diamond: outside."
            .to_owned(),
        legend: vec![],
        panels: vec![Panel {
            title: "Departure in healthy tolerances".to_owned(),
            note: String::new(),
            alt: format!("Departures from identical. {}.", values.join("; ")),
            drawing: Drawing::responsive(wide_overview(&judged), narrow_overview(&judged)),
        }],
        data: None,
    }
}

/// Names to the left, values to the right.
fn wide_overview(measures: &[&MeasureRow]) -> String {
    const WIDTH: f64 = 600.0;
    let rows = ROW * measures.len().max(1) as f64;
    let area = Area { x: 196.0, y: 2.0, w: WIDTH - 196.0 - 128.0, h: rows };
    let mut canvas = Canvas::new(WIDTH, rows + 46.0);
    draw_ground(&mut canvas, area);
    draw_axis(&mut canvas, area);
    for (i, measure) in measures.iter().enumerate() {
        let y = area.y + ROW * (i as f64 + 0.5);
        canvas.text("row-label", [area.x - 12.0, y + 4.0], Anchor::End, &fit(&measure.name, 182.0));
        let value = [area.right() + 12.0, y + 4.0];
        canvas.text(
            "row-value num",
            value,
            Anchor::Start,
            &quantity(&measure.estimate).to_string(),
        );
        draw_value(&mut canvas, area, y, measure);
    }
    canvas.finish()
}

/// Name and value above each strip.
fn narrow_overview(measures: &[&MeasureRow]) -> String {
    const WIDTH: f64 = 352.0;
    const TALL_ROW: f64 = 46.0;
    let rows = TALL_ROW * measures.len().max(1) as f64;
    let mut canvas = Canvas::new(WIDTH, rows + 46.0);
    let strip = |i: usize| Area { x: 1.0, y: TALL_ROW * i as f64 + 20.0, w: WIDTH - 2.0, h: 18.0 };
    for (i, measure) in measures.iter().enumerate() {
        let area = strip(i);
        draw_ground(&mut canvas, area);
        let value = quantity(&measure.estimate).to_string();
        canvas.text("row-label", [area.x, area.y - 6.0], Anchor::Start, &fit(&measure.name, 220.0));
        canvas.text("row-value num", [area.right(), area.y - 6.0], Anchor::End, &value);
        draw_value(&mut canvas, area, area.y + area.h / 2.0, measure);
    }
    draw_axis(&mut canvas, strip(measures.len().saturating_sub(1)));
    canvas.finish()
}

fn draw_axis(canvas: &mut Canvas, area: Area) {
    for (at, label) in [(-2.0, "−2"), (-1.0, "−1"), (0.0, "0"), (1.0, "1"), (2.0, "2")] {
        let x = position(at, area);
        canvas.line("tick", [x, area.bottom()], [x, area.bottom() + 4.0]);
        canvas.text("tick-label num", [x, area.bottom() + 17.0], Anchor::Middle, label);
    }
    let below = area.bottom() + 36.0;
    canvas.text("axis-label", [area.x, below], Anchor::Start, "← less");
    canvas.text("axis-label", [position(0.0, area), below], Anchor::Middle, "identical");
    canvas.text("axis-label", [area.right(), below], Anchor::End, "more →");
}

/// The strip in one row of the table.
#[must_use]
pub fn row(measure: &MeasureRow) -> Drawing {
    let mut canvas = Canvas::new(150.0, 22.0);
    let area = Area { x: 2.0, y: 3.0, w: 146.0, h: 16.0 };
    if measure.healthy.is_some() {
        draw_ground(&mut canvas, area);
        draw_value(&mut canvas, area, 11.0, measure);
    }
    Drawing::single(canvas.finish())
}

fn position(departure: f64, area: Area) -> f64 {
    area.x + area.w * (departure / REACH + 1.0) / 2.0
}

fn draw_ground(canvas: &mut Canvas, area: Area) {
    let (left, right) = (position(-1.0, area), position(1.0, area));
    canvas.rect("strip", area);
    canvas.rect("strip-healthy", Area { x: left, w: right - left, ..area });
    let middle = position(0.0, area);
    canvas.line("strip-middle", [middle, area.y], [middle, area.bottom()]);
}

fn draw_value(canvas: &mut Canvas, area: Area, y: f64, measure: &MeasureRow) {
    let verdict = measure.verdict();
    let departure = measure.departure(measure.estimate.value);
    if departure.is_nan() || verdict == MeasureVerdict::Unknown {
        canvas.text("nothing", [position(0.0, area), y + 4.0], Anchor::Middle, "unknown");
        return;
    }
    let class = verdict.class();
    let [low, high] = measure.interval().map(|v| {
        let d = measure.departure(v);
        position(if d.is_nan() { departure } else { d }.clamp(-REACH, REACH), area)
    });
    canvas.line(&format!("whisker {class}"), [low, y], [high, y]);
    let x = position(departure.clamp(-REACH, REACH), area);
    if departure.abs() > REACH {
        let tip = if departure > 0.0 { x - 1.0 } else { x + 1.0 };
        let back = if departure > 0.0 { tip - 10.0 } else { tip + 10.0 };
        let class = format!("mark {class}");
        canvas.polygon(&class, [[tip, y], [back, y - 5.5], [back, y + 5.5]]);
        return;
    }
    match verdict {
        MeasureVerdict::Outside => {
            let class = format!("mark {class}");
            canvas.polygon(&class, [[x, y - 6.0], [x + 6.0, y], [x, y + 6.0], [x - 6.0, y]]);
        }
        MeasureVerdict::Borderline => canvas.circle(&format!("mark hollow {class}"), [x, y], 4.5),
        _ => canvas.circle(&format!("mark {class}"), [x, y], 5.0),
    }
}

/// The name, truncated to a width (a letter is about 6.6 units wide).
fn fit(name: &str, width: f64) -> String {
    let max_letters = (width / 6.6) as usize;
    if name.chars().count() <= max_letters {
        return name.to_owned();
    }
    let kept: String = name.chars().take(max_letters.saturating_sub(1)).collect();
    format!("{}…", kept.trim_end())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measure::tests::measure;

    #[test]
    fn the_mark_shows_the_verdict_by_its_shape() {
        let range = Some([0.5, 2.0]);
        let healthy = row(&measure(1.0, 0.01, range));
        assert!(healthy.wide().contains("<circle class=\"mark is-healthy\""));
        let borderline = row(&measure(2.0, 0.1, range));
        assert!(borderline.wide().contains("mark hollow is-borderline"));
        let outside = row(&measure(2.5, 0.01, range));
        assert!(outside.wide().contains("<path class=\"mark is-outside\""));
    }

    #[test]
    fn a_value_far_off_stays_on_the_strip_as_an_arrow() {
        for value in [0.0, 1e-9, 1e9] {
            let svg = row(&measure(value, 1e-12, Some([0.5, 2.0])));
            assert!(!svg.wide().contains("inf") && !svg.wide().contains("NaN"), "{}", svg.wide());
            assert!(svg.wide().contains("mark is-outside"));
        }
    }

    #[test]
    fn a_measure_without_range_leaves_its_strip_empty() {
        assert!(!row(&measure(1.0, 0.1, None)).wide().contains("strip"));
    }
}
