//! The generator let run by itself: camera, baseline and corrected model side by side.

use crate::figure::{Figure, Key, Link, Panel, Sample};
use crate::page::Block;
use crate::plot::Ink;
use crate::plot::chart::{Axis, Chart, Layer};
use crate::plot::heat::counts_panels;
use crate::table::{Cell, Column, Table};
use evrig_analysis::diagnose::{ForwardSimulation, ModelComparison};
use evrig_core::geometry::Size;

/// What the measures are: key, words, and the value of a model that is right.
const MEASURES: [(&str, &str, &str); 7] = [
    ("count_ratio", "events generated for each of the camera's", "1"),
    ("polarity_delta", "difference of the shares of On", "0"),
    ("interval_tv", "distance of the intervals' histograms (total variation)", "0"),
    ("rate_map_rmse", "difference of counts a pixel, over the mean count", "0"),
    ("spatial_emd", "earth mover's distance of the maps (px)", "0"),
    ("transport_px", "distance of the clouds in place, time and polarity (px)", "0"),
    ("c2st_accuracy", "share of events that trees tell from the camera's", "0.5"),
];

/// Tables and figures of a free run.
pub(super) fn blocks(run: &ForwardSimulation, is_corrected: bool) -> Vec<Block> {
    let link = || Link::beside("derived/diagnose/forward_simulation.json");
    let mut blocks = vec![Block::Table(measures(run, is_corrected))];
    if let Some(maps) = maps(run, is_corrected) {
        blocks.push(Block::Figure(maps.with_data(link())));
    }
    blocks.push(Block::Figure(intervals(run, is_corrected).with_data(link())));
    if !run.left_out.is_empty() {
        let words = run.left_out.join("; ");
        blocks.push(Block::Text(format!("The generator could not be told everything: {words}.")));
    }
    blocks
}

fn measures(run: &ForwardSimulation, is_corrected: bool) -> Table {
    let cell = |value: Option<f64>| value.map_or_else(|| Cell::text(""), Cell::number);
    let row = |(key, words, right): &(&str, &str, &str)| {
        let ModelComparison { baseline, r#final } = run.measures.get(*key)?;
        let mut row = vec![Cell::text(words), cell(*baseline)];
        if is_corrected {
            row.push(cell(*r#final));
        }
        row.push(Cell::text(right));
        Some(row)
    };
    let mut columns = vec![Column::text("measure"), Column::number("baseline", "")];
    if is_corrected {
        columns.push(Column::number("corrected", ""));
    }
    columns.push(Column::text("a right model"));
    let [x, y, w, h] = run.patch_px;
    Table {
        title: "Let run by itself".into(),
        caption: format!(
            "The generator from the same light, not told any event, against the camera: {w} by {h} \
             pixels from column {x}, row {y}. Nearly all of these pixels were in no fit."
        ),
        columns,
        rows: MEASURES.iter().filter_map(row).collect(),
    }
}

fn maps(run: &ForwardSimulation, is_corrected: bool) -> Option<Figure> {
    let [_, _, w, h] = run.patch_px;
    let titles = ["Real", "Baseline", "Corrected"];
    let n = if is_corrected { 3 } else { 2 };
    let maps: Vec<(String, &[u32])> = titles
        .iter()
        .zip(&run.counts)
        .take(n)
        .map(|(title, counts)| ((*title).to_owned(), counts.as_slice()))
        .collect();
    Some(Figure {
        title: "Events per pixel, real and generated".into(),
        caption: "One colour scale for all: equal colours are equal counts.".into(),
        legend: Vec::new(),
        panels: counts_panels(Size::new(w, h), &maps).ok()?,
        data: None,
    })
}

fn intervals(run: &ForwardSimulation, is_corrected: bool) -> Figure {
    let inks = [(Ink::Real, "real"), (Ink::Simulated, "baseline"), (Ink::Corrected, "corrected")];
    let n = if is_corrected { 3 } else { 2 };
    let edges: Vec<f64> =
        run.interval_edges_log10_us.iter().map(|decade| 10.0_f64.powf(*decade - 3.0)).collect();
    let layers = inks
        .iter()
        .zip(&run.interval_shares)
        .take(n)
        .map(|((ink, _), heights)| Layer::Steps {
            ink: *ink,
            edges: edges.clone(),
            heights: heights.iter().map(|share| share * 100.0).collect(),
        })
        .collect();
    let chart = Chart {
        x: Axis::log("interval (ms)"),
        y: Axis::from_zero("share of intervals (%)"),
        layers,
    };
    Figure {
        title: "Time between events of one pixel".into(),
        caption:
            "Eight bins a decade. What the model leaves out often shows here first: a hole at \
                  short times is a dead time, a second hump a lost event."
                .into(),
        legend: inks.iter().take(n).map(|(ink, word)| Key::new(*ink, Sample::Line, word)).collect(),
        panels: vec![Panel {
            title: "Intervals".into(),
            note: String::new(),
            alt: "Histograms of the intervals between events of one pixel, real and generated."
                .into(),
            drawing: chart.draw_wide(),
        }],
        data: None,
    }
}
