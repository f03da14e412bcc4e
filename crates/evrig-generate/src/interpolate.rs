//! Log-linear interpolation between frames, which reduces events locked to the frame rate.

use crate::parameter_error::{ParameterError, check};
use evrig_core::frame::Luminance;

/// Lower bound of brightness, DN: half a digital step.
const FLOOR_DN: f32 = 0.5;

/// Inserts frames between frames, linear in log brightness.
#[derive(Debug, Clone)]
pub struct Interpolator {
    step_us: i64,
    before: Option<Luminance>,
}

impl Interpolator {
    /// Gaps of this length or more are not interpolated, µs.
    pub(super) const BREAK_US: i64 = 1_000_000;

    /// No two output frames are farther apart than `step_us`, 10 to 1,000,000.
    ///
    /// # Errors
    /// A step out of range.
    pub fn new(step_us: u32) -> Result<Self, ParameterError> {
        check("interpolate_us", f64::from(step_us), 10.0, 1e6)?;
        Ok(Self { step_us: i64::from(step_us), before: None })
    }

    /// Passes the frames after the previous one up to this one to `take`, this one unchanged.
    /// Frames that a generator would refuse are passed alone, so that it reports them.
    ///
    /// # Errors
    /// Errors of `take`.
    pub fn push<E>(
        &mut self,
        frame: Luminance,
        mut take: impl FnMut(&Luminance) -> Result<(), E>,
    ) -> Result<(), E> {
        if let Some(before) = self.before.take() {
            let span_us = frame.t_us.saturating_sub(before.t_us);
            let fits = before.size == frame.size && (1..Self::BREAK_US).contains(&span_us);
            let n = if fits { (span_us + self.step_us - 1) / self.step_us } else { 1 };
            for i in 1..n {
                take(&between(
                    &before,
                    &frame,
                    i as f32 / n as f32,
                    before.t_us + span_us * i / n,
                ))?;
            }
        }
        take(&frame)?;
        self.before = Some(frame);
        Ok(())
    }
}

/// The frame at a fraction of the interval between two, linear in log brightness.
pub(super) fn between(before: &Luminance, after: &Luminance, share: f32, t_us: i64) -> Luminance {
    let mix = |(a, b): (&f32, &f32)| {
        if a == b {
            return *a;
        }
        let (a, b) = (a.max(FLOOR_DN), b.max(FLOOR_DN));
        a * (b / a).powf(share)
    };
    let values = before.values.iter().zip(&after.values).map(mix).collect();
    Luminance { t_us, size: before.size, values }
}

#[cfg(test)]
mod tests {
    use super::*;
    use evrig_core::geometry::Size;

    fn frame(t_us: i64, value: f32) -> Luminance {
        Luminance { t_us, size: Size::new(1, 1), values: vec![value] }
    }

    fn taken(frames: &[Luminance]) -> Vec<(i64, f32)> {
        let mut interpolator = Interpolator::new(2_000).unwrap();
        let mut found = Vec::new();
        for frame in frames {
            let take = |f: &Luminance| -> Result<(), ()> {
                found.push((f.t_us, f.values[0]));
                Ok(())
            };
            interpolator.push(frame.clone(), take).unwrap();
        }
        found
    }

    #[test]
    fn brightness_between_frames_is_straight_in_the_logarithm() {
        let found = taken(&[frame(1_000, 10.0), frame(9_333, 160.0)]);
        assert_eq!(found.len(), 6);
        for (t, value) in &found {
            let share = (*t - 1_000) as f32 / 8_333.0;
            assert!((value.ln() - (10.0_f32.ln() + share * 16.0_f32.ln())).abs() < 1e-3);
        }
        assert!(found.windows(2).all(|pair| (1..=2_000).contains(&(pair[1].0 - pair[0].0))));
    }

    #[test]
    fn breaks_and_wrong_frames_pass_as_they_are() {
        let found = taken(&[frame(0, 1.0), frame(5_000_000, 2.0), frame(5_000_000, 3.0)]);
        assert_eq!(found, [(0, 1.0), (5_000_000, 2.0), (5_000_000, 3.0)]);
        assert!(Interpolator::new(1).unwrap_err().to_string().contains("interpolate_us"));
    }
}
