//! Heat maps of the misfit of baseline and corrected model.

use crate::figure::{Figure, FileLink, Panel};
use crate::number::significant;
use crate::page::SectionBlock;
use crate::plot::chart::ChartAxis;
use crate::plot::grid::{Colours, FirstRow, HeatGrid, draw};
use evrig_analysis::diagnose::{HeatMap, HeatValue};
use evrig_core::geometry::Size;

/// Text of a map's axis.
struct AxisText {
    title: &'static str,
    label: &'static str,
    /// Whether cells are equally wide; otherwise the caption lists their edges.
    is_even: bool,
}

fn words(key: &str) -> AxisText {
    let (title, label, is_even) = match key {
        "column" => ("column", "column (px)", true),
        "row" => ("row", "row (px)", true),
        "time_s" => ("time", "time (s)", true),
        "interval_us" => {
            ("time since the last event", "time since the pixel's last event (sextiles)", false)
        }
        "contrast_rate_per_s" => {
            ("rate of change of the signal", "rate of change of log intensity (sextiles)", false)
        }
        _ => ("another quantity", "cell", false),
    };
    AxisText { title, label, is_even }
}

fn axis(key: &str, edges: &[f64]) -> ChartAxis {
    let AxisText { label, is_even, .. } = words(key);
    match edges {
        [first, .., last] if is_even => ChartAxis::linear(label).over(*first, *last),
        _ => ChartAxis::linear(label).over(0.0, edges.len().saturating_sub(1) as f64),
    }
}

/// Figures of the maps for the baseline and, with effects, the corrected model.
pub(super) fn blocks(maps: &[HeatMap], is_corrected: bool) -> Vec<SectionBlock> {
    let link = || FileLink::beside("derived/diagnose/heat.json");
    let figures = maps.iter().filter_map(|map| figure(map, is_corrected));
    figures.map(|figure| SectionBlock::Figure(figure.with_data(link()))).collect()
}

fn figure(map: &HeatMap, is_corrected: bool) -> Option<Figure> {
    let values = map
        .values
        .each_ref()
        .map(|values| values.iter().map(|value| value.unwrap_or(f64::NAN)).collect::<Vec<f64>>());
    let (limit, label, caption) = match map.value {
        HeatValue::Surplus => (
            8.0,
            "(real - expected) / sqrt(expected) events",
            "Orange: more events than the model predicts given the past; blue: fewer. Values \
             within ±3 are not significant.",
        ),
        HeatValue::Innovation => (
            0.3,
            "mean change of the signal beyond the threshold (thresholds)",
            "Orange: events are late; blue: early, in thresholds.",
        ),
    };
    let cells = map.edges.each_ref().map(|edges| edges.len().saturating_sub(1) as u16);
    let titles = ["Without the named effects", "With them"];
    let panel = |(title, values): (&str, &Vec<f64>)| {
        let grid = HeatGrid {
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
            alt: format!("Map of the misfit, {title}; the largest value is {worst:.2}."),
            drawing: draw(&grid).ok()?,
        })
    };
    let n = if is_corrected { 2 } else { 1 };
    let panels: Option<Vec<Panel>> = titles.into_iter().zip(&values).take(n).map(panel).collect();
    let range = |key: &str, edges: &[f64]| {
        // Times since an event are in microseconds.
        let scale = if key == "interval_us" { 1e-3 } else { 1.0 };
        let unit = if key == "interval_us" { "ms" } else { "per second" };
        let edges: Vec<String> = edges.iter().map(|edge| significant(edge * scale, 3)).collect();
        let AxisText { title, is_even, .. } = words(key);
        (!is_even).then(|| format!(" Limits of the {title}: {} {unit}.", edges.join(", ")))
    };
    let edges: String =
        map.axes.iter().zip(&map.edges).filter_map(|(key, edges)| range(key, edges)).collect();
    Some(Figure {
        title: format!(
            "Misfit by {}",
            map.axes.each_ref().map(|key| words(key).title).join(" and ")
        ),
        caption: format!("{caption} Empty: too few events.{edges}"),
        legend: Vec::new(),
        panels: panels?,
        data: None,
    })
}
