//! Integrals of drift and diffusion of a pixel's voltage, as in the generator: brightness is linear
//! between frames, drift and diffusion are constant between two frames.

/// Brightness of one pixel.
#[derive(Debug, Clone, Copy)]
pub(super) struct PixelBrightness<'a> {
    /// Times of the frames, µs, ascending.
    pub(super) times_us: &'a [i64],
    /// Brightness in each frame, DN.
    pub(super) series: &'a [f32],
}

/// Integrals over an interval of time, from which drift and diffusion follow for any k except k2.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct PathIntegrals {
    /// Of L'/(L + k2), log units: multiplies k1.
    pub(super) contrast: f64,
    /// Derivative of `contrast` with respect to k2.
    pub(super) contrast_by_k2: f64,
    /// Of time, µs: multiplies k4.
    pub(super) time_us: f64,
    /// Of L, DN µs: multiplies k5.
    pub(super) brightness: f64,
    /// Of s^2 with s = sqrt(L)/(L + k2), µs / DN.
    pub(super) shot2: f64,
    /// Of s.
    pub(super) shot: f64,
}

impl PathIntegrals {
    fn add(&mut self, rates: &Self, dt: f64) {
        self.contrast += rates.contrast * dt;
        self.contrast_by_k2 += rates.contrast_by_k2 * dt;
        self.time_us += dt;
        self.brightness += rates.brightness * dt;
        self.shot2 += rates.shot2 * dt;
        self.shot += rates.shot * dt;
    }

    /// The integral of the drift, thresholds.
    pub(super) fn drift(&self, k: &[f64; 6]) -> f64 {
        k[0] * self.contrast + k[3] * self.time_us + k[4] * self.brightness
    }

    /// Its derivatives with respect to k1, k2, k4, k5.
    pub(super) fn drift_by(&self, k: &[f64; 6]) -> [f64; 4] {
        [self.contrast, k[0] * self.contrast_by_k2, self.time_us, self.brightness]
    }

    /// The integral of the diffusion squared, thresholds squared.
    pub(super) fn variance(&self, k: &[f64; 6]) -> f64 {
        let [_, _, k3, _, _, k6] = *k;
        k3 * k3 * self.shot2 + 2.0 * k3 * k6 * self.shot + k6 * k6 * self.time_us
    }

    /// Its derivatives with respect to k3 and k6.
    pub(super) fn variance_by(&self, k: &[f64; 6]) -> [f64; 2] {
        let [_, _, k3, _, _, k6] = *k;
        [2.0 * (k3 * self.shot2 + k6 * self.shot), 2.0 * (k3 * self.shot + k6 * self.time_us)]
    }
}

impl PixelBrightness<'_> {
    /// Number of the frame interval that holds the time just after `t_us`.
    fn interval_after(&self, t_us: f64) -> usize {
        let last = self.times_us.len().saturating_sub(2);
        self.times_us.partition_point(|&t| t as f64 <= t_us).saturating_sub(1).min(last)
    }

    /// The integrands between frames `i` and `i + 1`.
    fn rates(&self, i: usize, k2: f64) -> PathIntegrals {
        let (before, after) = (f64::from(self.series[i]), f64::from(self.series[i + 1]));
        let span = (self.times_us[i + 1] - self.times_us[i]) as f64;
        let (mean, gain) = (0.5 * (before + after), 1.0 / (0.5 * (before + after) + k2));
        let contrast = (after - before) / span * gain;
        let shot = mean.sqrt() * gain;
        PathIntegrals {
            contrast,
            contrast_by_k2: -contrast * gain,
            time_us: 1.0,
            brightness: mean,
            shot2: shot * shot,
            shot,
        }
    }

    /// Drift at an instant, between the frames before it, thresholds per µs.
    pub(super) fn drift_at(&self, t_us: i64, k: &[f64; 6]) -> f64 {
        self.rates(self.interval_after(t_us as f64 - 0.5), k[1]).drift(k)
    }

    /// Integrals from `start_us` to `end_us`, both within the frames.
    pub(super) fn along(&self, start_us: i64, end_us: i64, k2: f64) -> PathIntegrals {
        let mut sum = PathIntegrals::default();
        let mut i = self.interval_after(start_us as f64);
        let mut from = start_us;
        while from < end_us && i + 1 < self.times_us.len() {
            let to = end_us.min(self.times_us[i + 1]);
            sum.add(&self.rates(i, k2), (to - from) as f64);
            (from, i) = (to, i + 1);
        }
        sum
    }

    /// Integrals from the start of a passage to its expected end, from the brightness alone; `None`
    /// for a passage that might not end before the last frame.
    ///
    /// The expected end is where the drift reaches a barrier or the variance reaches 1, the mean
    /// duration without drift. The end is certain once the drift is 5 standard deviations beyond a
    /// barrier, or the variance is 8: without drift, a share of 4/pi exp(-pi^2) = 7e-5 lasts
    /// longer.
    pub(super) fn predict(&self, start_us: i64, k: &[f64; 6]) -> Option<PathIntegrals> {
        let mut sum = PathIntegrals::default();
        let mut expected = None;
        let mut from = start_us;
        for i in self.interval_after(start_us as f64)..self.times_us.len() - 1 {
            let rates = self.rates(i, k[1]);
            let dt = (self.times_us[i + 1] - from) as f64;
            if expected.is_none() {
                let until = until_passage(&sum, &rates, k);
                if until <= dt {
                    let mut at = sum;
                    at.add(&rates, until);
                    expected = Some(at);
                }
            }
            sum.add(&rates, dt);
            from = self.times_us[i + 1];
            let variance = sum.variance(k);
            if variance >= 8.0 || sum.drift(k).abs() >= 1.0 + 5.0 * variance.sqrt() {
                return expected;
            }
        }
        None
    }
}

/// How long from `sum` on until drift or variance reach 1 at constant rates, µs.
fn until_passage(sum: &PathIntegrals, rates: &PathIntegrals, k: &[f64; 6]) -> f64 {
    let (drift, rate) = (sum.drift(k), rates.drift(k));
    let by_drift = if rate == 0.0 { f64::INFINITY } else { (rate.signum() - drift) / rate };
    let spread = rates.variance(k);
    let by_noise = if spread > 0.0 { (1.0 - sum.variance(k)) / spread } else { f64::INFINITY };
    by_drift.min(by_noise).max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    const K: [f64; 6] = [4.0, 20.0, 1e-4, 1e-7, 5e-9, 1e-5];

    #[test]
    fn a_stretch_is_the_sum_of_its_pieces() {
        let (times_us, series) = ([0, 1_000, 3_000, 4_000], [50.0, 60.0, 40.0, 80.0]);
        let pixel = PixelBrightness { times_us: &times_us, series: &series };
        let whole = pixel.along(250, 3_500, 20.0);
        let pieces = [(250, 1_000, 0), (1_000, 3_000, 1), (3_000, 3_500, 2)];
        let motions = pieces.map(|(from, to, i)| {
            let k = evrig_generate::voltmeter::Coefficients::new(K).unwrap();
            let span = f64::from(times_us[i + 1] as i32 - times_us[i] as i32);
            let motion = k.motion(series[i], series[i + 1], span);
            let dt = f64::from(to - from);
            [motion.drift_per_us * dt, motion.sigma_per_sqrt_us.powi(2) * dt]
        });
        let sum = |i: usize| motions.iter().map(|m| m[i]).sum::<f64>();
        assert!((whole.drift(&K) - sum(0)).abs() < 1e-12);
        assert!((whole.variance(&K) - sum(1)).abs() < 1e-15);
    }

    #[test]
    fn the_light_predicts_a_passage_only_when_it_will_surely_end() {
        // From 50 to 90 DN, k1 x log change passes 1 after about a third of the rise.
        let (times_us, series) = ([0, 10_000, 20_000], [50.0, 90.0, 90.0]);
        let pixel = PixelBrightness { times_us: &times_us, series: &series };
        let predicted = pixel.predict(0, &K).unwrap();
        assert!((predicted.drift(&K) - 1.0).abs() < 1e-9);
        assert!(predicted.time_us > 3_000.0 && predicted.time_us < 7_000.0);
        assert!(pixel.predict(9_000, &K).is_none(), "what remains of the rise is too little");
    }
}
