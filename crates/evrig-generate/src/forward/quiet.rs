//! A pixel without noise: its voltage is straight from instant to instant.

use crate::pixel_model::PixelModel;

/// Calls `fire` with the time of each event (steps of the grid, from its start) and its side, until
/// it returns false.
///
/// `volts` is the voltage at the instants, `NaN` where the light is not known: there the pixel
/// keeps silent, and behind it starts anew.
pub(super) fn simulate(
    volts: &[f64],
    pixel: &PixelModel,
    step_us: f64,
    fire: &mut dyn FnMut(f64, bool) -> bool,
) {
    let hold = (pixel.latency_us + pixel.refractory_us) / step_us;
    let latency = pixel.latency_us / step_us;
    let (on, off) = (pixel.threshold_on, pixel.threshold_off);
    let Some(mut i) = volts.iter().position(|v| v.is_finite()) else { return };
    let mut reset = volts[i];
    i += 1;
    // Where within the step before instant `i` the pixel is.
    let mut at = (i - 1) as f64;
    while i < volts.len() {
        let above = volts[i] - reset;
        if above < on && -above < off {
            i += 1;
            continue;
        }
        if !above.is_finite() {
            let Some(next) = volts[i..].iter().position(|v| v.is_finite()) else { return };
            i += next;
            reset = volts[i];
            i += 1;
            continue;
        }
        let (start, rise) = (volts[i - 1], volts[i] - volts[i - 1]);
        let is_on = above >= on;
        let level = if is_on { reset + on } else { reset - off };
        let share = if rise == 0.0 { 0.0 } else { ((level - start) / rise).clamp(0.0, 1.0) };
        at = at.max((i - 1) as f64 + share);
        if !fire(at + latency, is_on) {
            return;
        }
        if hold > 0.0 {
            at += hold;
            match value_at(volts, at) {
                Some(value) => reset = value,
                None => match known_after(volts, at) {
                    Some(known) => (at, reset) = (known as f64, volts[known]),
                    None => return,
                },
            }
            i = at as usize + 1;
        } else {
            reset = level;
        }
    }
}

/// The voltage at a time between two known instants.
pub(super) fn value_at(volts: &[f64], at: f64) -> Option<f64> {
    let i = at as usize;
    let share = at - i as f64;
    let (&before, &after) = (volts.get(i)?, volts.get(i + 1)?);
    Some(before + share * (after - before)).filter(|value| value.is_finite())
}

/// The first known instant at or after a time.
pub(super) fn known_after(volts: &[f64], at: f64) -> Option<usize> {
    let first = at.ceil() as usize;
    Some(first + volts.get(first..)?.iter().position(|v| v.is_finite())?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::voltmeter::Coefficients;

    fn pixel() -> PixelModel {
        PixelModel::from_k(Coefficients::new([1.0, 1e-9, 0.0, 0.0, 0.0, 0.0]).unwrap(), 1.0)
    }

    fn events(volts: &[f64], pixel: &PixelModel) -> Vec<(f64, bool)> {
        let mut out = Vec::new();
        simulate(volts, pixel, 1000.0, &mut |t, on| {
            out.push((t, on));
            true
        });
        out
    }

    #[test]
    fn a_slope_fires_at_equal_steps_wherever_the_instants_lie() {
        let volts: Vec<f64> = (0..100).map(|i| 0.37 * f64::from(i)).collect();
        let found = events(&volts, &pixel());
        assert_eq!(found.len(), 36);
        for (n, (t, on)) in found.iter().enumerate() {
            assert!(*on && (t - (n + 1) as f64 / 0.37).abs() < 1e-9);
        }
    }

    #[test]
    fn many_events_of_one_step_are_all_there() {
        let found = events(&[0.0, -5.5, -5.0], &pixel());
        let times: Vec<f64> = found.iter().map(|(t, _)| t * 5.5).collect();
        assert!(found.iter().all(|(_, on)| !on));
        assert!(times.iter().zip(1..=5).all(|(t, n)| (t - f64::from(n)).abs() < 1e-9));
        assert_eq!(times.len(), 5);
    }

    #[test]
    fn held_at_reset_the_pixel_loses_what_rose_meanwhile() {
        let volts: Vec<f64> = (0..1000).map(|i| 0.1 * f64::from(i)).collect();
        let pixel = PixelModel { refractory_us: 4_500.0, ..pixel() };
        let found = events(&volts, &pixel);
        let gaps: Vec<f64> = found.windows(2).map(|pair| pair[1].0 - pair[0].0).collect();
        assert!(gaps.iter().all(|gap| (gap - 14.5).abs() < 1e-9), "{gaps:?}");
    }

    #[test]
    fn where_nothing_is_known_nothing_fires_and_the_pixel_starts_anew() {
        let mut volts: Vec<f64> = (0..100).map(|i| 0.1 * f64::from(i)).collect();
        volts[..3].fill(f64::NAN);
        volts[40..70].fill(f64::NAN);
        let found: Vec<f64> = events(&volts, &pixel()).iter().map(|(t, _)| *t).collect();
        for (found, expected) in found.iter().zip([13.0, 23.0, 33.0, 80.0, 90.0]) {
            assert!((found - expected).abs() < 0.01, "{found} {expected}");
        }
    }
}
