//! Duration, rates by polarity, and gaps of the whole sensor.

use super::chance::LEVEL;
use evrig_core::event::EventSlice;
use evrig_core::stats::{Estimate, Moments};
use serde::Serialize;

/// Blocks of time whose scatter gives the error of a rate; below this number of events in a block
/// the error is Poisson's.
const N_BLOCKS: usize = 20;

/// Events before and after a gap whose mean interval is the rate there.
const GAP_CONTEXT: usize = 200;

/// Gaps that are listed.
const MAX_GAPS: usize = 10;

/// Duration and rates of a stream.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StreamRates {
    /// First and last stamp, µs.
    pub first_us: i64,
    /// Last stamp, µs.
    pub last_us: i64,
    /// Between them.
    pub duration_s: f64,
    /// ON events per second; the error is from the scatter over twentieths of the time.
    pub on_hz: Estimate,
    /// OFF events per second.
    pub off_hz: Estimate,
    /// Events per pixel and second.
    pub per_pixel_hz: f64,
    /// Times without an event anywhere that chance does not explain, longest first.
    pub gaps: Vec<SensorGap>,
    /// The longest time without an event, µs.
    pub longest_gap_us: i64,
}

/// A time without any event.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct SensorGap {
    /// Stamp of the event before it, µs.
    pub begin_us: i64,
    /// Length, µs.
    pub length_us: i64,
    /// Length that the rate before and after it predicts on average, µs.
    pub mean_interval_us: f64,
    /// Probability of such a gap anywhere in the stream by chance.
    pub false_alarm_probability: f64,
}

pub(super) fn rates(events: EventSlice<'_>, n_pixels: usize) -> StreamRates {
    let [first_us, last_us] = [events.t.first(), events.t.last()].map(|t| t.copied().unwrap_or(0));
    let duration_s = (last_us - first_us) as f64 * 1e-6;
    let mut blocks = [[0_u64; N_BLOCKS]; 2];
    let length = (last_us - first_us) as f64 + 1.0;
    for (t, on) in events.t.iter().zip(events.on) {
        let block = ((t - first_us) as f64 / length * N_BLOCKS as f64) as usize;
        blocks[usize::from(!on)][block.min(N_BLOCKS - 1)] += 1;
    }
    let [on_hz, off_hz] = blocks.map(|blocks| rate(&blocks, duration_s));
    let mut longest_gap_us = 0;
    events.t.windows(2).for_each(|pair| longest_gap_us = longest_gap_us.max(pair[1] - pair[0]));
    StreamRates {
        first_us,
        last_us,
        duration_s,
        on_hz,
        off_hz,
        per_pixel_hz: events.len() as f64 / (duration_s * n_pixels as f64).max(f64::MIN_POSITIVE),
        gaps: gaps(events.t),
        longest_gap_us,
    }
}

fn rate(blocks: &[u64; N_BLOCKS], duration_s: f64) -> Estimate {
    let n: u64 = blocks.iter().sum();
    if duration_s <= 0.0 {
        return Estimate::unknown();
    }
    let mut moments = Moments::default();
    blocks.iter().for_each(|n| moments.push(*n as f64));
    let scatter = moments.standard_error() * N_BLOCKS as f64;
    let error = scatter.max((n as f64).sqrt());
    Estimate::normal(n as f64 / duration_s, error / duration_s, n)
}

/// Gaps longer than the rate about them explains.
fn gaps(t: &[i64]) -> Vec<SensorGap> {
    let n = t.len().saturating_sub(1) as f64;
    let mut found: Vec<SensorGap> = Vec::new();
    for (i, pair) in t.windows(2).enumerate() {
        let length_us = pair[1] - pair[0];
        let [from, to] = [i.saturating_sub(GAP_CONTEXT), (i + 1 + GAP_CONTEXT).min(t.len() - 1)];
        let about_us = (t[to] - t[from] - length_us) as f64;
        let n_about = (to - from - 1) as f64;
        let is_at_an_end = (i - from).min(to - i - 1) < GAP_CONTEXT / 2;
        // Most intervals are short; this spares the probability.
        if is_at_an_end || length_us as f64 * n_about < 10.0 * about_us {
            continue;
        }
        // The rate of the sparser side: activity that begins or ends is no gap.
        let sides = [(t[i] - t[from], i - from), (t[to] - t[i + 1], to - i - 1)];
        let means = sides.map(|(us, n)| us as f64 / n.max(1) as f64);
        let mean_interval_us = means[0].max(means[1]);
        // The interval is exponential, its mean known from as many events as the context has.
        let m = GAP_CONTEXT as f64;
        let ratio = length_us as f64 / (mean_interval_us.max(1e-3) * m);
        let false_alarm_probability = (n * (-m * ratio.ln_1p()).exp()).min(1.0);
        if false_alarm_probability <= LEVEL {
            let begin_us = pair[0];
            found.push(SensorGap {
                begin_us,
                length_us,
                mean_interval_us,
                false_alarm_probability,
            });
        }
    }
    found.sort_by_key(|gap| std::cmp::Reverse(gap.length_us));
    found.truncate(MAX_GAPS);
    found
}
