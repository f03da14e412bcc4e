//! A `diagnosis.json` as one SVG: the strata with a misfit, and the proposed term.
//!
//! `cargo run --release --example diagnosis_figure -- diagnosis.json OUT.svg`

use evrig::diagnose::{Diagnosis, MisfitStratum, ProposedTerm};
use evrig::report::plot::Ink;
use evrig::report::plot::chart::{Chart, ChartAxis, Layer, Stroke};
use evrig::report::plot::sheet::Sheet;
use evrig::report::plot::svg::{Anchor, Area};
use evrig::stats::read_back;
use std::error::Error;

const USAGE: &str = "usage: diagnosis_figure diagnosis.json OUT.svg";
/// Places that can be read in the image.
const N_PLACES: usize = 8;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [from, to] = arguments.as_slice() else { return Err(USAGE.into()) };
    let diagnosis: Diagnosis = read_back(&std::fs::read_to_string(from)?)?;
    let mut sheet = Sheet::new(900.0, 340.0);
    let strata = &diagnosis.mismatch.strata;
    let strata = &strata[..strata.len().min(N_PLACES)];
    let area = |x: f64, w: f64| Area { x, y: 10.0, w, h: 320.0 };
    if let Some(term) = &diagnosis.proposed_term {
        draw_places(&mut sheet, area(10.0, 490.0), strata);
        draw_term(&mut sheet, area(520.0, 370.0), term);
    } else {
        draw_places(&mut sheet, area(10.0, 880.0), strata);
    }
    std::fs::write(to, sheet.finish())?;
    Ok(())
}

/// A bar for what a recalibration in each stratum would gain.
fn draw_places(sheet: &mut Sheet, area: Area, places: &[MisfitStratum]) {
    let greatest = places.first().map_or(1.0, |place| place.excess_nats_per_event);
    sheet.title([area.x, area.y + 14.0], "where the model is wrong: excess, nats per event");
    let row = (area.h - 24.0) / places.len().max(1) as f64;
    for (i, place) in places.iter().enumerate() {
        let y = area.y + 24.0 + row * i as f64;
        let excess = place.excess_nats_per_event;
        let bar = Area {
            x: area.x,
            y: y + 0.5 * row,
            w: 0.85 * area.w * excess / greatest,
            h: 0.35 * row,
        };
        let canvas = sheet.canvas();
        canvas.text("legend", [area.x, y + 0.38 * row], Anchor::Start, &place.description);
        canvas.rect("bar ink-series-0", bar);
        let end = [bar.right() + 6.0, bar.y + 0.5 * bar.h + 4.0];
        canvas.text("tick-label", end, Anchor::Start, &format!("{excess:.3}"));
    }
}

/// The proposed term over its covariate, with its 90 % band.
fn draw_term(sheet: &mut Sheet, area: Area, term: &ProposedTerm) {
    let ink = Ink::Series(1);
    let band = term.curve.iter().map(|p| [p[0], p[2], p[3]]).collect();
    let points = term.curve.iter().map(|p| [p[0], p[1]]).collect();
    let chart = Chart {
        x: ChartAxis::linear(&term.depends_on),
        y: ChartAxis::from_zero("innovation, thresholds"),
        layers: vec![
            Layer::Band { ink, points: band },
            Layer::Line { ink, stroke: Stroke::Solid, points },
        ],
    };
    sheet.chart(area, &format!("proposed: enters {}", term.enters), &[], &chart);
}
