//! The score as pictures: how often an effect is named by its strength, and how often a stated
//! interval holds the truth by its claimed level.

use super::score::{CountedShare, ProofScore};
use plotters::coord::Shift;
use plotters::prelude::*;

type Canvas<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type DrawResult = Result<(), Box<dyn std::error::Error>>;

const SIZE: (u32, u32) = (760, 330);
const MEASURED: RGBColor = RGBColor(0, 114, 178);
const EXPECTED: RGBColor = RGBColor(120, 120, 120);

/// Middles of the bins of strength.
const STRENGTHS: [f64; 4] = [1.19, 1.68, 2.38, 3.36];

/// A score as one SVG picture; `None` where nothing was counted that could be drawn.
#[must_use]
pub fn figure(score: &ProofScore) -> Option<String> {
    let is_counted = |share: &CountedShare| share.of > 0;
    let calibration: Vec<&(f64, CountedShare)> =
        score.calibration.iter().filter(|(_, share)| is_counted(share)).collect();
    if !score.by_strength.iter().any(is_counted) && calibration.is_empty() {
        return None;
    }
    let mut text = String::new();
    {
        let canvas = SVGBackend::with_string(&mut text, SIZE).into_drawing_area();
        // Drawing into a string fails only on a malformed chart, which would be this file's fault.
        draw(&canvas, score, &calibration).ok()?;
        canvas.present().ok()?;
    }
    Some(text)
}

fn draw(
    canvas: &Canvas<'_>,
    score: &ProofScore,
    calibration: &[&(f64, CountedShare)],
) -> DrawResult {
    canvas.fill(&WHITE)?;
    let (left, right) = canvas.split_horizontally(380);
    let strengths = STRENGTHS.iter().zip(&score.by_strength);
    let named: Vec<(f64, CountedShare)> =
        strengths.filter(|(_, share)| share.of > 0).map(|(&s, &share)| (s, share)).collect();
    points(
        &left,
        ["one effect: named first", "strength, in least strengths", "share of trials"],
        1.0..4.0,
        &named,
        None,
    )?;
    let held: Vec<(f64, CountedShare)> = calibration.iter().map(|&&pair| pair).collect();
    points(
        &right,
        ["intervals that hold the truth", "claimed level", "share of parameters"],
        0.4..1.0,
        &held,
        Some([(0.4, 0.4), (1.0, 1.0)]),
    )
}

/// Shares with their 95 % intervals over something, and a line that they should lie on.
fn points(
    area: &Canvas<'_>,
    [title, across, up]: [&str; 3],
    range: std::ops::Range<f64>,
    shares: &[(f64, CountedShare)],
    expected: Option<[(f64, f64); 2]>,
) -> DrawResult {
    let mut chart = ChartBuilder::on(area)
        .caption(title, ("sans-serif", 16))
        .margin(10)
        .x_label_area_size(36)
        .y_label_area_size(44)
        .build_cartesian_2d(range, 0.0..1.0)?;
    chart.configure_mesh().light_line_style(WHITE).x_desc(across).y_desc(up).draw()?;
    if let Some(line) = expected {
        chart.draw_series(LineSeries::new(line, EXPECTED))?;
    }
    for &(at, share) in shares {
        let [low, high] = share.ci95;
        chart.draw_series(std::iter::once(PathElement::new([(at, low), (at, high)], MEASURED)))?;
        chart.draw_series(std::iter::once(Circle::new(
            (at, share.value()),
            4,
            MEASURED.filled(),
        )))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use evrig_core::stats::wilson95;

    #[test]
    fn every_share_that_was_counted_is_a_point_and_nothing_is_no_picture() {
        assert_eq!(figure(&ProofScore::default()), None);
        let share = |hits, of| CountedShare { hits, of, ci95: wilson95(hits, of) };
        let score = ProofScore {
            by_strength: [share(1, 4), share(0, 0), share(3, 4), share(4, 4)],
            calibration: vec![(0.5, share(2, 6)), (0.9, share(5, 6))],
            ..ProofScore::default()
        };
        let picture = figure(&score).unwrap();
        assert_eq!(picture.matches("<circle").count(), 5, "{picture}");
        assert!(picture.contains("claimed level"));
    }
}
