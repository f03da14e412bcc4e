//! A picture on its pixel grid, with a colour bar where colours are values.

use super::picture::{Picture, PictureError};
use super::scale::{Kind, Scale};
use super::svg::{Anchor, Area, Canvas};
use evrig_core::geometry::Size;

/// Width of the panel in user units; about a CSS pixel on a desktop page.
const WIDTH: f64 = 460.0;
/// A tall grid is not drawn taller than this.
const MAX_HEIGHT: f64 = 460.0;

/// The colours of a picture and the values they stand for.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Bar {
    /// What the values are, with their unit.
    pub label: String,
    /// Linear or logarithmic.
    pub kind: Kind,
    /// Values at the left and the right end.
    pub range: [f64; 2],
    /// Ticks that are labelled in another way than with their value.
    pub ticks: Option<Vec<(f64, String)>>,
    /// The scale as a picture one pixel high, for a light and, where it differs, a dark page.
    pub light: Picture,
    /// The scale on a dark page.
    pub dark: Option<Picture>,
}

/// Draws the picture (and its twin for a dark page) with the bar below.
pub(super) fn draw(
    light: &Picture,
    dark: Option<&Picture>,
    grid: Size,
    bar: Option<&Bar>,
) -> Result<String, PictureError> {
    let ratio = f64::from(grid.height) / f64::from(grid.width.max(1));
    let height = (WIDTH * ratio).clamp(1.0, MAX_HEIGHT);
    let width = if ratio > 0.0 { (height / ratio).min(WIDTH) } else { WIDTH };
    let area = Area { x: (WIDTH - width) / 2.0, y: 0.0, w: width, h: height };
    let mut canvas = Canvas::new(WIDTH, height + if bar.is_some() { 54.0 } else { 0.0 });
    put_picture(&mut canvas, area, light, dark)?;
    canvas.rect("frame", area);
    let pixels = |n: u16| format!("pix 0 {n}");
    canvas.read_out(area, &pixels(grid.width), &pixels(grid.height));
    if let Some(bar) = bar {
        let below = Area { x: area.x, y: height + 10.0, w: width, h: 9.0 };
        put_bar(&mut canvas, below, bar)?;
    }
    Ok(canvas.finish())
}

pub(super) fn put_picture(
    canvas: &mut Canvas,
    area: Area,
    light: &Picture,
    dark: Option<&Picture>,
) -> Result<(), PictureError> {
    match dark {
        None => canvas.image("px", area, &light.data_uri()?),
        Some(dark) => {
            canvas.image("px on-light", area, &light.data_uri()?);
            canvas.image("px on-dark", area, &dark.data_uri()?);
        }
    }
    Ok(())
}

pub(super) fn put_bar(canvas: &mut Canvas, area: Area, bar: &Bar) -> Result<(), PictureError> {
    put_picture(canvas, area, &bar.light, bar.dark.as_ref())?;
    canvas.rect("frame", area);
    let scale = Scale::new(bar.kind, bar.range, [area.x, area.right()]);
    let ticks = match &bar.ticks {
        Some(ticks) => ticks.clone(),
        None => scale.ticks(5).into_iter().map(|t| (t.value, t.label)).collect(),
    };
    let text_at = |x: f64| [x, area.bottom() + 16.0];
    for (value, label) in ticks.iter().filter(|(_, label)| !label.is_empty()) {
        let x = scale.position(*value);
        canvas.line("tick", [x, area.bottom()], [x, area.bottom() + 4.0]);
        // A label at an end stays under the bar.
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
