//! The run of frames: each later than the one before, of one size, with finite brightness.

use crate::generator::GenerateError;
use crate::limits::MAX_SPAN_US;
use evrig_core::frame::Luminance;
use evrig_core::geometry::Size;

/// A day, µs: a longer pause is a wrong unit.
const MAX_PAUSE_US: i64 = 86_400_000_000;

/// The interval between two frames.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct FrameSpan {
    /// Number of the frame at its end.
    pub(super) index: u64,
    /// Time of the frame at its start, µs.
    pub(super) start_us: i64,
    /// Its length, µs: 1..=MAX_SPAN_US.
    pub(super) span_us: u32,
    /// The highest brightness in the frames at its ends.
    pub(super) brightest: f32,
}

/// A frame that may follow.
#[derive(Debug, Clone, Copy)]
pub(super) struct CheckedFrame {
    /// The interval it ends; none for the first frame, and for one behind a pause that is too long.
    pub(super) interval: Option<FrameSpan>,
    last: LastFrame,
}

#[derive(Debug, Clone, Copy)]
struct LastFrame {
    size: Size,
    t_us: i64,
    brightest: f32,
}

/// What has been seen of a run of frames.
#[derive(Debug, Clone, Default)]
pub(super) struct FrameSequence {
    n_frames: u64,
    last: Option<LastFrame>,
}

impl FrameSequence {
    /// Checks the next frame without taking it in.
    pub(super) fn check(&self, frame: &Luminance) -> Result<CheckedFrame, GenerateError> {
        let index = self.n_frames;
        if let Some(last) = self.last {
            if last.size != frame.size {
                let (expected, found) = (last.size, frame.size);
                return Err(GenerateError::SizeChanged { index, expected, found });
            }
            if frame.t_us <= last.t_us {
                let (t_us, previous_us) = (frame.t_us, last.t_us);
                return Err(GenerateError::TimeNotAscending { index, t_us, previous_us });
            }
            if frame.t_us.checked_sub(last.t_us).is_none_or(|span| span > MAX_PAUSE_US) {
                let (t_us, previous_us) = (frame.t_us, last.t_us);
                return Err(GenerateError::GapTooLong { index, t_us, previous_us });
            }
        }
        let brightest = check_pixels(index, frame)?;
        // What a pixel did in a pause of more than half an hour is not known: it begins anew.
        let interval = self.last.and_then(|last| {
            let span = frame.t_us.checked_sub(last.t_us).filter(|span| *span <= MAX_SPAN_US)?;
            Some(FrameSpan {
                index,
                start_us: last.t_us,
                span_us: span as u32,
                brightest: brightest.max(last.brightest),
            })
        });
        Ok(CheckedFrame {
            interval,
            last: LastFrame { size: frame.size, t_us: frame.t_us, brightest },
        })
    }

    /// Takes in a frame that was checked.
    pub(super) fn accept(&mut self, checked: CheckedFrame) {
        self.n_frames += 1;
        self.last = Some(checked.last);
    }
}

/// Checks every value and returns the highest.
fn check_pixels(index: u64, frame: &Luminance) -> Result<f32, GenerateError> {
    let (expected, found) = (frame.size.n_pixels(), frame.values.len());
    if expected != found {
        return Err(GenerateError::WrongLength { index, size: frame.size, expected, found });
    }
    if let Some(brightest) = brightest_of_good(&frame.values) {
        return Ok(brightest);
    }
    let bad = frame.values.iter().position(|&value| !is_good(value)).unwrap_or_default();
    let width = usize::from(frame.size.width);
    let (x, y) = ((bad % width) as u16, (bad / width) as u16);
    Err(GenerateError::BadBrightness { index, x, y, value: frame.values[bad] })
}

fn is_good(value: f32) -> bool {
    (0.0..=f32::MAX).contains(&value)
}

/// The highest value, or none when a value is bad: several values at a time, as the frame is
/// read once more for this alone.
fn brightest_of_good(values: &[f32]) -> Option<f32> {
    const LANES: usize = 16;
    let (parts, rest) = values.as_chunks::<LANES>();
    let (mut highest, mut n_bad) = ([0.0_f32; LANES], [0_u32; LANES]);
    for part in parts {
        for i in 0..LANES {
            n_bad[i] += u32::from(!((part[i] >= 0.0) & (part[i] <= f32::MAX)));
            highest[i] = if part[i] > highest[i] { part[i] } else { highest[i] };
        }
    }
    let is_bad = n_bad.iter().any(|&n| n > 0) || !rest.iter().copied().all(is_good);
    (!is_bad).then(|| highest.iter().chain(rest).copied().fold(0.0, f32::max))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pause_of_an_hour_begins_anew_and_one_of_two_days_is_refused() {
        let frame = |t_us| Luminance { t_us, size: Size::new(1, 1), values: vec![1.0] };
        let mut sequence = FrameSequence::default();
        for (t_us, has_interval) in [(0, false), (1_000, true), (3_600_000_000, false)] {
            let checked = sequence.check(&frame(t_us)).unwrap();
            assert_eq!(checked.interval.is_some(), has_interval, "{t_us}");
            sequence.accept(checked);
        }
        assert!(sequence.check(&frame(172_800_000_000)).is_err());
    }
}
