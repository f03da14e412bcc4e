//! Hazards of a pixel over a segment of its signal and at an instant.

use super::band::{REACH, ReferenceHypothesis};
use super::law::{LOGISTIC_SD, logistic, softplus};
use super::pass::PixelPass;
use statrs::consts::EULER_MASCHERONI;
use statrs::function::gamma::digamma;

/// Mean lead of a crossing before the noiseless one, in scales of the noise.
///
/// Noise that moves tries the threshold several times before the signal is there: with the
/// compensator `n softplus(z)`, the lead `-z` has the mean `digamma(n) - digamma(1)`.
fn mean_lead(attempts: f64) -> f64 {
    // Finite where the hazards that it is weighted by vanish.
    digamma(attempts.clamp(1.0, 1e15)) + EULER_MASCHERONI
}

/// Hazards integrated over a segment: crossings ON and OFF, and background.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct SegmentHazard {
    pub(super) on_off: [f64; 2],
}

/// What a hazard at an instant consists of.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct InstantHazard {
    pub(super) crossing: f64,
    pub(super) shot: f64,
    pub(super) change: f64,
    /// Share of the innovation that is stored in the reference level.
    pub(super) gain: f64,
    /// What is stored of the mean lead of the noise, thresholds.
    pub(super) lead: f64,
    /// Variance that the reference has after a reset.
    pub(super) variance: f64,
}

impl PixelPass<'_> {
    /// Squared logistic scale of the noise at a segment, without the reference's.
    pub(super) fn noise2(&self, darkness: f64, slope_per_s: f64) -> f64 {
        let noise = self.law.noise * darkness;
        let jitter = self.law.jitter_s * slope_per_s / LOGISTIC_SD;
        let mut sum = noise * noise * self.law.path_share2(self.path) + jitter * jitter;
        if self.law.shot_rms > 0.0 {
            sum += (self.law.shot_rms * darkness / LOGISTIC_SD).powi(2);
        }
        sum
    }

    /// Hazards of a segment that is linear from `from` to `to` in log intensity.
    pub(super) fn segment(
        &self,
        state: &ReferenceHypothesis,
        [from, to]: [f64; 2],
        seconds: f64,
        darkness: f64,
        mut noise2: Option<f64>,
        since_s: f64,
    ) -> (SegmentHazard, Option<f64>) {
        let law = self.law;
        let mut out = SegmentHazard::default();
        let slope = (to - from) / seconds;
        for side in 0..2 {
            let sign = if side == 0 { 1.0 } else { -1.0 };
            let theta = law.theta[side];
            let u = [from, to].map(|y| sign * (y - state.reference) / theta);
            let top = u[0].max(u[1]);
            let room = (1.0 - top) * theta / REACH;
            if room > 0.0 {
                let n = law.noise * darkness;
                let j = law.jitter_s * slope / LOGISTIC_SD;
                let shot = law.shot_rms * darkness / LOGISTIC_SD;
                let most = if self.path > 1.0 { self.max_noise } else { 1.0 };
                if room * room > n * n * most + j * j + shot * shot + state.variance {
                    continue;
                }
            }
            let own = *noise2.get_or_insert_with(|| self.noise2(darkness, slope));
            let s = (own + state.variance).sqrt() / theta;
            let v = sign * slope / theta;
            let nu = s * law.noise_rate_hz;
            let speed = nu * softplus(v / nu);
            let z = u.map(|u| (u - 1.0) / s);
            let dz = z[1] - z[0];
            let mean = if dz.abs() > 1e-3 {
                (softplus(z[1]) - softplus(z[0])) / dz
            } else {
                logistic(0.5 * (z[0] + z[1]))
            };
            out.on_off[side] = speed / s * mean * seconds;
            if law.shot_rms > 0.0 {
                let gap = [1.0 - u[0], 1.0 - u[1]];
                let rate = |gap: f64| self.shot_rate(gap * theta, state, darkness, since_s);
                out.on_off[side] += 0.5 * seconds * (rate(gap[0]) + rate(gap[1]));
            }
        }
        (out, noise2)
    }

    /// Rice's rate at which band-limited noise crosses a gap of log intensity.
    pub(super) fn shot_rate(
        &self,
        gap: f64,
        state: &ReferenceHypothesis,
        darkness: f64,
        since_s: f64,
    ) -> f64 {
        let law = self.law;
        let rms = law.shot_rms * darkness;
        let variance = rms * rms + state.variance * LOGISTIC_SD * LOGISTIC_SD;
        let recovered = -(-std::f64::consts::TAU * law.shot_hz * since_s).exp_m1();
        let gap = gap.max(0.0);
        1.732 * law.shot_hz * recovered * (-0.5 * gap * gap / variance).exp()
    }

    /// Mean of the refractory gate between two times after the event, seconds.
    pub(super) fn gate(&self, from_s: f64, to_s: f64) -> f64 {
        let (end, width) = (self.law.refractory_s, self.law.onset_s);
        if end <= 0.0 {
            return 1.0;
        }
        let (a, b) = ((from_s - end) / width, (to_s - end) / width);
        if a > 36.0 {
            return 1.0;
        }
        if b - a > 1e-6 { (softplus(b) - softplus(a)) / (b - a) } else { logistic(a) }
    }

    /// What the noise adds to the reference level at an event without a past, log intensity.
    pub(super) fn first_shift(&self, on: bool) -> f64 {
        let law = self.law;
        let (side, sign) = if on { (0, 1.0) } else { (1, -1.0) };
        let slope = self.signal.slope_per_s(self.position) + law.leak_per_s;
        let noise = self.noise2(self.darkness(self.position), slope).sqrt();
        let attempts = 1.0 + noise * law.noise_rate_hz / slope.abs().max(f64::MIN_POSITIVE);
        let crossings = slope.abs() / law.theta[side];
        let share = crossings / (crossings + law.background_hz[side]).max(f64::MIN_POSITIVE);
        sign * share * law.stored_share * noise * mean_lead(attempts)
    }

    /// The hazard of a polarity at the present position, given a state.
    pub(super) fn instant(&self, state: &ReferenceHypothesis, on: bool) -> InstantHazard {
        let law = self.law;
        let side = usize::from(!on);
        let sign = if on { 1.0 } else { -1.0 };
        let theta = law.theta[side];
        let slope = self.signal.slope_per_s(self.position) + law.leak_per_s;
        let darkness = self.darkness(self.position);
        let own = self.noise2(darkness, slope);
        let all = own + state.variance;
        let s = all.sqrt() / theta;
        let change = sign * (self.leaky(self.position) - state.reference) / theta;
        let nu = s * law.noise_rate_hz;
        let speed = nu * softplus(sign * slope / theta / nu);
        let z = (change - 1.0) / s;
        let crossing = speed / s * logistic(z);
        let since_s = (self.position - self.fired) * self.signal.step_us * 1e-6;
        let shot = if law.shot_rms > 0.0 {
            self.shot_rate((1.0 - change) * theta, state, darkness, since_s)
        } else {
            0.0
        };
        let noise = law.noise * darkness;
        let jitter = law.jitter_s * slope / LOGISTIC_SD;
        let shot2 = (law.shot_rms * darkness / LOGISTIC_SD).powi(2);
        let stored =
            law.stored_share * noise * noise * law.path_share2(self.path) + jitter * jitter + shot2;
        // After a refractory period the noise is another one.
        let same = (-law.refractory_s * law.noise_rate_hz).exp();
        let gain = stored / all * same;
        let attempts = self.crossed[side] / softplus(z).max(f64::MIN_POSITIVE);
        let lead = own.sqrt() / theta * mean_lead(attempts) * (stored / own * same - gain);
        InstantHazard { crossing, shot, change, gain, lead, variance: stored * (1.0 - gain) }
    }
}
