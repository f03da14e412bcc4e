//! A `diagnosis.json` as one SVG: the strata with a misfit, and the proposed term.
//!
//! `cargo run --release --example diagnosis_figure -- diagnosis.json OUT.svg`

use evrig::diagnose::{Diagnosis, MisfitStratum, ProposedTerm};
use evrig::stats::read_back;
use plotters::coord::Shift;
use plotters::prelude::*;
use std::error::Error;

type Canvas<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type Drawn = Result<(), Box<dyn Error>>;

const USAGE: &str = "usage: diagnosis_figure diagnosis.json OUT.svg";
const SIZE: (u32, u32) = (900, 340);
const BAR: RGBColor = RGBColor(0, 114, 178);
const CURVE: RGBColor = RGBColor(213, 94, 0);
/// Strata that fit legibly into the figure.
const MAX_STRATA: usize = 8;

fn main() -> Drawn {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [from, to] = arguments.as_slice() else { return Err(USAGE.into()) };
    let diagnosis: Diagnosis = read_back(&std::fs::read_to_string(from)?)?;
    let mut text = String::new();
    {
        let canvas = SVGBackend::with_string(&mut text, SIZE).into_drawing_area();
        canvas.fill(&WHITE).map_err(|e| e.to_string())?;
        let places = &diagnosis.mismatch.strata;
        let places = &places[..places.len().min(MAX_STRATA)];
        if let Some(term) = &diagnosis.proposed_term {
            let (left, right) = canvas.split_horizontally(510);
            places_of(&left, places)?;
            curve_of(&right, term)?;
        } else {
            places_of(&canvas, places)?;
        }
        canvas.present().map_err(|e| e.to_string())?;
    }
    std::fs::write(to, text)?;
    Ok(())
}

/// Gain of a recalibration in each stratum.
fn places_of(area: &Canvas<'_>, places: &[MisfitStratum]) -> Drawn {
    let most = places.first().map_or(1.0, |place| place.excess_nats_per_event);
    let n = places.len() as f64;
    let mut chart = ChartBuilder::on(area)
        .caption("misfit by stratum", ("sans-serif", 16))
        .margin(10)
        .x_label_area_size(36)
        .build_cartesian_2d(0.0..1.1 * most, 0.0..n.max(1.0))?;
    chart
        .configure_mesh()
        .disable_y_mesh()
        .disable_y_axis()
        .light_line_style(WHITE)
        .x_desc("excess, nats per event")
        .draw()?;
    for (i, place) in places.iter().enumerate() {
        let row = n - 1.0 - i as f64;
        let bar = [(0.0, row + 0.1), (place.excess_nats_per_event, row + 0.45)];
        chart.draw_series([Rectangle::new(bar, BAR.filled())])?;
        chart.draw_series([Text::new(
            place.description.clone(),
            (0.0, row + 0.85),
            ("sans-serif", 12),
        )])?;
    }
    Ok(())
}

/// The proposed term over its covariate, with its 90 % band.
fn curve_of(area: &Canvas<'_>, term: &ProposedTerm) -> Drawn {
    let ends = |column: usize| {
        let all = term.curve.iter().map(|point| point[column]);
        (all.clone().fold(f64::INFINITY, f64::min), all.fold(f64::NEG_INFINITY, f64::max))
    };
    let (across, low, high) = (ends(0), ends(2).0.min(0.0), ends(3).1.max(0.0));
    if across.0 >= across.1 {
        return Ok(());
    }
    let mut chart = ChartBuilder::on(area)
        .caption(format!("proposed: enters {}", term.enters), ("sans-serif", 16))
        .margin(10)
        .x_label_area_size(36)
        .y_label_area_size(50)
        .build_cartesian_2d(across.0..across.1, low..high)?;
    chart
        .configure_mesh()
        .light_line_style(WHITE)
        .x_desc(&term.depends_on)
        .y_desc("innovation, thresholds")
        .draw()?;
    let upper = term.curve.iter().map(|p| (p[0], p[3]));
    let lower = term.curve.iter().rev().map(|p| (p[0], p[2]));
    let band: Vec<(f64, f64)> = upper.chain(lower).collect();
    chart.draw_series([Polygon::new(band, CURVE.mix(0.2))])?;
    chart.draw_series(LineSeries::new(term.curve.iter().map(|p| (p[0], p[1])), CURVE))?;
    Ok(())
}
