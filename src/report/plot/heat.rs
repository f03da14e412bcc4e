//! Maps of event counts: real and simulated on one scale, and where they differ.

use super::Drawing;
use super::colour::{Rgb, diverging_dark, diverging_light, sequential};
use super::panel::{self, Bar};
use super::picture::{Picture, PictureError, check_length};
use super::scale::{Kind, plain};
use crate::geometry::Size;
use crate::report::figure::{Figure, Panel};
use crate::report::number::count;

/// Colour of a pixel without events, below the scale.
const NO_EVENT: Rgb = [0, 12, 32];
/// Pixels of a colour bar.
const BAR: Size = Size::new(256, 1);
/// A cell of the ratio map holds at least this many events on average, so that chance does not paint it.
const EVENTS_A_CELL: f64 = 20.0;
/// The ratio map's largest factor, as a power of two; beyond it the colour stays.
const MAX_LOG2: f64 = 3.0;

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
pub fn counts_figure(maps: &CountMaps<'_>) -> Result<Figure, PictureError> {
    check(maps)?;
    let max = maps.real.iter().chain(maps.simulated).copied().max().unwrap_or(0).max(2);
    let top = f64::from(max);
    let bar = Bar {
        label: "events per pixel (log scale; darkest: none)".to_owned(),
        kind: Kind::Log,
        range: [1.0, top],
        ticks: None,
        light: Picture::from_fn(BAR, |i| sequential(i as f64 / 255.0)),
        dark: None,
    };
    let panel = |title: &str, counts: &[u32]| {
        let picture = Picture::from_fn(maps.size, |i| match counts[i] {
            0 => NO_EVENT,
            n => sequential(f64::from(n).ln() / top.ln()),
        });
        let total = counts.iter().map(|n| u64::from(*n)).sum::<u64>();
        let n_active = counts.iter().filter(|n| **n > 0).count();
        let active = 100.0 * n_active as f64 / counts.len().max(1) as f64;
        Ok::<_, PictureError>(Panel {
            title: title.to_owned(),
            note: format!("{} events", count(total)),
            alt: format!(
                "Map of {} events per pixel: {} events in total, {active:.1} % of the pixels active.",
                title.to_lowercase(),
                count(total)
            ),
            drawing: Drawing::single(panel::draw(&picture, None, maps.size, Some(&bar))?),
        })
    };
    Ok(Figure {
        title: "Events per pixel".to_owned(),
        caption: "Both maps share one colour scale, so equal colours are equal counts. \
                  Compare the brightness of the same edge, then the empty parts: light there is noise, \
                  and single bright pixels are hot ones."
            .to_owned(),
        legend: vec![],
        panels: vec![panel("Real", maps.real)?, panel("Simulated", maps.simulated)?],
        data: None,
    })
}

/// Where the simulation fires more or less often than the camera.
///
/// The counts are summed over square cells of 1, 2, 4, 8 or 16 pixels, the smallest that
/// hold enough events, and one event is added to both sides so that empty cells are equal.
///
/// # Errors
/// When a map's length does not fit the grid, or the grid has no pixels.
pub fn ratio_figure(maps: &CountMaps<'_>) -> Result<Figure, PictureError> {
    check(maps)?;
    let side = cell_side(maps);
    let cells = Size::new(maps.size.width.div_ceil(side), maps.size.height.div_ceil(side));
    let [real, simulated] =
        [maps.real, maps.simulated].map(|counts| sum_cells(maps.size, cells, side, counts));
    let log2: Vec<f64> =
        real.iter().zip(&simulated).map(|(r, s)| ((s + 1.0) / (r + 1.0)).log2()).collect();
    let light = Picture::from_fn(cells, |i| diverging_light(log2[i] / MAX_LOG2));
    let dark = Picture::from_fn(cells, |i| diverging_dark(log2[i] / MAX_LOG2));
    let at = |i: usize| i as f64 / 127.5 - 1.0;
    let factor = |v: i32| if v < 0 { format!("1/{}", 1 << -v) } else { format!("{}", 1 << v) };
    let bar = Bar {
        label: "simulated / real (factor; log scale)".to_owned(),
        kind: Kind::Linear,
        range: [-MAX_LOG2, MAX_LOG2],
        ticks: Some((-3..=3).map(|v| (f64::from(v), factor(v))).collect()),
        light: Picture::from_fn(BAR, |i| diverging_light(at(i))),
        dark: Some(Picture::from_fn(BAR, |i| diverging_dark(at(i)))),
    };
    let share = |holds: fn(f64) -> bool| {
        100.0 * log2.iter().filter(|v| holds(**v)).count() as f64 / log2.len().max(1) as f64
    };
    let (too_many, too_few) = (share(|v| v >= 1.0), share(|v| v <= -1.0));
    // The last row and column of cells may hang over the grid's edge by part of a cell.
    let drawn = Size::new(cells.width.saturating_mul(side), cells.height.saturating_mul(side));
    let svg = panel::draw(&light, Some(&dark), drawn, Some(&bar))?;
    Ok(Figure {
        title: "Where they differ".to_owned(),
        caption: format!(
            "Simulated over real events in cells of {side} x {side} pixels; one event is added on both sides. \
             Orange: the simulation fires too often; blue: too rarely; the page's own ground: equal. \
             The simulation fires at least twice as often in {too_many:.0} % of the cells and at most half as often in {too_few:.0} %."
        ),
        legend: vec![],
        panels: vec![Panel {
            title: "Simulated / real".to_owned(),
            note: format!("cells of {side} x {side} pixels"),
            alt: format!(
                "Map of the ratio of simulated to real events: at least twice as many in {} % of the cells, at most half as many in {} %.",
                plain(too_many, 0),
                plain(too_few, 0)
            ),
            drawing: Drawing::single(svg),
        }],
        data: None,
    })
}

fn check(maps: &CountMaps<'_>) -> Result<(), PictureError> {
    check_length(maps.size, maps.real.len())?;
    check_length(maps.size, maps.simulated.len())
}

fn cell_side(maps: &CountMaps<'_>) -> u16 {
    let total: u64 = maps.real.iter().chain(maps.simulated).map(|n| u64::from(*n)).sum();
    let per_pixel = 0.5 * total as f64 / maps.size.n_pixels().max(1) as f64;
    let is_enough = |side: &u16| per_pixel * f64::from(*side).powi(2) >= EVENTS_A_CELL;
    [1, 2, 4, 8].into_iter().find(is_enough).unwrap_or(16)
}

fn sum_cells(size: Size, cells: Size, side: u16, counts: &[u32]) -> Vec<f64> {
    let mut sums = vec![0.0; cells.n_pixels()];
    for y in 0..size.height {
        for x in 0..size.width {
            sums[cells.index(x / side, y / side)] += f64::from(counts[size.index(x, y)]);
        }
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_grow_until_they_hold_enough_events() {
        let size = Size::new(7, 5);
        let (dense, sparse) = (vec![30; 35], vec![1; 35]);
        let maps = CountMaps { size, real: &dense, simulated: &dense };
        assert_eq!(cell_side(&maps), 1);
        let maps = CountMaps { size, real: &sparse, simulated: &sparse };
        assert_eq!(cell_side(&maps), 8);
        let sums = sum_cells(size, Size::new(2, 2), 4, &sparse);
        assert_eq!(sums, [16.0, 12.0, 4.0, 3.0], "no event is lost at the edges");
    }

    #[test]
    fn the_alternative_text_tells_the_share_that_differs() {
        let size = Size::new(4, 1);
        let (real, simulated) = ([100, 100, 100, 100], [100, 300, 20, 100]);
        let maps = CountMaps { size, real: &real, simulated: &simulated };
        let figure = ratio_figure(&maps).unwrap();
        assert!(figure.panels[0].alt.contains("twice as many in 25 %"), "{}", figure.panels[0].alt);
        assert!(figure.panels[0].alt.contains("half as many in 25 %"));
        assert!(
            counts_figure(&CountMaps { size, real: &real[1..], simulated: &simulated }).is_err()
        );
    }

    #[test]
    fn maps_without_any_event_can_still_be_drawn() {
        let size = Size::new(4, 2);
        let none = [0; 8];
        let maps = CountMaps { size, real: &none, simulated: &none };
        assert!(counts_figure(&maps).is_ok() && ratio_figure(&maps).is_ok());
    }
}
