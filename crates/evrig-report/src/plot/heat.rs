//! Maps of event counts on a common scale.

use super::Drawing;
use super::colour::{Rgb, sequential};
use super::image_panel::{self, Bar};
use super::pixel_image::{PixelImage, PixelImageError, check_length};
use super::scale::ScaleKind;
use crate::figure::{Figure, Panel};
use crate::number::count;
use evrig_core::geometry::Size;

/// Colour of a pixel without events.
const NO_EVENT: Rgb = [0, 12, 32];
/// Pixels of a colour bar.
pub(super) const BAR: Size = Size::new(256, 1);
/// Event counts of each pixel over the same window.
#[derive(Debug, Clone, Copy)]
pub struct CountMaps<'a> {
    /// The pixel grid.
    pub size: Size,
    /// Real counts, row-major.
    pub real: &'a [u32],
    /// Simulated counts, row-major.
    pub simulated: &'a [u32],
}

/// Real and simulated counts side by side on one logarithmic scale.
///
/// # Errors
/// When a map's length does not fit the grid, or the grid has no pixels.
pub fn counts_figure(maps: &CountMaps<'_>) -> Result<Figure, PixelImageError> {
    check(maps)?;
    let both = [("Recorded".to_owned(), maps.real), ("Generated".to_owned(), maps.simulated)];
    Ok(Figure {
        title: "Events per pixel".to_owned(),
        caption: "Both maps share one colour scale. Compare the same edges, then regions without \
            edges: counts there are noise, and single bright pixels are hot pixels."
            .to_owned(),
        legend: vec![],
        panels: counts_panels(maps.size, &both)?,
        data: None,
    })
}

/// Titled maps of counts, row-major, side by side on one logarithmic scale.
///
/// # Errors
/// When a map's length does not fit the grid, or the grid has no pixels.
pub fn counts_panels(size: Size, maps: &[(String, &[u32])]) -> Result<Vec<Panel>, PixelImageError> {
    maps.iter().try_for_each(|(_, counts)| check_length(size, counts.len()))?;
    let max = maps.iter().flat_map(|(_, counts)| *counts).copied().max().unwrap_or(0).max(2);
    let top = f64::from(max);
    let bar = Bar {
        label: "events per pixel (log scale; darkest: none)".to_owned(),
        kind: ScaleKind::Log,
        range: [1.0, top],
        ticks: Some(bar_ticks(max)),
        light: PixelImage::from_fn(BAR, |i| sequential(i as f64 / 255.0)),
        dark: None,
    };
    let panel = |(title, counts): &(String, &[u32])| {
        let image = PixelImage::from_fn(size, |i| match counts[i] {
            0 => NO_EVENT,
            n => sequential(f64::from(n).ln() / top.ln()),
        });
        let total = counts.iter().map(|n| u64::from(*n)).sum::<u64>();
        let n_active = counts.iter().filter(|n| **n > 0).count();
        let active = 100.0 * n_active as f64 / counts.len().max(1) as f64;
        Ok::<_, PixelImageError>(Panel {
            title: title.clone(),
            note: format!("{} events", count(total)),
            alt: format!(
                "Map of {} events per pixel: {} events in total, {active:.1} % of the pixels \
                 active.",
                title.to_lowercase(),
                count(total)
            ),
            drawing: Drawing::single(image_panel::draw(&image, None, size, Some(&bar))?),
        })
    };
    maps.iter().map(panel).collect()
}

/// Powers of ten, and the largest count at the end of the bar.
fn bar_ticks(max: u32) -> Vec<(f64, String)> {
    let decades = (0..10).map(|e| 10_u32.pow(e)).take_while(|n| n.saturating_mul(2) < max);
    decades.chain([max]).map(|n| (f64::from(n), count(n.into()))).collect()
}

pub(super) fn check(maps: &CountMaps<'_>) -> Result<(), PixelImageError> {
    check_length(maps.size, maps.real.len())?;
    check_length(maps.size, maps.simulated.len())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bar_ends_at_the_largest_count_of_both_maps() {
        let size = Size::new(2, 1);
        let maps = CountMaps { size, real: &[3, 0], simulated: &[1, 345] };
        let figure = counts_figure(&maps).unwrap();
        for panel in &figure.panels {
            assert!(panel.drawing.wide().contains(">345</text>"));
        }
        assert!(figure.panels[0].alt.contains("3 events in total, 50.0 % of the pixels active"));
        assert!(counts_figure(&CountMaps { real: &[1], ..maps }).is_err());
    }

    #[test]
    fn maps_without_any_event_can_still_be_drawn() {
        let size = Size::new(4, 2);
        let none = [0; 8];
        let maps = CountMaps { size, real: &none, simulated: &none };
        assert!(counts_figure(&maps).is_ok());
    }
}
