//! Several charts on one sheet: a self-contained SVG file, with its own style.

use super::Ink;
use super::chart::{Chart, Stroke};
use super::svg::{Anchor, Area, Canvas};

const STYLE: &str = include_str!("sheet.css");
/// Height of the title line above a chart.
const TITLE_HEIGHT: f64 = 24.0;
/// Width of a letter of the legend, as an upper bound for common fonts.
const LETTER_WIDTH: f64 = 7.5;

/// A sheet under construction; lengths in user units, y downwards.
#[derive(Debug)]
pub struct Sheet {
    canvas: Canvas,
}

impl Sheet {
    /// An empty white sheet.
    #[must_use]
    pub fn new(width: f64, height: f64) -> Self {
        let mut canvas = Canvas::new(width, height);
        canvas.rect("paper", Area { x: 0.0, y: 0.0, w: width, h: height });
        Self { canvas }
    }

    /// A heading with its baseline at a place.
    pub fn title(&mut self, at: [f64; 2], text: &str) {
        self.canvas.text("title", at, Anchor::Start, text);
    }

    /// Draws a chart on an area with its title above and its legend (ink, stroke, name) beside the
    /// label of the vertical axis.
    pub fn chart(
        &mut self,
        area: Area,
        title: &str,
        legend: &[(Ink, Stroke, &str)],
        chart: &Chart,
    ) {
        self.title([area.x, area.y + 14.0], title);
        let baseline = area.y + TITLE_HEIGHT + 12.0;
        let mut right = area.right() - 18.0;
        for (ink, stroke, name) in legend.iter().rev() {
            self.canvas.text("legend", [right, baseline], Anchor::End, name);
            right -= LETTER_WIDTH * name.chars().count() as f64 + 4.0;
            let class = stroke.class(*ink);
            self.canvas.line(&class, [right - 20.0, baseline - 4.0], [right, baseline - 4.0]);
            right -= 34.0;
        }
        chart.draw_on(&mut self.canvas, chart_area(area));
    }

    /// The canvas, for marks that are no chart.
    pub fn canvas(&mut self) -> &mut Canvas {
        &mut self.canvas
    }

    /// The finished file.
    #[must_use]
    pub fn finish(self) -> String {
        self.canvas.finish_file(STYLE)
    }
}

/// The part of an area that [`Sheet::chart`] leaves to the chart itself.
#[must_use]
pub fn chart_area(area: Area) -> Area {
    Area { y: area.y + TITLE_HEIGHT, h: area.h - TITLE_HEIGHT, ..area }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plot::chart::{ChartAxis, Layer};

    #[test]
    fn a_sheet_is_a_complete_file_with_titles_and_legends() {
        let points = vec![[0.0, 0.0], [1.0, 100.0]];
        let layers = vec![Layer::Line { ink: Ink::Series(0), stroke: Stroke::Solid, points }];
        let area = Area { x: 10.0, y: 10.0, w: 400.0, h: 300.0 };
        let chart =
            Chart { x: ChartAxis::linear("x (mm)"), y: ChartAxis::linear("y (mm)"), layers }
                .with_equal_scales(chart_area(area));
        let mut sheet = Sheet::new(420.0, 320.0);
        sheet.chart(area, "path", &[(Ink::Series(0), Stroke::Solid, "camera")], &chart);
        let svg = sheet.finish();
        assert!(svg.starts_with("<svg xmlns=") && svg.ends_with("</svg>\n"));
        assert!(svg.contains(">path<") && svg.contains(">camera<") && svg.contains("x (mm)"));
        assert_eq!(svg.matches("line ink-series-0").count(), 2);
        let [x, y] = [chart.x.range.unwrap(), chart.y.range.unwrap()];
        assert!(x[1] - x[0] > y[1] - y[0], "the wider side shows the longer range: {x:?} {y:?}");
    }
}
