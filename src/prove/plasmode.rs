//! A real recording with an effect applied to it.
//!
//! What a real camera does stays in it; what was applied is known exactly. Effects of the
//! pixels and the readout act on the events, effects of the frames on the frames; the other
//! stream stays as it was.

mod events;
mod frames;
mod recording;

pub use recording::{APPLICABLE, PlasmodeError, PlasmodeRecording};

use super::truth::ConcealedEffect;
use evrig_core::stats::SplitMix;

impl PlasmodeRecording {
    /// Applies an effect; the same seed does the same.
    ///
    /// # Errors
    /// When no way is known to apply it, or a parameter is missing.
    pub fn apply(&mut self, effect: &ConcealedEffect, seed: u64) -> Result<(), PlasmodeError> {
        let id = effect.id.as_str();
        let number = |key: &'static str| {
            let value = effect.parameters.get(key).copied();
            value.ok_or_else(|| PlasmodeError::Parameter { id: id.to_owned(), key })
        };
        let mut random = SplitMix::new(seed, 0);
        match id {
            "refractory_period" => events::refractory(self, number("refractory_us")?)?,
            "event_drop" => events::drop_share(self, number("fraction")?, &mut random),
            "dead_pixels" => events::kill_pixels(self, number("count")?, &mut random)?,
            "hot_pixels" => {
                let n = number("fraction")? * self.size.n_pixels() as f64;
                events::heat_pixels(self, n, number("rate_hz")?, &mut random);
            }
            "background_activity" => {
                let rate_hz = number("rate_hz")?;
                events::heat_pixels(self, self.size.n_pixels() as f64, rate_hz, &mut random);
            }
            "shot_noise" => {
                let (rate_hz, lag_us) = (number("rate_hz")?, number("lag_us")?);
                events::alternate(self, rate_hz, lag_us, &mut random);
            }
            "burst_loss" => {
                let (share, window_us) = (number("share")?, number("window_us")?);
                events::drop_bursts(self, share, window_us, &mut random);
            }
            "stamp_jitter" => events::jitter(self, number("sigma_us")?, &mut random),
            "clock_offset" => events::retime(self, number("offset_us")?, 0.0),
            "clock_skew" => events::retime(self, 0.0, number("skew_ppm")?),
            "black_level" => frames::change(self, frames::pedestal(number("offset_dn")?)),
            "tone_curve" => frames::change(self, frames::gamma(number("gamma")?)),
            "defocus" => frames::blur(self, number("sigma_px")?),
            _ => return Err(PlasmodeError::NotApplicable { id: id.to_owned() }),
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use evrig_core::event::Event;
    use evrig_core::event::Events;
    use evrig_core::frame::Frame;
    use evrig_core::frame::{FrameTiming, Samples};
    use evrig_core::geometry::Size;
    use evrig_core::time::Stamp;

    const SIZE: Size = Size { width: 12, height: 8 };

    fn recording() -> PlasmodeRecording {
        let mut random = SplitMix::new(1, 1);
        let mut events = Events::new();
        for i in 0..20_000_i64 {
            let (x, y) = (random.below(12) as u16, random.below(8) as u16);
            events.push(Event { t: 1_000_000 + i * 50, x, y, on: random.bits() >> 63 == 1 });
        }
        let frames = (0..5_i64).map(|i| {
            Frame::gray(
                FrameTiming::from_stamp(Stamp::from_micros(1_000_000 + i * 200_000)),
                SIZE,
                Samples::U8((0..96).map(|p| if p % 12 < 6 { 40 } else { 160 }).collect()),
            )
        });
        PlasmodeRecording { size: SIZE, events, frames: frames.collect() }
    }

    fn applied(id: &str, parameters: &[(&str, f64)]) -> PlasmodeRecording {
        let parameters = parameters.iter().map(|&(key, value)| (key.to_owned(), value)).collect();
        let mut changed = recording();
        changed.apply(&ConcealedEffect { id: id.into(), parameters, strength: 1.0 }, 7).unwrap();
        assert_eq!(changed.events.as_slice().first_disorder(), None, "{id}");
        changed
    }

    fn shortest_interval(recording: &PlasmodeRecording) -> i64 {
        let mut last = [i64::MIN / 2; 96];
        let intervals = recording.events.as_slice().iter().map(|e| {
            let last = &mut last[usize::from(e.y) * 12 + usize::from(e.x)];
            let interval = e.t - *last;
            *last = e.t;
            interval
        });
        intervals.min().unwrap()
    }

    #[test]
    fn a_dead_time_leaves_a_hole_in_the_intervals() {
        let changed = applied("refractory_period", &[("refractory_us", 5_000.0)]);
        assert!(shortest_interval(&recording()) < 1_000);
        assert!(shortest_interval(&changed) >= 5_000);
        assert_eq!(changed.frames, recording().frames);
    }

    #[test]
    fn shares_counts_and_rates_are_the_stated_ones() {
        let before = recording().events.len() as f64;
        let dropped = applied("event_drop", &[("fraction", 0.1)]).events.len() as f64;
        assert!((dropped / before - 0.9).abs() < 0.01, "{}", dropped / before);
        let killed = applied("dead_pixels", &[("count", 24.0)]).events.len() as f64;
        assert!((killed / before - 0.75).abs() < 0.02, "{}", killed / before);
        let busy = applied("background_activity", &[("rate_hz", 50.0)]).events.len() as f64;
        assert!(((busy - before) / (96.0 * 50.0) - 1.0).abs() < 0.06, "{}", busy - before);
        let rate_and_lag = [("rate_hz", 50.0), ("lag_us", 2_000.0)];
        let noisy = applied("shot_noise", &rate_and_lag).events.len() as f64;
        // Pairs double the scatter of a count, and the last one of a pixel may not fit.
        assert!(((noisy - before) / (96.0 * 50.0) - 1.0).abs() < 0.1, "{}", noisy - before);
        let cut = applied("burst_loss", &[("share", 0.3), ("window_us", 5_000.0)]);
        // 200 windows: five standard errors.
        assert!((cut.events.len() as f64 / before - 0.7).abs() < 0.16, "{}", cut.events.len());
    }

    #[test]
    fn clocks_shift_and_stretch() {
        let (before, late) = (recording(), applied("clock_offset", &[("offset_us", 1_234.0)]));
        assert_eq!(late.events.as_slice().t[0] - before.events.as_slice().t[0], 1_234);
        let fast = applied("clock_skew", &[("skew_ppm", 1_000.0)]);
        let span = |r: &PlasmodeRecording| {
            r.events.as_slice().t.last().unwrap() - r.events.as_slice().t[0]
        };
        assert_eq!(span(&fast) - span(&before), 1_000);
    }

    #[test]
    fn frames_change_and_events_stay() {
        let pedestal = applied("black_level", &[("offset_dn", 10.0)]);
        assert_eq!(pedestal.events, recording().events);
        let first = |r: &PlasmodeRecording| match &r.frames[0].samples {
            Samples::U8(samples) => samples.clone(),
            Samples::U16(_) => Vec::new(),
        };
        assert_eq!((first(&pedestal)[0], first(&pedestal)[11]), (50, 170));
        let blurred = first(&applied("defocus", &[("sigma_px", 1.0)]));
        // Beside the edge: half a pixel of a Gaussian step from its middle, 0.6915 of the way.
        assert!((i32::from(blurred[6]) - 123).abs() <= 3, "{}", blurred[6]);
        assert!(blurred[0] <= 41 && blurred[11] >= 159);
        let curved = first(&applied("tone_curve", &[("gamma", 0.5)]));
        assert_eq!(curved[0], (255.0_f64 * (40.0_f64 / 255.0).sqrt()).round() as u8);
    }

    #[test]
    fn a_recording_comes_back_from_its_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("changed.aedat4");
        let changed = applied("stamp_jitter", &[("sigma_us", 300.0)]);
        changed.write(&path).unwrap();
        let read = PlasmodeRecording::read(&path).unwrap();
        assert_eq!(read.events, changed.events);
        assert_eq!(read.frames.len(), 5);
        assert_eq!(read.frames[3].samples, changed.frames[3].samples);
    }

    #[test]
    fn what_cannot_be_applied_is_refused_by_name() {
        let mut recording = recording();
        let effect =
            |id: &str| ConcealedEffect { id: id.into(), parameters: [].into(), strength: 1.0 };
        let error = recording.apply(&effect("flicker"), 0).unwrap_err().to_string();
        assert!(error.contains("flicker") && error.contains("defocus"), "{error}");
        let error = recording.apply(&effect("defocus"), 0).unwrap_err().to_string();
        assert!(error.contains("sigma_px"), "{error}");
    }
}
