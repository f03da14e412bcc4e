//! Heat maps of where the baseline is wrong, beside what the named effects leave.

use crate::figure::{Figure, Link, Panel};
use crate::page::Block;
use crate::plot::chart::Axis;
use crate::plot::grid::{Colours, FirstRow, Grid, draw};
use evrig_analysis::diagnose::{HeatMap, HeatValue};
use evrig_core::geometry::Size;

/// An axis of a map in words.
struct Words {
    title: &'static str,
    label: &'static str,
    /// Whether cells are equally wide; else they are counted and their edges stand in the caption.
    is_even: bool,
}

/// The words for a covariate.
fn words(key: &str) -> Words {
    let (title, label, is_even) = match key {
        "column" => ("column", "column (px)", true),
        "row" => ("row", "row (px)", true),
        "time_s" => ("time", "time (s)", true),
        "interval_us" => (
            "the time since the last event",
            "time since the pixel's last event, sixths of the events",
            false,
        ),
        "contrast_rate_per_s" => (
            "the speed of the light",
            "speed of the light's logarithm, sixths of the events",
            false,
        ),
        _ => ("another quantity", "cell", false),
    };
    Words { title, label, is_even }
}

fn axis(key: &str, edges: &[f64]) -> Axis {
    let Words { label, is_even, .. } = words(key);
    match edges {
        [first, .., last] if is_even => Axis::linear(label).over(*first, *last),
        _ => Axis::linear(label).over(0.0, edges.len().saturating_sub(1) as f64),
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
            first_row: if map.axes[1] == "row" { FirstRow::Top } else { FirstRow::Bottom },
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
        let told: Vec<String> = edges.iter().map(|edge| format!("{edge:.3}")).collect();
        (!words(key).is_even).then(|| format!(" Edges of {key}: {}.", told.join(", ")))
    };
    let edges: String =
        map.axes.iter().zip(&map.edges).filter_map(|(key, edges)| range(key, edges)).collect();
    Some(Figure {
        title: format!(
            "Where it is wrong, by {}",
            map.axes.each_ref().map(|key| words(key).title).join(" and ")
        ),
        caption: format!("{caption} Empty: too few events.{edges}"),
        legend: Vec::new(),
        panels: panels?,
        data: None,
    })
}
