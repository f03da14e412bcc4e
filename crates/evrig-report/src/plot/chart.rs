//! Plots over a pair of axes: lines, bands, points, bars and rules.

use super::scale::{AxisScale, ScaleKind, Tick};
use super::svg::{Anchor, Area, Canvas};
use super::{Drawing, Ink};

/// One axis.
#[derive(Debug, Clone, PartialEq)]
pub struct ChartAxis {
    /// Quantity and unit, as in "time (s)".
    pub label: String,
    /// Linear or logarithmic.
    pub kind: ScaleKind,
    /// The drawn interval; `None` for all data.
    pub range: Option<[f64; 2]>,
    /// A value that the interval must contain.
    pub include: Option<f64>,
}

/// One set of marks in data units; values that are not finite are left out.
#[derive(Debug, Clone, PartialEq)]
pub enum Layer {
    /// A line through points in order.
    Line {
        /// Ink.
        ink: Ink,
        /// Stroke.
        stroke: Stroke,
        /// x and y.
        points: Vec<[f64; 2]>,
    },
    /// A shaded band: the error about a line.
    Band {
        /// Ink.
        ink: Ink,
        /// x, low and high.
        points: Vec<[f64; 3]>,
    },
    /// Dots.
    Points {
        /// Ink.
        ink: Ink,
        /// x and y.
        points: Vec<[f64; 2]>,
    },
    /// Dots with vertical error bars.
    Errors {
        /// Ink.
        ink: Ink,
        /// x, value, low and high.
        points: Vec<[f64; 4]>,
    },
    /// A histogram as steps: one height between each pair of neighbouring edges.
    Steps {
        /// Ink.
        ink: Ink,
        /// Ascending; one more than heights.
        edges: Vec<f64>,
        /// Heights.
        heights: Vec<f64>,
    },
    /// A horizontal line across the plot.
    Level {
        /// Position.
        y: f64,
        /// Label.
        text: String,
    },
    /// A vertical line across the plot.
    Moment {
        /// Position.
        x: f64,
        /// Label.
        text: String,
    },
}

/// How a line is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stroke {
    /// Data.
    Solid,
    /// Thin and dashed: a fit, a prediction.
    Thin,
}

impl Stroke {
    /// The classes of a line of this stroke and an ink.
    pub(super) fn class(self, ink: Ink) -> String {
        let style = if self == Self::Solid { "line" } else { "line thin" };
        format!("{style} {}", ink.class())
    }
}

/// A plot: two axes and layers.
#[derive(Debug, Clone, PartialEq)]
pub struct Chart {
    /// Horizontal axis.
    pub x: ChartAxis,
    /// Vertical axis.
    pub y: ChartAxis,
    /// Marks, the lowest layer first.
    pub layers: Vec<Layer>,
}

/// Outer sizes in user units, about CSS pixels.
const WIDE: [f64; 2] = [960.0, 300.0];
const HALF: [f64; 2] = [460.0, 290.0];
const NARROW: [f64; 2] = [352.0, 270.0];
/// Width of a digit at the text size of the axes, an upper bound for common fonts.
const FIGURE_WIDTH: f64 = 8.6;

impl ChartAxis {
    /// A linear axis over all data.
    #[must_use]
    pub fn linear(label: &str) -> Self {
        Self { label: label.to_owned(), kind: ScaleKind::Linear, range: None, include: None }
    }

    /// A linear axis that contains 0.
    #[must_use]
    pub fn from_zero(label: &str) -> Self {
        Self { include: Some(0.0), ..Self::linear(label) }
    }

    /// A logarithmic axis over all data above zero.
    #[must_use]
    pub fn log(label: &str) -> Self {
        Self { kind: ScaleKind::Log, ..Self::linear(label) }
    }

    /// The same axis over a given interval.
    #[must_use]
    pub fn over(self, low: f64, high: f64) -> Self {
        Self { range: Some([low, high]), ..self }
    }

    fn scale(&self, values: impl Iterator<Item = f64>, paper: [f64; 2]) -> AxisScale {
        AxisScale::new(self.kind, self.range.unwrap_or_else(|| self.fit(values)), paper)
    }

    /// The interval of all values that can be drawn, with a margin.
    fn fit(&self, values: impl Iterator<Item = f64>) -> [f64; 2] {
        let mut range = [f64::INFINITY, f64::NEG_INFINITY];
        let can_be_drawn = |v: &f64| v.is_finite() && (self.kind == ScaleKind::Linear || *v > 0.0);
        for v in values.chain(self.include).filter(can_be_drawn) {
            range = [range[0].min(v), range[1].max(v)];
        }
        let [low, high] = range;
        match self.kind {
            ScaleKind::Linear => {
                let margin = 0.05 * (high - low);
                let is_end = |v: f64| self.include == Some(v);
                [
                    if is_end(low) { low } else { low - margin },
                    if is_end(high) { high } else { high + margin },
                ]
            }
            ScaleKind::Log => [low / 1.15, high * 1.15],
        }
    }
}

impl Chart {
    /// Drawn over the full width of the page, with a second layout for narrow pages.
    #[must_use]
    pub fn draw_wide(&self) -> Drawing {
        Drawing::responsive(self.svg(WIDE), self.svg(NARROW)).over_full_width()
    }

    /// Drawn for half the width of the page.
    #[must_use]
    pub fn draw_half(&self) -> Drawing {
        Drawing::responsive(self.svg(HALF), self.svg(NARROW))
    }

    fn has_data(&self) -> bool {
        let is_visible = |layer: &Layer| match layer {
            Layer::Level { .. } | Layer::Moment { .. } => false,
            data => data.ys().any(f64::is_finite),
        };
        self.layers.iter().any(is_visible)
    }

    fn svg(&self, [w, h]: [f64; 2]) -> String {
        let mut canvas = Canvas::new(w, h);
        self.draw_on(&mut canvas, Area { x: 0.0, y: 0.0, w, h });
        canvas.finish()
    }

    /// The vertical scale, its ticks and the area between the axes, when drawn on `outer`.
    fn layout(&self, outer: Area) -> (AxisScale, Vec<Tick>, Area) {
        let (top, bottom) = (outer.y + 26.0, outer.bottom() - 40.0);
        let y = self.y.scale(self.ys(), [bottom, top]);
        let ticks = y.ticks(if outer.h > 280.0 { 6 } else { 5 });
        let longest = ticks.iter().map(|t| t.label.chars().count()).max().unwrap_or(0);
        let left = 10.0 + FIGURE_WIDTH * longest as f64;
        let w = outer.w - left - 18.0;
        (y, ticks, Area { x: outer.x + left, y: top, w, h: bottom - top })
    }

    fn xs(&self) -> impl Iterator<Item = f64> {
        self.layers.iter().flat_map(Layer::xs)
    }

    fn ys(&self) -> impl Iterator<Item = f64> {
        self.layers.iter().flat_map(Layer::ys)
    }

    /// The same chart with both ranges widened about their middles until a unit is as long on the
    /// horizontal axis as on the vertical one, when drawn on `outer`.
    #[must_use]
    pub fn with_equal_scales(mut self, outer: Area) -> Self {
        let data = [(&self.x, self.x.fit(self.xs())), (&self.y, self.y.fit(self.ys()))]
            .map(|(axis, fitted)| {
                AxisScale::new(axis.kind, axis.range.unwrap_or(fitted), [0.0, 1.0])
            })
            .map(|scale| scale.data());
        // Tick labels change with the range, and the area with them: the second pass settles it.
        for _ in 0..2 {
            let (_, _, area) = self.layout(outer);
            let sides = [area.w, area.h];
            let per_unit = [0, 1].map(|i| (data[i][1] - data[i][0]) / sides[i]);
            let per_unit = per_unit[0].max(per_unit[1]);
            let [x, y] = [0, 1].map(|i| {
                let (middle, half) = (0.5 * (data[i][0] + data[i][1]), 0.5 * per_unit * sides[i]);
                Some([middle - half, middle + half])
            });
            (self.x.range, self.y.range) = (x, y);
        }
        self
    }

    /// Draws axes, labels and marks on an area of a canvas.
    pub(super) fn draw_on(&self, canvas: &mut Canvas, outer: Area) {
        let (y, y_ticks, area) = self.layout(outer);
        let x = self.x.scale(self.xs(), [area.x, area.right()]);
        let x_ticks = x.ticks((area.w / 62.0) as usize);

        for tick in &y_ticks {
            let at = y.position(tick.value);
            if tick.label.is_empty() {
                canvas.line("tick", [area.x - 3.0, at], [area.x, at]);
                continue;
            }
            canvas.line("grid", [area.x, at], [area.right(), at]);
            canvas.text("tick-label num", [area.x - 7.0, at + 4.0], Anchor::End, &tick.label);
        }
        for tick in &x_ticks {
            let at = x.position(tick.value);
            let is_minor = tick.label.is_empty();
            let reach = if is_minor { 3.0 } else { 5.0 };
            canvas.line("tick", [at, area.bottom()], [at, area.bottom() + reach]);
            if !is_minor {
                let below = [at, area.bottom() + 18.0];
                canvas.text("tick-label num", below, Anchor::Middle, &tick.label);
            }
        }
        canvas.line("axis", [area.x, area.bottom()], [area.right(), area.bottom()]);
        canvas.text("axis-label", [outer.x, outer.y + 12.0], Anchor::Start, &self.y.label);
        let right = [area.right(), outer.bottom() - 5.0];
        canvas.text("axis-label", right, Anchor::End, &self.x.label);

        canvas.clip(area);
        for layer in &self.layers {
            layer.draw(canvas, &x, &y, area);
        }
        canvas.unclip();
        if !self.has_data() {
            let middle = [area.x + area.w / 2.0, area.y + area.h / 2.0];
            canvas.text("nothing", middle, Anchor::Middle, "no data");
        }
        canvas.read_out(area, &x.describe(), &y.describe());
    }
}

impl Layer {
    fn xs(&self) -> Box<dyn Iterator<Item = f64> + '_> {
        match self {
            Self::Line { points, .. } | Self::Points { points, .. } => {
                Box::new(points.iter().map(|p| p[0]))
            }
            Self::Band { points, .. } => Box::new(points.iter().map(|p| p[0])),
            Self::Errors { points, .. } => Box::new(points.iter().map(|p| p[0])),
            Self::Steps { edges, .. } => Box::new(edges.iter().copied()),
            Self::Moment { x, .. } => Box::new(std::iter::once(*x)),
            Self::Level { .. } => Box::new(std::iter::empty()),
        }
    }

    fn ys(&self) -> Box<dyn Iterator<Item = f64> + '_> {
        match self {
            Self::Line { points, .. } | Self::Points { points, .. } => {
                Box::new(points.iter().map(|p| p[1]))
            }
            Self::Band { points, .. } => Box::new(points.iter().flat_map(|p| [p[1], p[2]])),
            Self::Errors { points, .. } => Box::new(points.iter().flat_map(|p| [p[1], p[2], p[3]])),
            Self::Steps { heights, .. } => Box::new(heights.iter().copied()),
            Self::Level { y, .. } => Box::new(std::iter::once(*y)),
            Self::Moment { .. } => Box::new(std::iter::empty()),
        }
    }

    fn draw(&self, canvas: &mut Canvas, x: &AxisScale, y: &AxisScale, area: Area) {
        let at = |p: [f64; 2]| [x.position(p[0]), y.position(p[1])];
        match self {
            Self::Line { ink, stroke, points } => {
                canvas.polyline(&stroke.class(*ink), points.iter().map(|p| at(*p)));
            }
            Self::Band { ink, points } => draw_band(canvas, *ink, points, x, y),
            Self::Points { ink, points } => {
                canvas.dots(&format!("dots {}", ink.class()), points.iter().map(|p| at(*p)));
            }
            Self::Errors { ink, points } => {
                for [px, value, low, high] in points {
                    let class = format!("line {}", ink.class());
                    canvas.polyline(&class, [at([*px, *low]), at([*px, *high])]);
                    canvas.dots(&format!("dots big {}", ink.class()), [at([*px, *value])]);
                }
            }
            Self::Steps { ink, edges, heights } => {
                let floor = if y.position(0.0).is_finite() { 0.0 } else { y.data()[0] };
                let raised = |h: f64| if h > floor { h } else { floor };
                let corners = edges.windows(2).zip(heights).flat_map(|(edge, height)| {
                    [at([edge[0], raised(*height)]), at([edge[1], raised(*height)])]
                });
                let foot = |edge: Option<&f64>| edge.map(|x| at([*x, floor]));
                let outline =
                    foot(edges.first()).into_iter().chain(corners).chain(foot(edges.last()));
                canvas.polyline(&format!("line {}", ink.class()), outline);
            }
            Self::Level { y: level, text } => {
                let height = y.position(*level);
                canvas.line("rule", [area.x, height], [area.right(), height]);
                let above = [area.right() - 4.0, height - 5.0];
                canvas.text("rule-label", above, Anchor::End, text);
            }
            Self::Moment { x: moment, text } => {
                let across = x.position(*moment);
                canvas.line("rule", [across, area.y], [across, area.bottom()]);
                canvas.text("rule-label", [across + 4.0, area.y + 11.0], Anchor::Start, text);
            }
        }
    }
}

fn draw_band(canvas: &mut Canvas, ink: Ink, points: &[[f64; 3]], x: &AxisScale, y: &AxisScale) {
    let class = format!("band {}", ink.class());
    let floor = y.data()[0];
    let place = |px: f64, v: f64| {
        let height = y.position(v);
        // On a log scale, 0 is drawn at the lower edge.
        [x.position(px), if height.is_finite() { height } else { y.position(floor) }]
    };
    let is_drawable = |p: &[f64; 3]| p.iter().all(|v| v.is_finite());
    for run in points.split(|p| !is_drawable(p)).filter(|run| run.len() > 1) {
        let high = run.iter().map(|p| place(p[0], p[2]));
        let low = run.iter().rev().map(|p| place(p[0], p[1]));
        canvas.polygon(&class, high.chain(low));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chart(layers: Vec<Layer>) -> Chart {
        Chart { x: ChartAxis::linear("time (s)"), y: ChartAxis::from_zero("rate (1/s)"), layers }
    }

    fn line(points: Vec<[f64; 2]>) -> Layer {
        Layer::Line { ink: Ink::Real, stroke: Stroke::Solid, points }
    }

    #[test]
    fn a_chart_states_both_axes_and_draws_its_line_in_its_ink() {
        let drawing = chart(vec![line(vec![[0.0, 1.0], [1.0, 2.0]])]).draw_wide();
        for svg in [drawing.wide(), drawing.narrow().unwrap()] {
            assert!(svg.contains("time (s)") && svg.contains("rate (1/s)"));
            assert!(svg.contains("line ink-real"));
            assert!(!svg.contains("NaN") && !svg.contains("inf"));
        }
    }

    #[test]
    fn a_chart_without_a_single_number_states_it() {
        let empty =
            chart(vec![line(vec![[0.0, f64::NAN]]), Layer::Level { y: 1.0, text: "x".into() }]);
        assert!(empty.draw_half().wide().contains("no data"));
        assert!(!chart(vec![line(vec![[0.0, 1.0]])]).draw_half().wide().contains("no data"));
    }

    #[test]
    fn the_band_breaks_where_its_error_is_unknown() {
        let points = vec![
            [0.0, 1.0, 2.0],
            [1.0, 1.0, 2.0],
            [2.0, f64::NAN, 2.0],
            [3.0, 1.0, 2.0],
            [4.0, 1.0, 2.0],
        ];
        let drawing = chart(vec![Layer::Band { ink: Ink::Real, points }]).draw_wide();
        assert_eq!(drawing.wide().matches("band ink-real").count(), 2);
    }

    #[test]
    fn a_histogram_has_one_step_for_each_bin() {
        let steps = Layer::Steps {
            ink: Ink::Real,
            edges: vec![0.0, 1.0, 2.0, 3.0],
            heights: vec![1.0, 4.0, 2.0],
        };
        let svg = chart(vec![steps]).draw_wide();
        let path = svg.wide().split("line ink-real\" d=\"").nth(1).unwrap();
        assert_eq!(path.split('"').next().unwrap().matches('L').count(), 7);
    }
}
