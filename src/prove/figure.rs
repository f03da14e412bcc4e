//! The score as images: how often an effect is named by its strength, and how often a stated
//! interval holds the truth by its claimed level.

use super::score::{CountedShare, ProofScore};
use evrig_report::plot::Ink;
use evrig_report::plot::chart::{Chart, ChartAxis, Layer, Stroke};
use evrig_report::plot::sheet::Sheet;
use evrig_report::plot::svg::Area;

/// Middles of the bins of strength.
const STRENGTHS: [f64; 4] = [1.19, 1.68, 2.38, 3.36];

/// A score as one SVG image; `None` where nothing was counted that could be drawn.
#[must_use]
pub fn figure(score: &ProofScore) -> Option<String> {
    let points = |shares: &mut dyn Iterator<Item = (f64, CountedShare)>| -> Vec<[f64; 4]> {
        let counted = shares.filter(|(_, share)| share.of > 0);
        counted.map(|(x, share)| [x, share.value(), share.ci95[0], share.ci95[1]]).collect()
    };
    let by_strength = points(&mut STRENGTHS.iter().copied().zip(score.by_strength.iter().copied()));
    let calibration = points(&mut score.calibration.iter().copied());
    if by_strength.is_empty() && calibration.is_empty() {
        return None;
    }
    let mut sheet = Sheet::new(760.0, 330.0);
    let area = |x: f64| Area { x, y: 10.0, w: 360.0, h: 310.0 };
    let measured = |points| Layer::Errors { ink: Ink::Series(0), points };
    let strengths = Chart {
        x: ChartAxis::linear("strength, in least strengths").over(1.0, 4.0),
        y: ChartAxis::linear("share of trials").over(0.0, 1.0),
        layers: vec![measured(by_strength)],
    };
    sheet.chart(area(10.0), "one effect: named first", &[], &strengths);
    let expected =
        Layer::Line { ink: Ink::Guide, stroke: Stroke::Thin, points: vec![[0.4, 0.4], [1.0, 1.0]] };
    let intervals = Chart {
        x: ChartAxis::linear("claimed level").over(0.4, 1.0),
        y: ChartAxis::linear("share of parameters").over(0.0, 1.0),
        layers: vec![expected, measured(calibration)],
    };
    sheet.chart(area(390.0), "intervals that hold the truth", &[], &intervals);
    Some(sheet.finish())
}

#[cfg(test)]
mod tests {
    use super::*;
    use evrig_core::stats::wilson95;

    #[test]
    fn every_share_that_was_counted_is_a_point_and_nothing_is_no_image() {
        assert_eq!(figure(&ProofScore::default()), None);
        let share = |hits, of| CountedShare { hits, of, ci95: wilson95(hits, of) };
        let score = ProofScore {
            by_strength: [share(1, 4), share(0, 0), share(3, 4), share(4, 4)],
            calibration: vec![(0.5, share(2, 6)), (0.9, share(5, 6))],
            ..ProofScore::default()
        };
        let image = figure(&score).unwrap();
        assert_eq!(image.matches("dots big").count(), 5, "{image}");
        assert!(image.contains("claimed level"));
    }
}
