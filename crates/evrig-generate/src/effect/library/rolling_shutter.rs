//! Rolling shutter: rows of a frame follow each other otherwise than stated.
//!
//! Row y shows light `y * row_us` later than the frame's record states, so the pixel sees it later
//! than the drive states. Rows are counted on the event camera. Signature: a lag linear in the row.

use crate::effect::model::EffectModel;
use crate::effect::pixel_site::PixelSite;

effect! {
    /// A delay from row to row beyond the stated one.
    RollingShutter, Frames, "t_row = t_0 + y (T_stated + T)" {
        /// True row time less the stated one, µs.
        row_us: -1000.0 to 1000.0,
    }
}

impl EffectModel for RollingShutter {
    fn lag_us(&self, site: &PixelSite<'_>) -> f64 {
        self.row_us * f64::from(site.y)
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::test_support::*;
    use evrig_core::event::Event;

    #[test]
    fn the_lag_grows_from_row_to_row() {
        let light = passing(2.0, -1.0);
        let rows = |events: Vec<Event>, y: u16| -> Vec<Event> {
            events.into_iter().filter(|e| e.y == y).collect()
        };
        let plain = events(&light, 2.0, &[]);
        let late = events(&light, 2.0, &["rolling_shutter:row_us=400"]);
        let (mut lag, mut square) = (0.0, 0.0);
        for y in 0..SIZE.height {
            let found = phase_lag(&rows(plain.clone(), y), &rows(late.clone(), y), 2.0);
            lag += found * f64::from(y);
            square += f64::from(y).powi(2);
        }
        // Where a pixel starts is late as well, which moves all its levels: a tenth or so.
        assert!((lag / square / 400.0 - 1.0).abs() < 0.15, "{}", lag / square);
    }
}
