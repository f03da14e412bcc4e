//! Forward simulation: camera, baseline and corrected model side by side.

use crate::figure::{Figure, FileLink, LegendEntry, LegendMark, Panel};
use crate::page::SectionBlock;
use crate::plot::Ink;
use crate::plot::chart::{Chart, ChartAxis, Layer};
use crate::table::{ReportTable, TableCell, TableColumn};
use evrig_analysis::diagnose::{ForwardSimulation, ModelComparison};

/// Key, description, and the value of a perfect model.
const MEASURES: [(&str, &str, &str); 7] = [
    ("count_ratio", "generated over recorded events", "1"),
    ("polarity_delta", "difference of the ON shares", "0"),
    ("interval_tv", "total variation distance of the interval histograms", "0"),
    ("rate_map_rmse", "rms difference of counts per pixel, over the mean count", "0"),
    ("spatial_emd", "earth mover's distance of the count maps (px)", "0"),
    ("transport_px", "transport distance in position, time and polarity (px)", "0"),
    ("c2st_accuracy", "classifier two-sample test, accuracy", "0.5"),
];

/// Tables and figures of a forward simulation.
pub(super) fn blocks(run: &ForwardSimulation, is_corrected: bool) -> Vec<SectionBlock> {
    let link = FileLink::beside("derived/diagnose/forward_simulation.json");
    let mut blocks = vec![
        SectionBlock::ReportTable(measures(run, is_corrected)),
        SectionBlock::Figure(intervals(run, is_corrected).with_data(link)),
    ];
    if !run.left_out.is_empty() {
        let words = run.left_out.join("; ");
        blocks.push(SectionBlock::Text(format!(
            "The generator does not support everything: {words}."
        )));
    }
    blocks
}

fn measures(run: &ForwardSimulation, is_corrected: bool) -> ReportTable {
    let cell = |value: Option<f64>| value.map_or_else(|| TableCell::text(""), TableCell::number);
    let row = |(key, words, right): &(&str, &str, &str)| {
        let ModelComparison { baseline, r#final } = run.measures.get(*key)?;
        let mut row = vec![TableCell::text(words), cell(*baseline)];
        if is_corrected {
            row.push(cell(*r#final));
        }
        row.push(TableCell::text(right));
        Some(row)
    };
    let mut columns =
        vec![TableColumn::text("measure"), TableColumn::number("without the named effects", "")];
    if is_corrected {
        columns.push(TableColumn::number("with them", ""));
    }
    columns.push(TableColumn::text("perfect model"));
    let [x, y, w, h] = run.patch_px;
    ReportTable {
        title: "Generated events in seven measures".into(),
        caption: format!(
            "Events generated from the same signal without recorded events, compared with the \
             camera: {w} by {h} pixels from column {x}, row {y}. Nearly all of these pixels were \
             in no fit."
        ),
        columns,
        rows: MEASURES.iter().filter_map(row).collect(),
    }
}

fn intervals(run: &ForwardSimulation, is_corrected: bool) -> Figure {
    let inks = [
        (Ink::Real, "recorded"),
        (Ink::Simulated, "without the named effects"),
        (Ink::Corrected, "with them"),
    ];
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
        x: ChartAxis::log("interval (ms)"),
        y: ChartAxis::from_zero("share of intervals (%)"),
        layers,
    };
    Figure {
        title: "Time between events of one pixel".into(),
        caption:
            "Eight bins per decade. A gap at short intervals indicates a refractory period, a \
             second peak lost events."
                .into(),
        legend: inks
            .iter()
            .take(n)
            .map(|(ink, word)| LegendEntry::new(*ink, LegendMark::Line, word))
            .collect(),
        panels: vec![Panel {
            title: "Intervals".into(),
            note: String::new(),
            alt: "Histograms of the intervals between events of one pixel, recorded and generated."
                .into(),
            drawing: chart.draw_wide(),
        }],
        data: None,
    }
}
