//! Row times of a rolling shutter.
//!
//! The frame interval has the same length for every row and is shifted by the row's delay. A pixel
//! law depends on interval lengths only, so the events of a rolling-shutter frame are those of a
//! frame of one instant, each shifted by the delay of its row.

use evrig_core::event::{Event, Events};
use evrig_core::geometry::Size;

/// Exposure times of the rows of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct RowTimes {
    /// Delay from row to row, µs; 0 for a global shutter.
    pub row_us: f64,
    /// The row at whose time the frame's time is.
    pub at_row: f64,
}

impl RowTimes {
    /// Rows `row_us` apart in frames of `size` whose time is that of the middle row.
    #[must_use]
    pub fn about_middle(row_us: f64, size: Size) -> Self {
        Self { row_us, at_row: f64::from(size.height / 2) }
    }

    /// Delay of row `y` behind the frame's time, µs.
    #[must_use]
    pub fn after_us(&self, y: f64) -> f64 {
        (y - self.at_row) * self.row_us
    }
}

/// Shifts events to their rows' times, interval by interval, in ascending time.
#[derive(Debug, Default)]
pub struct RowShift {
    waiting: Vec<Event>,
}

impl RowShift {
    /// Takes in the events of the interval that ends at `end_us`, and appends to `out` those that
    /// no later interval can precede.
    pub fn push(
        &mut self,
        rows: RowTimes,
        size: Size,
        end_us: i64,
        made: &Events,
        out: &mut Events,
    ) {
        if rows.row_us == 0.0 && self.waiting.is_empty() {
            return out.extend_from_slice(made.as_slice());
        }
        let delays: Vec<i64> =
            (0..size.height).map(|y| rows.after_us(f64::from(y)).round() as i64).collect();
        let delay = |y: u16| delays.get(usize::from(y)).copied().unwrap_or(0);
        self.waiting.extend(made.as_slice().iter().map(|e| Event { t: e.t + delay(e.y), ..e }));
        self.waiting.sort_by_key(|event| (event.t, event.y, event.x));
        let earliest = end_us + delays.iter().copied().min().unwrap_or(0);
        let n = self.waiting.partition_point(|event| event.t <= earliest);
        self.waiting.drain(..n).for_each(|event| out.push(event));
    }

    /// Appends the events still held back.
    pub fn finish(&mut self, out: &mut Events) {
        self.waiting.drain(..).for_each(|event| out.push(event));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::voltmeter::Coefficients;
    use crate::{EsimParameters, GenerateParameters, ModelParameters, build};
    use evrig_core::frame::Luminance;

    const SIZE: Size = Size { width: 3, height: 100 };

    #[test]
    fn an_edge_of_light_in_time_reaches_each_row_at_its_own_instant() {
        // Light that rises evenly in the logarithm, by 5 in a second, seen row after row.
        let rows = RowTimes::about_middle(40.0, SIZE);
        let seen = |t_us: i64| {
            let value = |i: usize| {
                let at = t_us as f64 + rows.after_us((i / 3) as f64);
                (2.0 + 5e-6 * at).exp() as f32
            };
            Luminance { t_us, size: SIZE, values: (0..SIZE.n_pixels()).map(value).collect() }
        };
        let parameters =
            EsimParameters { threshold_on: 0.1, log_offset: 1e-9, ..EsimParameters::PUBLISHED };
        let model = ModelParameters::Esim(parameters);
        let parameters =
            GenerateParameters { model, ..GenerateParameters::from_k(Coefficients::DVS346, 0) };
        let mut generator = build(&parameters, None).unwrap();
        let (mut shift, mut out) = (RowShift::default(), Events::new());
        for i in 0..30 {
            let frame = seen(i * 8_333);
            let mut made = Events::new();
            generator.push(&frame, &mut made).unwrap();
            shift.push(rows, SIZE, frame.t_us, &made, &mut out);
        }
        shift.finish(&mut out);
        assert_eq!(out.as_slice().first_disorder(), None);
        for y in [0, 20, 50, 99] {
            let first = out.as_slice().iter().find(|event| event.y == y).unwrap();
            // A row's own first light lies off zero, and its tenth of a unit takes 20 ms from
            // there.
            let expected = rows.after_us(f64::from(y)) + 20_000.0;
            assert!((first.t as f64 - expected).abs() < 3.0, "row {y}: {} {expected}", first.t);
        }
        let n = out.len();
        assert_eq!(n, 300 * 12, "nothing is lost on the way");
    }

    #[test]
    fn a_global_shutter_is_left_as_it_is() {
        let made: Events = (0..5).map(|t| Event { t, x: 0, y: 50, on: true }).collect();
        let mut out = Events::new();
        RowShift::default().push(RowTimes::default(), SIZE, 9, &made, &mut out);
        assert_eq!(out, made);
    }
}
