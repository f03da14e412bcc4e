//! A frame with the events of one window over it, real and simulated side by side.

use super::colour::{OFF, ON};
use super::image_panel;
use super::pixel_image::{PixelImage, PixelImageError, check_length};
use super::{Drawing, Ink};
use crate::figure::{Figure, LegendEntry, LegendMark, Panel};
use crate::number::count;
use evrig_core::event::EventSlice;
use evrig_core::geometry::Size;
use evrig_core::stats::quantile_sorted;

/// Grey level of the brightest pixels of the dimmed frame.
pub(super) const BRIGHTEST_GRAY: u8 = 118;
/// Grey level of the darkest pixels, and without a frame.
const DARKEST_GRAY: u8 = 14;

/// One frame and the events about it.
#[derive(Debug, Clone, Copy)]
pub struct Overlay<'a> {
    /// The pixel grid that frame and events share.
    pub size: Size,
    /// Brightness, row-major, any unit; `None` for a plain background.
    pub frame: Option<&'a [f32]>,
    /// The events shown: from the first time up to but not including the second, µs.
    pub window_us: [i64; 2],
    /// Origin of the times in the caption, µs.
    pub origin_us: i64,
    /// Real events in ascending time.
    pub real: EventSlice<'a>,
    /// Simulated events in ascending time.
    pub simulated: EventSlice<'a>,
}

/// The frame with real events beside the same frame with simulated ones.
///
/// # Errors
/// When the frame's length does not fit the grid, or the grid has no pixels.
pub fn figure(overlay: &Overlay<'_>) -> Result<Figure, PixelImageError> {
    let ground = ground(overlay)?;
    let [from, to] = overlay.window_us;
    let start_s = (from.saturating_sub(overlay.origin_us)) as f64 * 1e-6;
    let window_ms = (to.saturating_sub(from)) as f64 * 1e-3;
    let panels = [("Recorded", overlay.real), ("Generated", overlay.simulated)];
    let panels = panels.into_iter().map(|(title, events)| {
        let shown = events.between(from, to);
        let mut image = ground.clone();
        for event in shown.iter() {
            image.set(event.x, event.y, if event.on { ON } else { OFF });
        }
        let n_on = shown.count_on();
        let (on, off) = (count(n_on as u64), count((shown.len() - n_on) as u64));
        Ok(Panel {
            title: title.to_owned(),
            note: format!("{on} ON, {off} OFF"),
            alt: format!(
                "{title} events over the frame in the {window_ms:.1} ms from {start_s:.3} s: {on} \
                 ON and {off} OFF."
            ),
            drawing: Drawing::single(image_panel::draw(&image, None, overlay.size, None)?),
        })
    });
    Ok(Figure {
        title: "Frame with events".to_owned(),
        caption: format!(
            "Events of the {window_ms:.1} ms from {start_s:.3} s over the frame they belong to. \
             Compare position, polarity and thickness of the edges. Isolated events are noise."
        ),
        legend: vec![
            LegendEntry::new(Ink::On, LegendMark::Pixel, "ON (brightness increased)"),
            LegendEntry::new(Ink::Off, LegendMark::Pixel, "OFF (brightness decreased)"),
        ],
        panels: panels.collect::<Result<_, PixelImageError>>()?,
        data: None,
    })
}

/// The dimmed frame: 1 % to 99 % of its brightness on the dark greys.
fn ground(overlay: &Overlay<'_>) -> Result<PixelImage, PixelImageError> {
    let Some(frame) = overlay.frame else {
        return Ok(PixelImage::from_fn(overlay.size, |_| [DARKEST_GRAY; 3]));
    };
    check_length(overlay.size, frame.len())?;
    let mut sorted: Vec<f64> =
        frame.iter().map(|v| f64::from(*v)).filter(|v| v.is_finite()).collect();
    sorted.sort_by(f64::total_cmp);
    let [dark, bright] = [0.01, 0.99].map(|q| quantile_sorted(&sorted, q));
    let span = if bright > dark { bright - dark } else { 1.0 };
    let reach = f64::from(BRIGHTEST_GRAY - DARKEST_GRAY);
    Ok(PixelImage::from_fn(overlay.size, |i| {
        let share = ((f64::from(frame[i]) - dark) / span).clamp(0.0, 1.0);
        let share = if share.is_nan() { 0.0 } else { share };
        [DARKEST_GRAY + (share * reach).round() as u8; 3]
    }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use evrig_core::event::{Event, Events};

    #[test]
    fn only_the_window_is_counted_and_a_frame_of_wrong_size_is_refused() {
        let events: Events =
            (0..10).map(|t| Event { t, x: t as u16, y: 0, on: t % 2 == 0 }).collect();
        let frame = vec![1.0; 10];
        let overlay = Overlay {
            size: Size::new(10, 1),
            frame: Some(&frame),
            window_us: [2, 7],
            origin_us: 0,
            real: events.as_slice(),
            simulated: events.as_slice().range(0, 0),
        };
        let figure = figure(&overlay).unwrap();
        assert_eq!(figure.panels[0].note, "3 ON, 2 OFF");
        assert_eq!(figure.panels[1].note, "0 ON, 0 OFF");
        let wrong = Overlay { frame: Some(&frame[1..]), ..overlay };
        let error = super::figure(&wrong).unwrap_err().to_string();
        assert!(error.contains("needs 10 values, got 9"), "{error}");
    }
}
