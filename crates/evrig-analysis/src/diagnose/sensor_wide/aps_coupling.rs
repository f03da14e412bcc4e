//! Events at a fixed delay after the exposure starts of the camera's own frames.

use super::{Departure, Evidence};
use evrig_core::effect_id::EffectId;
use evrig_core::geometry::Size;
use evrig_core::stats::upper_median;

const BIN_US: i64 = 20;

/// Bins to either side that give the background of a peak, and those that belong to the peak.
const N_BACKGROUND_BINS: usize = 60;
const N_PEAK_BINS: usize = 10;

/// A peak of this share of the highest one counts as similar.
const MIN_SIMILAR_PEAK_SHARE: f64 = 0.3;

/// Bands of rows, which may be hit one after another.
const N_ROW_BANDS: usize = 4;

/// Significance level for the peak of each band.
const MIN_PEAK_STANDARD_ERRORS: f64 = 8.0;

const MIN_EVENT_SHARE: f64 = 0.005;

const MIN_FRAMES: usize = 8;

/// Events of a delay bin, and the sum of their delays.
#[derive(Clone, Copy, Default)]
struct DelayBin {
    n: f64,
    sum_us: f64,
}

/// The peak of a row band.
struct DelayPeak {
    row: f64,
    delay_us: f64,
    excess: f64,
    z: f64,
}

/// Why the effect cannot be tested.
pub(super) fn needs(evidence: &Evidence) -> Result<(), String> {
    let n = evidence.event_context.frames_us().len();
    if n < MIN_FRAMES {
        return Err(format!("the camera took {n} frames; at least {MIN_FRAMES} are needed"));
    }
    Ok(())
}

/// Events triggered by the camera's frames, if significant.
pub(super) fn coupling(evidence: &Evidence, times: &[i64]) -> Option<Departure> {
    needs(evidence).ok()?;
    let starts = evidence.event_context.frames_us();
    let mut periods: Vec<f64> = starts.windows(2).map(|pair| (pair[1] - pair[0]) as f64).collect();
    let n_bins = (upper_median(&mut periods)? as i64 / BIN_US) as usize;
    let Size { width, height } = evidence.event_context.recording().size();
    let mut classes = vec![vec![DelayBin::default(); n_bins]; N_ROW_BANDS];
    let all = times.len() as f64;
    for y in 0..height {
        let band = usize::from(y) * N_ROW_BANDS / usize::from(height);
        for x in 0..width {
            for spike in evidence.event_context.recording().of(x, y) {
                let since = evidence.event_context.since_frame_us(spike.t_us);
                let bin = since as i64 / BIN_US;
                if since.is_finite() && (bin as usize) < n_bins {
                    let class = &mut classes[band][bin as usize];
                    class.n += 1.0;
                    class.sum_us += since;
                }
            }
        }
    }
    let band_rows = f64::from(height) / N_ROW_BANDS as f64;
    let peaks: Vec<DelayPeak> = classes
        .iter()
        .enumerate()
        .filter_map(|(band, counts)| peak(counts, (band as f64 + 0.5) * band_rows))
        .collect();
    if peaks.len() < N_ROW_BANDS || peaks.iter().any(|peak| peak.z < MIN_PEAK_STANDARD_ERRORS) {
        return None;
    }
    let excess: f64 = peaks.iter().map(|peak| peak.excess).sum();
    let (delay_us, row_us, scatter) = line(&peaks);
    // Peaks that lie on no line come from the light.
    if scatter > 5.0 * BIN_US as f64 || excess < MIN_EVENT_SHARE * all {
        return None;
    }
    let middle_us = delay_us + 0.5 * row_us * f64::from(height);
    let half_us = N_PEAK_BINS as f64 * BIN_US as f64 + 0.5 * (row_us * f64::from(height)).abs();
    if !is_common(times, starts, [middle_us, half_us]) {
        return None;
    }
    let chances = starts.len() as f64 * f64::from(width) * f64::from(height);
    let fraction = excess / chances;
    let noise = peaks.iter().map(|peak| (peak.excess / peak.z).powi(2)).sum::<f64>().sqrt();
    // Stamps and exposure starts are whole microseconds.
    let bin = 0.25 * BIN_US as f64;
    Some(Departure {
        id: EffectId::ApsCoupling,
        parameters: vec![
            ("events_fraction", [fraction, (noise / chances).hypot(0.02 * fraction)]),
            ("delay_us", [delay_us, bin]),
            ("row_us", [row_us, bin / f64::from(height)]),
        ],
        description: format!(
            "{:.2} % of the pixels fire {delay_us:.0} us after each of the camera's frames begins",
            100.0 * fraction
        ),
        z: peaks.iter().map(|peak| peak.z).fold(f64::INFINITY, f64::min),
        without: None,
    })
}

/// Whether most frames have the excess: a flash affects all pixels after few frames.
fn is_common(times: &[i64], starts: &[i64], [middle_us, half_us]: [f64; 2]) -> bool {
    let count = |from_us: f64, to_us: f64| {
        let before = |us: f64| times.partition_point(|t| (*t as f64) < us);
        (before(to_us) - before(from_us)) as f64
    };
    let stands_out = |start: &&i64| {
        let middle = **start as f64 + middle_us;
        let own = count(middle - half_us, middle + half_us);
        let about = count(middle - 3.0 * half_us, middle + 3.0 * half_us) - own;
        own > 0.5 * about + 2.0 * (0.5 * about + 1.0).sqrt()
    };
    2 * starts.iter().filter(stands_out).count() > starts.len()
}

/// The most prominent peak of a band.
fn peak(classes: &[DelayBin], row: f64) -> Option<DelayPeak> {
    let counts: Vec<f64> = classes.iter().map(|class| class.n).collect();
    let n = counts.len();
    let near = |at: usize| {
        let around = at.saturating_sub(N_BACKGROUND_BINS)..n.min(at + N_BACKGROUND_BINS + 1);
        around.filter(move |i| i.abs_diff(at) > N_PEAK_BINS)
    };
    let median_near =
        |at: usize| upper_median(&mut near(at).map(|i| counts[i]).collect::<Vec<_>>());
    let surroundings: Vec<f64> = (0..n).map(median_near).collect::<Option<_>>()?;
    let stands_out = |at: usize| counts[at] - surroundings[at];
    let best = (0..n).max_by(|&a, &b| stands_out(a).total_cmp(&stands_out(b)))?;
    // A frame triggers one burst, or one at either end of the exposure; a periodic pattern comes
    // from stamps in steps.
    let height = stands_out(best);
    let like = |at: &usize| {
        at.abs_diff(best) > N_PEAK_BINS && stands_out(*at) > MIN_SIMILAR_PEAK_SHARE * height
    };
    if (0..n).filter(like).count() > N_PEAK_BINS {
        return None;
    }
    let common = surroundings[best];
    let (mut excess, mut moment, mut noise) = (0.0, 0.0, 0.0);
    for i in best.saturating_sub(N_PEAK_BINS)..n.min(best + N_PEAK_BINS + 1) {
        let over = counts[i] - common;
        // Bins without an excess only add noise to the mean delay.
        if over > 3.0 * common.max(1.0).sqrt() {
            excess += over;
            // Background events are uniform within the bin.
            moment += classes[i].sum_us - common * (i as f64 + 0.5) * BIN_US as f64;
        }
        noise += common.max(1.0);
    }
    // Moving light makes the background vary by more than counting noise.
    let mut swings: Vec<f64> = near(best).map(|i| (counts[i] - common).abs()).collect();
    let noise = noise.sqrt().max(1.5 * upper_median(&mut swings)? * (N_PEAK_BINS as f64).sqrt());
    (excess > 0.0).then(|| DelayPeak { row, delay_us: moment / excess, excess, z: excess / noise })
}

/// Delay at the first row, delay per row, and the largest residual.
fn line(peaks: &[DelayPeak]) -> (f64, f64, f64) {
    let n = peaks.len() as f64;
    let mean = |of: &dyn Fn(&DelayPeak) -> f64| peaks.iter().map(of).sum::<f64>() / n;
    let (row, delay) = (mean(&|p| p.row), mean(&|p| p.delay_us));
    let square: f64 = peaks.iter().map(|p| (p.row - row).powi(2)).sum();
    let both: f64 = peaks.iter().map(|p| (p.row - row) * (p.delay_us - delay)).sum();
    let slope = both / square;
    let left = |p: &DelayPeak| (p.delay_us - delay - slope * (p.row - row)).abs();
    (delay - slope * row, slope, peaks.iter().map(left).fold(0.0, f64::max))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_peak_is_found_with_its_delay() {
        let swing = |i: usize| 400.0 + 100.0 * (i as f64 / 80.0).sin();
        let class = |i: usize| {
            let (n, middle_us) = (swing(i), (i as f64 + 0.5) * BIN_US as f64);
            DelayBin { n, sum_us: n * middle_us }
        };
        let mut counts: Vec<DelayBin> = (0..500).map(class).collect();
        assert!(peak(&counts, 0.0).is_none_or(|peak| peak.z < MIN_PEAK_STANDARD_ERRORS));
        counts[15].n += 1_000.0;
        counts[15].sum_us += 1_000.0 * 301.0;
        let mut beats = counts.clone();
        let found = peak(&counts, 0.0).unwrap();
        assert!((found.delay_us - 301.0).abs() < 3.0, "{}", found.delay_us);
        assert!(
            (found.excess - 1000.0).abs() < 60.0 && found.z > MIN_PEAK_STANDARD_ERRORS,
            "{}",
            found.z
        );
        for beat in beats.iter_mut().skip(15).step_by(12).skip(1) {
            beat.n += 1_000.0;
            beat.sum_us += 1_000.0 * 301.0;
        }
        assert!(peak(&beats, 0.0).is_none(), "a beat every 240 us");
    }

    #[test]
    fn a_flash_after_few_frames_is_no_coupling() {
        let starts: Vec<i64> = (0..100).map(|i| i * 25_000).collect();
        let even = (0..250_000).map(|i| i * 10);
        let burst = |every: usize| {
            let hit =
                starts.iter().step_by(every).flat_map(|s| (0..400).map(move |i| s + 300 + i / 40));
            let mut times: Vec<i64> = even.clone().chain(hit).collect();
            times.sort_unstable();
            times
        };
        assert!(is_common(&burst(1), &starts, [300.0, 200.0]));
        assert!(!is_common(&burst(12), &starts, [300.0, 200.0]));
    }

    #[test]
    fn successive_rows_lie_on_a_line() {
        let at = |row: f64| DelayPeak { row, delay_us: 200.0 + 2.5 * row, excess: 10.0, z: 9.0 };
        let (delay, row_us, scatter) = line(&[32.0, 97.0, 162.0, 227.0].map(at));
        assert!((delay - 200.0).abs() < 1e-9 && (row_us - 2.5).abs() < 1e-12 && scatter < 1e-9);
    }
}
