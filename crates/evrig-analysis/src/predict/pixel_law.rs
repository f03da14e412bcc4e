//! The law of one pixel: thresholds, leak, noise, background, dead time, losses.

use super::memory::{MOST_CARRIED, MOST_CASES};
use serde::{Deserialize, Serialize};

/// Scale of a logistic law over its standard deviation: the root of three over pi.
const LOGISTIC: f64 = 0.551_328_895_421_792;

/// Root mean square speed of the signal's own noise over its size, in turns of its bandwidth: behind two
/// low passes of which the second, the follower's, lies at three times the first, the root of three.
/// Noise behind one alone would have no speed. It is also the time in which the noise forgets over that
/// in which it passes its own size.
pub const SHOT_SPEED: f64 = 1.732_050_807_568_877_2;

/// From so many times that time on it has rested.
const RESTED: f64 = 2.8;

/// A path of the light, in thresholds, over which its error comes to be another one: of 0.1 to 4 that by which one
/// recording of the simulated rig was foretold best.
const OTHER_ERROR: f64 = 2.0;

/// From a path so long on it is.
pub(super) const LONGEST_PATH: f64 = 2.5 * OTHER_ERROR;

fn all() -> f64 {
    1.0
}

/// What decides when a pixel fires. Contrast is in natural logarithms of intensity, time in seconds.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PixelLaw {
    /// Rise of log intensity at which an On event comes, in the median; above 0.
    pub theta_on: f64,
    /// Fall of log intensity at which an Off event comes, in the median; above 0.
    pub theta_off: f64,
    /// Drift of the signal towards On, log intensity a second.
    pub leak_per_s: f64,
    /// Scale of the threshold's scatter at white, log intensity: that of a logistic law, whose
    /// standard deviation is 1.81 times as much.
    pub noise_at_white: f64,
    /// How the scatter grows towards the dark: it goes as intensity to the power of minus this.
    pub noise_exponent: f64,
    /// Share of that scatter which there is where the light stays as it was memorised, 0 to 1: the pixel's
    /// own. The rest is the error of the light that is known, which shows as the light changes; the whole is that
    /// of a change by one threshold.
    #[serde(default = "all")]
    pub noise_at_rest: f64,
    /// Speed at which the noise itself moves the signal, log intensity a second.
    pub noise_speed_per_s: f64,
    /// Standard deviation at white of the signal's own noise, log intensity; it grows towards the dark as
    /// the scatter does.
    #[serde(default)]
    pub shot_at_white: f64,
    /// Root mean square speed of that noise at white, log intensity a second.
    #[serde(default)]
    pub shot_speed_per_s: f64,
    /// Rate of On events that have nothing to do with light, a second and pixel.
    pub background_on_hz: f64,
    /// Rate of Off events that have nothing to do with light, a second and pixel.
    pub background_off_hz: f64,
    /// For how long a pixel is blind after an event, seconds.
    pub blind_s: f64,
    /// For how long after an event the pixel's others are taken out behind it, while it goes on
    /// firing and memorising, seconds.
    #[serde(default)]
    pub masked_s: f64,
    /// Share of the background events at which the pixel memorises the light; at the others, which
    /// come about behind it, it does not.
    #[serde(default = "all")]
    pub background_memorised: f64,
    /// How much of the noise that set off an event the pixel memorises with the light: 1 for noise of
    /// the signal, 0 for that of the comparison.
    #[serde(default)]
    pub noise_memorised: f64,
    /// Share of the events that are lost after the pixel has fired.
    pub drop_fraction: f64,
    /// Standard deviation of the stamps about the instant of the event, seconds.
    #[serde(default)]
    pub jitter_s: f64,
    /// Whether what a pixel memorised is weighed between a stamp that scatters and the threshold. For the
    /// scatter of a coarse clock alone it is not: thresholds that are a little off would add up.
    #[serde(default)]
    pub stamps_are_weighed: bool,
}

impl Default for PixelLaw {
    /// A DAVIS346 in good light: thresholds of a quarter, a leak of 0.1 events a second.
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
            blind_s: 0.0,
            masked_s: 0.0,
            background_memorised: 1.0,
            noise_memorised: 0.0,
            drop_fraction: 0.0,
            jitter_s: 0.0,
            stamps_are_weighed: false,
        }
    }
}

/// A law that no pixel can have.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("a pixel's {key} is {got}; expected {expected}")]
pub struct LawError {
    key: &'static str,
    got: f64,
    expected: &'static str,
}

impl PixelLaw {
    /// Whether every quantity lies in its range.
    ///
    /// # Errors
    /// Names the first that does not.
    pub fn check(&self) -> Result<(), LawError> {
        let positive = |v: f64| v > 0.0 && v < 1e3;
        let rate = |v: f64| (0.0..1e7).contains(&v);
        let share = |v: f64| (0.0..=1.0).contains(&v);
        let rows: [(&'static str, f64, bool, &'static str); 17] = [
            ("theta_on", self.theta_on, positive(self.theta_on), "0 to 1000, above 0"),
            ("theta_off", self.theta_off, positive(self.theta_off), "0 to 1000, above 0"),
            ("leak_per_s", self.leak_per_s, self.leak_per_s.abs() < 1e4, "a size below 10 000"),
            ("noise_at_white", self.noise_at_white, positive(self.noise_at_white), "above 0"),
            ("noise_exponent", self.noise_exponent, self.noise_exponent.abs() <= 3.0, "-3 to 3"),
            ("noise_at_rest", self.noise_at_rest, share(self.noise_at_rest), "0 to 1"),
            (
                "noise_speed_per_s",
                self.noise_speed_per_s,
                rate(self.noise_speed_per_s),
                "0 or more",
            ),
            ("shot_at_white", self.shot_at_white, rate(self.shot_at_white), "0 or more"),
            ("shot_speed_per_s", self.shot_speed_per_s, rate(self.shot_speed_per_s), "0 or more"),
            ("background_on_hz", self.background_on_hz, rate(self.background_on_hz), "0 to 1e7"),
            ("background_off_hz", self.background_off_hz, rate(self.background_off_hz), "0 to 1e7"),
            ("jitter_s", self.jitter_s, (0.0..10.0).contains(&self.jitter_s), "0 to 10"),
            ("blind_s", self.blind_s, (0.0..3600.0).contains(&self.blind_s), "0 to 3600"),
            ("masked_s", self.masked_s, (0.0..3600.0).contains(&self.masked_s), "0 to 3600"),
            (
                "background_memorised",
                self.background_memorised,
                share(self.background_memorised),
                "0 to 1",
            ),
            ("noise_memorised", self.noise_memorised, share(self.noise_memorised), "0 to 1"),
            (
                "drop_fraction",
                self.drop_fraction,
                (0.0..1.0).contains(&self.drop_fraction),
                "0 to below 1",
            ),
        ];
        match rows.into_iter().find(|row| !row.2) {
            Some((key, got, _, expected)) => Err(LawError { key, got, expected }),
            None => Ok(()),
        }
    }

    /// Scale of the threshold's scatter where the light, in log intensity over white, is `level`.
    #[must_use]
    pub fn noise(&self, level: f64) -> f64 {
        self.noise_at_white * (-self.noise_exponent * level.clamp(-12.0, 3.0)).exp()
    }

    /// Whether there is less noise where the light rests. Noise of the signal itself is there whatever the light does.
    pub(super) fn rests(&self) -> bool {
        self.noise_at_rest < 1.0 && self.shot_at_white <= 0.0
    }

    /// How much of the noise there is where the light has gone a path of so many thresholds: more than all of it
    /// on a long one.
    pub(super) fn share_of_noise(&self, path: f64) -> f64 {
        let shown = |path: f64| -(-(path / OTHER_ERROR).powi(2)).exp_m1();
        let at_rest = self.noise_at_rest * self.noise_at_rest;
        (at_rest + (1.0 - at_rest) * shown(path) / shown(1.0)).sqrt()
    }

    /// Standard deviation of the signal's own noise where the scale of the threshold's scatter is
    /// `noise`: noise of all kinds grows alike towards the dark.
    #[must_use]
    pub fn shot(&self, noise: f64) -> f64 {
        self.shot_at_white * noise / self.noise_at_white
    }

    /// Scale of the scatter that stamps have where the light goes so fast, log intensity a second. A change is
    /// from stamp to stamp, while the pixel itself went from instant to instant: both ends scatter.
    #[must_use]
    pub fn scatter_of_stamps(&self, slope_per_s: f64) -> f64 {
        LOGISTIC * self.jitter_s * slope_per_s
    }

    /// For how long nothing more is heard of a pixel after an event, seconds.
    #[must_use]
    pub fn deaf_s(&self) -> f64 {
        self.blind_s.max(self.masked_s)
    }

    /// By how much of its rate the signal's own noise sets off events in the mean between two times behind
    /// an event, seconds: the noise that set off the one has first to be gone. As simulations have it, it
    /// sets off nothing for the time in which it forgets, and all from nearly three times that on.
    pub(super) fn rested(&self, [from_s, to_s]: [f64; 2]) -> f64 {
        if self.shot_speed_per_s <= 0.0 {
            return 1.0;
        }
        let forgets_s = SHOT_SPEED * self.shot_at_white / self.shot_speed_per_s;
        let ramp = |at_s: f64| ((at_s / forgets_s - 1.0) / (RESTED - 1.0)).max(0.0);
        // Integral of the ramp in units of its length; it goes on as one.
        let whole = |ramp: f64| if ramp < 1.0 { 0.5 * ramp * ramp } else { ramp - 0.5 };
        let [a, b] = [ramp(from_s), ramp(to_s)];
        let length = (to_s - from_s) / (forgets_s * (RESTED - 1.0));
        if length > 1e-9 { (whole(b) - whole(a)) / length } else { a.min(1.0) }
    }

    /// What it compares with that is followed side by side, at most.
    #[must_use]
    pub fn n_memories(&self) -> usize {
        let is_open =
            self.masked_s > 0.0 || self.drop_fraction > 0.0 || self.background_memorised < 1.0;
        match self.shot_at_white {
            shot if shot > 0.0 => MOST_CARRIED,
            _ if is_open => MOST_CASES,
            _ => 1,
        }
    }

    /// The threshold of one polarity.
    #[must_use]
    pub fn theta(&self, on: bool) -> f64 {
        if on { self.theta_on } else { self.theta_off }
    }

    /// The background rate of one polarity, a second.
    #[must_use]
    pub fn background_hz(&self, on: bool) -> f64 {
        if on { self.background_on_hz } else { self.background_off_hz }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_impossible_law_is_refused_by_the_name_of_what_is_wrong() {
        assert_eq!(PixelLaw::default().check(), Ok(()));
        let law = PixelLaw { theta_off: 0.0, ..PixelLaw::default() };
        assert!(law.check().unwrap_err().to_string().contains("theta_off is 0"));
        let law = PixelLaw { blind_s: f64::NAN, ..PixelLaw::default() };
        assert!(law.check().unwrap_err().to_string().contains("blind_s"));
    }

    #[test]
    fn stamps_scatter_as_a_normal_number_of_that_deviation_does() {
        let law = PixelLaw { jitter_s: 1e-3, ..PixelLaw::default() };
        // The logistic scale of as much variance.
        let expected = 1e-3 * 5.0 * 3.0_f64.sqrt() / std::f64::consts::PI;
        assert!((law.scatter_of_stamps(5.0) / expected - 1.0).abs() < 1e-3);
    }

    #[test]
    fn the_error_of_the_light_shows_with_its_path() {
        let law = PixelLaw { noise_at_rest: 0.2, ..PixelLaw::default() };
        let shares = [0.0, 0.3, 1.0, 3.0].map(|path| law.share_of_noise(path));
        assert!((shares[0] - 0.2).abs() < 1e-12 && (shares[2] - 1.0).abs() < 1e-12);
        assert!(shares.is_sorted() && shares[3] < 2.2, "{shares:?}");
        let even = PixelLaw { noise_at_rest: 1.0, ..law };
        assert!(
            [0.0, 0.3, 3.0].iter().all(|path| (even.share_of_noise(*path) - 1.0).abs() < 1e-12)
        );
    }

    #[test]
    fn noise_grows_towards_the_dark() {
        let law = PixelLaw { noise_at_white: 0.02, noise_exponent: 0.5, ..PixelLaw::default() };
        assert!((law.noise(0.0) - 0.02).abs() < 1e-12);
        assert!((law.noise(-(4.0_f64.ln())) - 0.04).abs() < 1e-12);
    }
}
