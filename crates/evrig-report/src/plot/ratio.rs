//! Map of the ratio of generated to recorded events.

use super::Drawing;
use super::colour::{diverging_dark, diverging_light};
use super::heat::{BAR, CountMaps, check};
use super::image_panel::{self, Bar};
use super::pixel_image::{PixelImage, PixelImageError};
use super::scale::{ScaleKind, plain};
use crate::figure::{Figure, Panel};
use evrig_core::geometry::Size;

/// Mean number of events (real and simulated) per cell down to which cells are divided.
const EVENTS_PER_CELL: u64 = 100;
/// Side of the largest cells, pixels; a power of two.
const LARGEST_CELL: u16 = 32;
/// Bound of the colour scale, log2 of the ratio.
const MAX_LOG2: f64 = 3.0;

/// The ratio of simulated to real events in adaptive cells. One event is added to both sides.
///
/// # Errors
/// When a map's length does not fit the grid, or the grid has no pixels.
pub fn figure(maps: &CountMaps<'_>) -> Result<Figure, PixelImageError> {
    check(maps)?;
    let log2 = log2_ratio(maps);
    let light = PixelImage::from_fn(maps.size, |i| diverging_light(log2[i] / MAX_LOG2));
    let dark = PixelImage::from_fn(maps.size, |i| diverging_dark(log2[i] / MAX_LOG2));
    let share = |holds: fn(f64) -> bool| {
        let n = log2.iter().filter(|v| holds(**v)).count();
        plain(100.0 * n as f64 / log2.len().max(1) as f64, 0)
    };
    let (too_many, too_few) = (share(|v| v >= 1.0), share(|v| v <= -1.0));
    Ok(Figure {
        title: "Ratio of event counts".to_owned(),
        caption: format!(
            "Generated over recorded events. Orange: too many generated events; blue: too few; \
             background colour: equal. Cells are 1 to {LARGEST_CELL} pixels wide with about \
             {EVENTS_PER_CELL} events or more. The ratio is at least 2 on {too_many} % of the \
             area and at most 1/2 on {too_few} %. Differences along edges indicate contrast or \
             bandwidth, on one side of edges polarity, elsewhere noise or leak."
        ),
        legend: vec![],
        panels: vec![Panel {
            title: "Simulated / real".to_owned(),
            note: String::new(),
            alt: format!(
                "Map of the ratio of generated to recorded events: at least twice as many on \
                 {too_many} % of the area, at most half as many on {too_few} %."
            ),
            drawing: Drawing::single(image_panel::draw(
                &light,
                Some(&dark),
                maps.size,
                Some(&bar()),
            )?),
        }],
        data: None,
    })
}

fn bar() -> Bar {
    let at = |i: usize| i as f64 / 127.5 - 1.0;
    let factor = |v: i32| if v < 0 { format!("1/{}", 1 << -v) } else { format!("{}", 1 << v) };
    Bar {
        label: "generated / recorded (factor; log scale)".to_owned(),
        kind: ScaleKind::Linear,
        range: [-MAX_LOG2, MAX_LOG2],
        ticks: Some((-3..=3).map(|v| (f64::from(v), factor(v))).collect()),
        light: PixelImage::from_fn(BAR, |i| diverging_light(at(i))),
        dark: Some(PixelImage::from_fn(BAR, |i| diverging_dark(at(i)))),
    }
}

/// log2 of the ratio of each pixel's cell.
fn log2_ratio(maps: &CountMaps<'_>) -> Vec<f64> {
    let mut log2 = vec![0.0; maps.size.n_pixels()];
    let steps = |n: u16| (0..n).step_by(LARGEST_CELL.into());
    for y in steps(maps.size.height) {
        for x in steps(maps.size.width) {
            paint(maps, RatioCell { x, y, side: LARGEST_CELL }, &mut log2);
        }
    }
    log2
}

/// A square of pixels, clipped to the grid.
#[derive(Clone, Copy)]
struct RatioCell {
    x: u16,
    y: u16,
    side: u16,
}

impl RatioCell {
    fn pixels(self, size: Size) -> impl Iterator<Item = usize> {
        let end = |from: u16, n: u16| from.saturating_add(self.side).min(n);
        let columns = self.x..end(self.x, size.width);
        (self.y..end(self.y, size.height))
            .flat_map(move |y| columns.clone().map(move |x| size.index(x, y)))
    }
}

fn paint(maps: &CountMaps<'_>, cell: RatioCell, log2: &mut [f64]) {
    let sum = |counts: &[u32]| cell.pixels(maps.size).map(|i| u64::from(counts[i])).sum::<u64>();
    let (real, simulated) = (sum(maps.real), sum(maps.simulated));
    if cell.side > 1 && real + simulated >= 4 * EVENTS_PER_CELL {
        let half = cell.side / 2;
        for (right, down) in [(0, 0), (half, 0), (0, half), (half, half)] {
            let quarter = RatioCell { x: cell.x + right, y: cell.y + down, side: half };
            if maps.size.contains(quarter.x, quarter.y) {
                paint(maps, quarter, log2);
            }
        }
        return;
    }
    let value = ((simulated as f64 + 1.0) / (real as f64 + 1.0)).log2();
    cell.pixels(maps.size).for_each(|i| log2[i] = value);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn busy_parts_are_cut_fine_and_quiet_ones_stay_whole() {
        let size = Size::new(70, 40);
        let mut real = vec![0; size.n_pixels()];
        let mut simulated = real.clone();
        (real[size.index(3, 2)], simulated[size.index(3, 2)]) = (399, 1_599);
        real[size.index(69, 39)] = 7;
        let log2 = log2_ratio(&CountMaps { size, real: &real, simulated: &simulated });
        assert!((log2[size.index(3, 2)] - 2.0).abs() < 1e-12, "one busy pixel is isolated");
        assert_eq!(log2[size.index(4, 2)], 0.0);
        assert!((log2[size.index(64, 32)] + 3.0).abs() < 1e-12, "a quiet corner is one cell");
        assert!((log2[size.index(69, 39)] + 3.0).abs() < 1e-12);
    }

    #[test]
    fn the_text_tells_the_share_of_the_area_that_differs() {
        let size = Size::new(4, 1);
        let maps = CountMaps { size, real: &[1000; 4], simulated: &[1000, 3000, 200, 1000] };
        let figure = figure(&maps).unwrap();
        assert!(figure.panels[0].alt.contains("twice as many on 25 %"), "{}", figure.panels[0].alt);
        assert!(figure.panels[0].alt.contains("half as many on 25 %"));
        assert!(super::figure(&CountMaps { real: &[1], ..maps }).is_err());
    }

    #[test]
    fn a_grid_as_large_as_can_be_said_does_not_overflow() {
        let size = Size::new(u16::MAX, 1);
        let counts = vec![50; size.n_pixels()];
        let log2 = log2_ratio(&CountMaps { size, real: &counts, simulated: &counts });
        assert!(log2.iter().all(|v| *v == 0.0));
    }
}
