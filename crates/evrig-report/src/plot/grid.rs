//! A heat map over any two axes: a parameter sweep, a count by hour, a kernel.

use super::Drawing;
use super::chart::ChartAxis;
use super::colour::{Rgb, diverging_dark, diverging_light, sequential};
use super::heat::BAR;
use super::image_panel::{Bar, put_bar, put_image};
use super::pixel_image::{PixelImage, PixelImageError, check_length};
use super::scale::{AxisScale, ScaleKind};
use super::svg::{Anchor, Area, Canvas};
use evrig_core::geometry::Size;

/// How values become colours.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Colours {
    /// From the lowest value to the highest.
    Sequential,
    /// The same on a logarithmic scale; values that are not above zero stay empty.
    Log,
    /// From minus this value to plus it, zero empty; values beyond keep the end's colour.
    Diverging(f64),
}

/// Where the first row of a grid lies.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FirstRow {
    /// As an axis has it.
    Bottom,
    /// As an image has it.
    Top,
}

/// Values on a grid of cells.
#[derive(Debug, Clone, PartialEq)]
pub struct HeatGrid<'a> {
    /// Horizontal axis; its range spans the cells from edge to edge.
    pub x: ChartAxis,
    /// Vertical axis; its range spans the cells from edge to edge.
    pub y: ChartAxis,
    /// Number of cells along each axis.
    pub cells: Size,
    /// Row after row; what is not finite stays empty.
    pub values: &'a [f64],
    /// Where the first of them lies.
    pub first_row: FirstRow,
    /// How values become colours.
    pub colours: Colours,
    /// What the values are, with their unit.
    pub label: String,
}

/// Draws the grid for half the page's width.
///
/// # Errors
/// When the number of values does not fit the cells, or there are no cells.
pub fn draw(grid: &HeatGrid<'_>) -> Result<Drawing, PixelImageError> {
    check_length(grid.cells, grid.values.len())?;
    let range = grid.range();
    let scale = AxisScale::new(grid.colours.kind(), range, [0.0, 1.0]);
    let image = |dark: bool| {
        PixelImage::from_fn_with_holes(grid.cells, |i| {
            let [width, height] = [grid.cells.width, grid.cells.height].map(usize::from);
            let (from_top, column) = (i / width, i % width);
            let row = match grid.first_row {
                FirstRow::Bottom => height - 1 - from_top,
                FirstRow::Top => from_top,
            };
            let share = scale.position(grid.values[row * width + column]);
            share.is_finite().then(|| grid.colours.colour(share, dark))
        })
    };
    let bar_picture =
        |dark: bool| PixelImage::from_fn(BAR, |i| grid.colours.colour(i as f64 / 255.0, dark));
    let has_twin = matches!(grid.colours, Colours::Diverging(_));
    let bar = Bar {
        label: grid.label.clone(),
        kind: grid.colours.kind(),
        range: scale.data(),
        ticks: None,
        light: bar_picture(false),
        dark: has_twin.then(|| bar_picture(true)),
    };

    let mut canvas = Canvas::new(460.0, 400.0);
    let area = Area { x: 58.0, y: 24.0, w: 392.0, h: 272.0 };
    let twin = has_twin.then(|| image(true));
    put_image(&mut canvas, area, &image(false), twin.as_ref())?;
    canvas.rect("frame", area);
    draw_axes(&mut canvas, grid, area);
    put_bar(&mut canvas, Area { y: area.bottom() + 50.0, h: 9.0, ..area }, &bar)?;
    Ok(Drawing::single(canvas.finish()))
}

fn draw_axes(canvas: &mut Canvas, grid: &HeatGrid<'_>, area: Area) {
    let span = |axis: &ChartAxis, n: u16| axis.range.unwrap_or([0.0, f64::from(n)]);
    let x = AxisScale::new(grid.x.kind, span(&grid.x, grid.cells.width), [area.x, area.right()]);
    let upwards = [area.bottom(), area.y];
    let y = AxisScale::new(grid.y.kind, span(&grid.y, grid.cells.height), upwards);
    let y = if grid.first_row == FirstRow::Top { y.turned() } else { y };
    for tick in x.ticks(6).iter().filter(|tick| !tick.label.is_empty()) {
        let at = x.position(tick.value);
        canvas.line("tick", [at, area.bottom()], [at, area.bottom() + 5.0]);
        let below = [at, area.bottom() + 18.0];
        canvas.text("tick-label num", below, Anchor::Middle, &tick.label);
    }
    for tick in y.ticks(6).iter().filter(|tick| !tick.label.is_empty()) {
        let at = y.position(tick.value);
        canvas.line("tick", [area.x - 5.0, at], [area.x, at]);
        canvas.text("tick-label num", [area.x - 8.0, at + 4.0], Anchor::End, &tick.label);
    }
    canvas.text("axis-label", [0.0, 12.0], Anchor::Start, &grid.y.label);
    let below = [area.right(), area.bottom() + 34.0];
    canvas.text("axis-label", below, Anchor::End, &grid.x.label);
    canvas.read_out(area, &x.describe(), &y.describe());
}

impl HeatGrid<'_> {
    fn range(&self) -> [f64; 2] {
        if let Colours::Diverging(limit) = self.colours {
            return [-limit.abs(), limit.abs()];
        }
        let is_shown =
            |v: &&f64| v.is_finite() && (self.colours == Colours::Sequential || **v > 0.0);
        let low = self.values.iter().filter(is_shown).copied().min_by(f64::total_cmp);
        let high = self.values.iter().filter(is_shown).copied().max_by(f64::total_cmp);
        // Without a value the scale falls back to one that can be drawn.
        [low.unwrap_or(f64::NAN), high.unwrap_or(f64::NAN)]
    }
}

impl Colours {
    fn kind(self) -> ScaleKind {
        if self == Self::Log { ScaleKind::Log } else { ScaleKind::Linear }
    }

    /// Colour of a share in 0..=1 of the scale.
    fn colour(self, share: f64, dark: bool) -> Rgb {
        match self {
            Self::Sequential | Self::Log => sequential(share),
            Self::Diverging(_) if dark => diverging_dark(2.0 * share - 1.0),
            Self::Diverging(_) => diverging_light(2.0 * share - 1.0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid<'a>(values: &'a [f64], colours: Colours) -> HeatGrid<'a> {
        HeatGrid {
            x: ChartAxis::linear("k1").over(0.0, 3.0),
            y: ChartAxis::linear("k2 (DN)").over(10.0, 30.0),
            cells: Size::new(3, 2),
            values,
            first_row: FirstRow::Bottom,
            colours,
            label: "count ratio".into(),
        }
    }

    #[test]
    fn any_values_can_be_drawn_and_a_wrong_number_is_refused() {
        for values in [[1.0, 2.0, 3.0, 4.0, 5.0, 6.0], [f64::NAN; 6], [0.0; 6], [-1.0; 6]] {
            for colours in [
                Colours::Sequential,
                Colours::Log,
                Colours::Diverging(2.0),
                Colours::Diverging(0.0),
            ] {
                let drawing = draw(&grid(&values, colours)).unwrap();
                assert!(!drawing.wide().contains("NaN"));
                assert!(
                    drawing.wide().contains("k2 (DN)") && drawing.wide().contains("count ratio")
                );
            }
        }
        assert!(draw(&grid(&[1.0; 5], Colours::Log)).is_err());
    }

    #[test]
    fn an_image_has_its_first_row_at_the_top() {
        let values = [0.0, 0.0, 0.0, 1.0, 1.0, 1.0];
        let axis = grid(&values, Colours::Sequential);
        let image = HeatGrid { first_row: FirstRow::Top, ..axis.clone() };
        let flipped = HeatGrid { values: &[1.0, 1.0, 1.0, 0.0, 0.0, 0.0], ..axis.clone() };
        let drawn = |grid| draw(grid).unwrap().wide().to_owned();
        let cells = |svg: String| {
            svg.split("base64,").nth(1).unwrap().split('"').next().unwrap().to_owned()
        };
        assert_eq!(cells(drawn(&image)), cells(drawn(&flipped)));
        assert!(drawn(&axis).contains("data-y=\"lin 1e1 3e1\""));
        assert!(drawn(&image).contains("data-y=\"lin 3e1 1e1\""));
    }
}
