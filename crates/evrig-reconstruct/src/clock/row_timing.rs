//! Exposure time of a row in a rolling-shutter frame.

use evrig_core::time::{Clock, Span, Stamp};
use serde::{Deserialize, Serialize};

/// Relation of the stamp to the first row's exposure.
///
/// Sources disagree by a whole exposure; measure it on the rig (a light that switches within a
/// frame) and state it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ExposureSign {
    /// The first pixel is read out at the stamp: its exposure ended.
    #[default]
    EndsAtStamp,
    /// The exposure of the first row starts at the stamp.
    StartsAtStamp,
    /// The stamp is the middle, as some drivers compute it.
    MiddleAtStamp,
}

/// Row times of a frame relative to its stamp.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct RowTiming {
    /// From one row's exposure to the next; zero for a global shutter.
    pub row_time: Span,
    /// Exposure of a row.
    pub exposure: Span,
    /// Relation of the stamp to the exposure.
    pub sign: ExposureSign,
    /// From the stamp to the first row, for rows read before the image (embedded data).
    pub first_row: Span,
    /// Rows cropped above the image: row 0 of the image is this row of the sensor's output.
    pub first_row_number: u32,
}

impl RowTiming {
    /// Mid-exposure of `row` of the image (fractions are positions between rows).
    #[must_use]
    pub fn middle<C: Clock>(&self, stamp: Stamp<C>, row: f64) -> Stamp<C> {
        let rows = row + f64::from(self.first_row_number);
        let delay = Span::from_nanos((rows * self.row_time.as_nanos() as f64).round() as i64);
        let half = Span::from_nanos(self.exposure.as_nanos() / 2);
        let at = stamp + self.first_row + delay;
        match self.sign {
            ExposureSign::EndsAtStamp => at - half,
            ExposureSign::StartsAtStamp => at + half,
            ExposureSign::MiddleAtStamp => at,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use evrig_core::time::PiSensor;

    #[test]
    fn a_lower_row_sees_light_later_and_the_sign_moves_it_by_one_exposure() {
        // IMX708 at 1536x864: 9.209 us a row; the middle 520 of 864 rows begin at row 172.
        let end = RowTiming {
            row_time: Span::from_nanos(9_209),
            exposure: Span::from_micros(4_000),
            first_row_number: 172,
            ..RowTiming::default()
        };
        let start = RowTiming { sign: ExposureSign::StartsAtStamp, ..end };
        let stamp = Stamp::<PiSensor>::from_nanos(0);
        assert_eq!(end.middle(stamp, 0.0).as_nanos(), 172 * 9_209 - 2_000_000);
        assert_eq!(end.middle(stamp, 260.5) - end.middle(stamp, 0.0), Span::from_nanos(2_398_945));
        assert_eq!(start.middle(stamp, 3.0) - end.middle(stamp, 3.0), end.exposure);
    }
}
