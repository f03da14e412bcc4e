//! An image on its pixel grid, with an optional colour bar.

use super::pixel_image::{PixelImage, PixelImageError};
use super::scale::{AxisScale, ScaleKind};
use super::svg::{Anchor, Area, Canvas};
use evrig_core::geometry::Size;

/// Width of the panel in user units, about CSS pixels.
const WIDTH: f64 = 460.0;
const MAX_HEIGHT: f64 = 460.0;

/// A colour bar.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Bar {
    /// Quantity and unit.
    pub label: String,
    /// Linear or logarithmic.
    pub kind: ScaleKind,
    /// Values at the left and the right end.
    pub range: [f64; 2],
    /// Ticks with labels other than their values.
    pub ticks: Option<Vec<(f64, String)>>,
    /// The scale as an image one pixel high.
    pub light: PixelImage,
    /// The scale for a dark page, where different.
    pub dark: Option<PixelImage>,
}

/// Draws the image (and its variant for a dark page) with the bar below.
pub(super) fn draw(
    light: &PixelImage,
    dark: Option<&PixelImage>,
    grid: Size,
    bar: Option<&Bar>,
) -> Result<String, PixelImageError> {
    let ratio = f64::from(grid.height) / f64::from(grid.width.max(1));
    let height = (WIDTH * ratio).clamp(1.0, MAX_HEIGHT);
    let width = if ratio > 0.0 { (height / ratio).min(WIDTH) } else { WIDTH };
    let area = Area { x: (WIDTH - width) / 2.0, y: 0.0, w: width, h: height };
    let mut canvas = Canvas::new(WIDTH, height + if bar.is_some() { 54.0 } else { 0.0 });
    put_image(&mut canvas, area, light, dark)?;
    canvas.rect("frame", area);
    let pixels = |n: u16| format!("pix 0 {n}");
    canvas.read_out(area, &pixels(grid.width), &pixels(grid.height));
    if let Some(bar) = bar {
        let below = Area { x: area.x, y: height + 10.0, w: width, h: 9.0 };
        put_bar(&mut canvas, below, bar)?;
    }
    Ok(canvas.finish())
}

pub(super) fn put_image(
    canvas: &mut Canvas,
    area: Area,
    light: &PixelImage,
    dark: Option<&PixelImage>,
) -> Result<(), PixelImageError> {
    match dark {
        None => canvas.image("px", area, &light.data_uri()?),
        Some(dark) => {
            canvas.image("px on-light", area, &light.data_uri()?);
            canvas.image("px on-dark", area, &dark.data_uri()?);
        }
    }
    Ok(())
}

pub(super) fn put_bar(canvas: &mut Canvas, area: Area, bar: &Bar) -> Result<(), PixelImageError> {
    put_image(canvas, area, &bar.light, bar.dark.as_ref())?;
    canvas.rect("frame", area);
    let scale = AxisScale::new(bar.kind, bar.range, [area.x, area.right()]);
    let ticks = match &bar.ticks {
        Some(ticks) => ticks.clone(),
        None => scale.ticks(5).into_iter().map(|t| (t.value, t.label)).collect(),
    };
    let text_at = |x: f64| [x, area.bottom() + 16.0];
    for (value, label) in ticks.iter().filter(|(_, label)| !label.is_empty()) {
        let x = scale.position(*value);
        canvas.line("tick", [x, area.bottom()], [x, area.bottom() + 4.0]);
        let anchor = if x < area.x + 12.0 {
            Anchor::Start
        } else if x > area.right() - 12.0 {
            Anchor::End
        } else {
            Anchor::Middle
        };
        canvas.text("tick-label num", text_at(x), anchor, label);
    }
    let label_at = [area.right(), area.bottom() + 32.0];
    canvas.text("axis-label", label_at, Anchor::End, &bar.label);
    Ok(())
}
