//! Parameters of one pixel: thresholds, leak, noise, background, refractory period, losses.

/// Scale of a logistic distribution over its standard deviation: sqrt(3) / pi.
const LOGISTIC_SCALE: f64 = 0.551_328_895_421_792;

/// Rms speed of signal noise over its standard deviation, in cycles of its bandwidth: sqrt(3) for two
/// low passes of which the second (the source follower's) has three times the corner frequency. Noise
/// behind a single low pass has no finite speed.
pub const SHOT_NOISE_RMS_SPEED: f64 = 1.732_050_807_568_877_2;

/// Time after an event, in correlation times of the noise, from which its crossing rate is full.
const FULL_RECOVERY: f64 = 2.8;
/// Path of the light, in thresholds, over which the error of the interpolated signal decorrelates.
const ERROR_CORRELATION_PATH: f64 = 2.0;
/// Path beyond which the error is fully decorrelated.
pub(super) const LONGEST_PATH: f64 = 2.5 * ERROR_CORRELATION_PATH;
/// Reference levels propagated side by side.
pub(super) const MAX_REFERENCE_STATES: usize = 4;

/// When a pixel fires. Contrast is in natural logarithms of intensity, time in seconds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PixelLaw {
    /// Median threshold of ON events, log intensity; above 0.
    pub theta_on: f64,
    /// Median threshold of OFF events, log intensity; above 0.
    pub theta_off: f64,
    /// Drift of the signal towards ON, log intensity per second.
    pub leak_per_s: f64,
    /// Scale of the thresholds' logistic scatter at white, log intensity; the standard deviation is
    /// 1.81 times as large.
    pub noise_at_white: f64,
    /// The scatter is proportional to intensity to the power of minus this.
    pub noise_exponent: f64,
    /// Share of the scatter that remains under constant light, 0 to 1: the pixel's own noise. The rest
    /// is error of the known signal, which grows with the path of the light; `noise_at_white` holds for
    /// a path of one threshold.
    pub noise_at_rest: f64,
    /// Rms speed of threshold noise, log intensity per second.
    pub noise_speed_per_s: f64,
    /// Standard deviation of signal (shot) noise at white, log intensity; it scales with the scatter.
    pub shot_at_white: f64,
    /// Rms speed of signal noise at white, log intensity per second.
    pub shot_speed_per_s: f64,
    /// Rate of ON background events, Hz per pixel.
    pub background_on_hz: f64,
    /// Rate of OFF background events, Hz per pixel.
    pub background_off_hz: f64,
    /// Refractory period after an event, seconds.
    pub refractory_s: f64,
    /// Period after an event in which a filter removes the pixel's events, seconds; the pixel keeps
    /// firing and resetting its reference level.
    pub filter_refractory_s: f64,
    /// Share of the background events that reset the reference level.
    pub background_reset: f64,
    /// Share of the noise that caused an event that is stored in the reference level: 1 for signal
    /// noise, 0 for comparator noise.
    pub noise_carry: f64,
    /// Share of the events that are lost after the pixel has fired.
    pub drop_fraction: f64,
    /// Standard deviation of the time stamps, seconds.
    pub jitter_s: f64,
    /// Whether the reference level is corrected for the scatter of its stamp. Not for quantised stamps:
    /// errors of the thresholds would accumulate.
    pub corrects_stamps: bool,
}

impl Default for PixelLaw {
    /// A DAVIS346 in good light: thresholds of 0.25, a leak rate of 0.1 Hz.
    fn default() -> Self {
        Self {
            theta_on: 0.25,
            theta_off: 0.25,
            leak_per_s: 0.025,
            noise_at_white: 0.015,
            noise_exponent: 0.3,
            noise_at_rest: 1.0,
            noise_speed_per_s: 0.1,
            shot_at_white: 0.0,
            shot_speed_per_s: 0.0,
            background_on_hz: 0.01,
            background_off_hz: 0.01,
            refractory_s: 0.0,
            filter_refractory_s: 0.0,
            background_reset: 1.0,
            noise_carry: 0.0,
            drop_fraction: 0.0,
            jitter_s: 0.0,
            corrects_stamps: false,
        }
    }
}

impl PixelLaw {
    /// Whether every parameter is finite and in its range.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        let positive = [self.theta_on, self.theta_off, self.noise_at_white];
        let rates = [
            self.noise_speed_per_s,
            self.shot_at_white,
            self.shot_speed_per_s,
            self.background_on_hz,
            self.background_off_hz,
        ];
        let shares = [self.noise_at_rest, self.background_reset, self.noise_carry];
        positive.iter().all(|&v| v > 0.0 && v < 1e3)
            && rates.iter().all(|v| (0.0..1e7).contains(v))
            && shares.iter().all(|v| (0.0..=1.0).contains(v))
            && [self.refractory_s, self.filter_refractory_s]
                .iter()
                .all(|v| (0.0..3600.0).contains(v))
            && self.leak_per_s.abs() < 1e4
            && self.noise_exponent.abs() <= 3.0
            && (0.0..10.0).contains(&self.jitter_s)
            && (0.0..1.0).contains(&self.drop_fraction)
    }

    /// Scale of the thresholds' scatter at a log intensity relative to white.
    #[must_use]
    pub fn noise(&self, level: f64) -> f64 {
        self.noise_at_white * (-self.noise_exponent * level.clamp(-12.0, 3.0)).exp()
    }

    /// Whether the scatter depends on the path of the light. Signal noise does not.
    pub(super) fn is_noise_path_dependent(&self) -> bool {
        self.noise_at_rest < 1.0 && self.shot_at_white <= 0.0
    }

    /// Scatter after a path of the light, in thresholds, over that after a path of 1.
    pub(super) fn noise_share(&self, path: f64) -> f64 {
        let decorrelated = |path: f64| -(-(path / ERROR_CORRELATION_PATH).powi(2)).exp_m1();
        let at_rest = self.noise_at_rest * self.noise_at_rest;
        (at_rest + (1.0 - at_rest) * decorrelated(path) / decorrelated(1.0)).sqrt()
    }

    /// Standard deviation of signal noise where the thresholds scatter by `noise`.
    #[must_use]
    pub fn shot(&self, noise: f64) -> f64 {
        self.shot_at_white * noise / self.noise_at_white
    }

    /// Scale of the scatter, log intensity, that jittered stamps cause at a slope.
    #[must_use]
    pub fn stamp_scatter(&self, slope_per_s: f64) -> f64 {
        LOGISTIC_SCALE * self.jitter_s * slope_per_s
    }

    /// Period after an event without recorded events of the pixel, seconds.
    #[must_use]
    pub fn dead_s(&self) -> f64 {
        self.refractory_s.max(self.filter_refractory_s)
    }

    /// Mean crossing rate of signal noise between two times after an event, seconds, over its
    /// stationary value: the noise that caused the event has to decorrelate first. By simulation the
    /// rate is 0 up to the correlation time and rises linearly to 1 at [`FULL_RECOVERY`] times that.
    pub(super) fn recovery(&self, [from_s, to_s]: [f64; 2]) -> f64 {
        if self.shot_speed_per_s <= 0.0 {
            return 1.0;
        }
        let correlation_s = SHOT_NOISE_RMS_SPEED * self.shot_at_white / self.shot_speed_per_s;
        let ramp = |at_s: f64| ((at_s / correlation_s - 1.0) / (FULL_RECOVERY - 1.0)).max(0.0);
        // Integral of the ramp, which stays at 1, in units of its length.
        let integral = |ramp: f64| if ramp < 1.0 { 0.5 * ramp * ramp } else { ramp - 0.5 };
        let [a, b] = [ramp(from_s), ramp(to_s)];
        let length = (to_s - from_s) / (correlation_s * (FULL_RECOVERY - 1.0));
        if length > 1e-9 { (integral(b) - integral(a)) / length } else { a.min(1.0) }
    }

    /// Number of reference levels that have to be propagated side by side.
    #[must_use]
    pub fn max_reference_states(&self) -> usize {
        let is_ambiguous = self.shot_at_white > 0.0
            || self.filter_refractory_s > 0.0
            || self.drop_fraction > 0.0
            || self.background_reset < 1.0;
        if is_ambiguous { MAX_REFERENCE_STATES } else { 1 }
    }

    /// The median threshold of one polarity.
    #[must_use]
    pub fn theta(&self, on: bool) -> f64 {
        if on { self.theta_on } else { self.theta_off }
    }

    pub(super) fn background_hz(&self, on: bool) -> f64 {
        if on { self.background_on_hz } else { self.background_off_hz }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_out_of_range_are_invalid() {
        assert!(PixelLaw::default().is_valid());
        assert!(!PixelLaw { theta_off: 0.0, ..PixelLaw::default() }.is_valid());
        assert!(!PixelLaw { refractory_s: f64::NAN, ..PixelLaw::default() }.is_valid());
    }

    #[test]
    fn stamp_scatter_has_the_variance_of_the_jitter() {
        let law = PixelLaw { jitter_s: 1e-3, ..PixelLaw::default() };
        let expected = 1e-3 * 5.0 * 3.0_f64.sqrt() / std::f64::consts::PI;
        assert!((law.stamp_scatter(5.0) / expected - 1.0).abs() < 1e-3);
    }

    #[test]
    fn the_signal_error_grows_with_the_path_of_the_light() {
        let law = PixelLaw { noise_at_rest: 0.2, ..PixelLaw::default() };
        let shares = [0.0, 0.3, 1.0, 3.0].map(|path| law.noise_share(path));
        assert!((shares[0] - 0.2).abs() < 1e-12 && (shares[2] - 1.0).abs() < 1e-12);
        assert!(shares.is_sorted() && shares[3] < 2.2, "{shares:?}");
        let even = PixelLaw { noise_at_rest: 1.0, ..law };
        assert!([0.0, 0.3, 3.0].iter().all(|path| (even.noise_share(*path) - 1.0).abs() < 1e-12));
    }

    #[test]
    fn noise_grows_towards_the_dark() {
        let law = PixelLaw { noise_at_white: 0.02, noise_exponent: 0.5, ..PixelLaw::default() };
        assert!((law.noise(0.0) - 0.02).abs() < 1e-12);
        assert!((law.noise(-(4.0_f64.ln())) - 0.04).abs() < 1e-12);
    }
}
