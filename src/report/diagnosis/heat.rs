//! Heat maps of where the baseline is wrong, beside what the named effects leave.

use crate::diagnose::{HeatMap, HeatValue};
use crate::geometry::Size;
use crate::report::figure::{Figure, Link, Panel};
use crate::report::page::Block;
use crate::report::plot::chart::Axis;
use crate::report::plot::grid::{Colours, Grid, draw};

/// How an axis is called, and by what its edges are to be multiplied for that.
fn axis_words(key: &str) -> (&str, f64) {
    match key {
        "column" => ("column (px)", 1.0),
        "row" => ("row (px)", 1.0),
        "time_s" => ("time (s)", 1.0),
        "interval_us" => ("time since the pixel's last event, sixths of the events", 0.0),
        "contrast_rate_per_s" => ("speed of the light's logarithm, sixths of the events", 0.0),
        other => (other, 1.0),
    }
}

/// An axis in a title.
fn short(key: &str) -> &str {
    match key {
        "time_s" => "time",
        "interval_us" => "the time since the last event",
        "contrast_rate_per_s" => "the speed of the light",
        other => other,
    }
}

/// The axis of a map. Edges that are far from even are counted instead: the range stands in words.
fn axis(key: &str, edges: &[f64]) -> Axis {
    let (words, scale) = axis_words(key);
    let n = edges.len().saturating_sub(1) as f64;
    match (edges.first(), edges.last()) {
        (Some(first), Some(last)) if scale > 0.0 => {
            Axis::linear(words).over(first * scale, last * scale)
        }
        _ => Axis::linear(words).over(0.0, n),
    }
}

/// Figures of the maps, each with the baseline and, where something is named, the corrected model.
pub(super) fn blocks(maps: &[HeatMap], is_corrected: bool) -> Vec<Block> {
    let link = || Link::beside("derived/diagnose/heat.json");
    let figures = maps.iter().filter_map(|map| figure(map, is_corrected));
    figures.map(|figure| Block::Figure(figure.with_data(link()))).collect()
}

fn figure(map: &HeatMap, is_corrected: bool) -> Option<Figure> {
    let values = map
        .values
        .each_ref()
        .map(|values| values.iter().map(|value| value.unwrap_or(f64::NAN)).collect::<Vec<f64>>());
    let (limit, label, caption) = match map.value {
        HeatValue::Surplus => (
            8.0,
            "real minus expected events over the root of the expected",
            "Orange: more events came than the model expects, the past being known; blue: fewer. \
             Within 3 of either sign it may be chance.",
        ),
        HeatValue::Innovation => (
            0.3,
            "mean change of the light beyond the threshold (thresholds)",
            "Orange: events come late; blue: early, by so much of a threshold.",
        ),
    };
    let cells = map.edges.each_ref().map(|edges| edges.len().saturating_sub(1) as u16);
    let titles = ["Baseline", "Corrected"];
    let panel = |(title, values): (&str, &Vec<f64>)| {
        let grid = Grid {
            x: axis(&map.axes[0], &map.edges[0]),
            y: axis(&map.axes[1], &map.edges[1]),
            cells: Size::new(cells[0], cells[1]),
            values,
            colours: Colours::Diverging(limit),
            label: label.into(),
        };
        let worst = values.iter().filter(|v| v.is_finite()).fold(0.0, |w: f64, v| w.max(v.abs()));
        Some(Panel {
            title: title.into(),
            note: String::new(),
            alt: format!("Map of where the {title} model is wrong; the worst cell has {worst:.2}."),
            drawing: draw(&grid).ok()?,
        })
    };
    let n = if is_corrected { 2 } else { 1 };
    let panels: Option<Vec<Panel>> = titles.into_iter().zip(&values).take(n).map(panel).collect();
    let range = |key: &str, edges: &[f64]| {
        let (_, scale) = axis_words(key);
        let words: Vec<String> = edges.iter().map(|edge| format!("{edge:.3}")).collect();
        (scale <= 0.0).then(|| format!(" Edges of {key}: {}.", words.join(", ")))
    };
    let edges: String =
        map.axes.iter().zip(&map.edges).filter_map(|(key, edges)| range(key, edges)).collect();
    let upside = if map.axes[1] == "row" { " The first row lies at the bottom." } else { "" };
    Some(Figure {
        title: format!(
            "Where it is wrong, by {}",
            map.axes.each_ref().map(|k| short(k)).join(" and ")
        ),
        caption: format!("{caption} Empty: too few events.{upside}{edges}"),
        legend: Vec::new(),
        panels: panels?,
        data: None,
    })
}
