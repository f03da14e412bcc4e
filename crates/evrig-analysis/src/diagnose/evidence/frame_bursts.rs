//! Bursts of events that follow the camera's own frames, as a hazard of every row.

use crate::camera_report::{CouplingBurst, FrameCoupling, PolarityName, ProfileBin};
use crate::diagnose::levels::NEGLIGIBLE_NATS_PER_EVENT;
use crate::diagnose::{ConfidenceInterval, Departure};
use crate::predict::BurstWindow;
use evrig_core::effect_id::EffectId;
use evrig_core::geometry::Size;
use evrig_core::stats::Estimate;
use std::sync::Arc;

/// The bursts of a recording.
#[derive(Debug, Clone)]
pub(crate) struct FrameBursts {
    found: FrameCoupling,
    /// Events of a pixel per frame, of each burst.
    shares: Vec<f64>,
    /// Windows of each row, by their starts.
    rows: Vec<Arc<[BurstWindow]>>,
}

/// A part of a burst about its line: ends in microseconds, and events of a pixel per frame.
struct BurstPart {
    from_us: f64,
    to_us: f64,
    n: f64,
}

impl FrameBursts {
    /// From frames that start at `starts_us` since the window's start; `None` without a burst that
    /// can change the log-likelihood by more than is neglected.
    pub(crate) fn new(mut found: FrameCoupling, starts_us: &[i64], size: Size) -> Option<Self> {
        let n_events = found.n_events.iter().sum::<u64>() as f64;
        found.bursts.retain(|burst| excess_nats(burst) > NEGLIGIBLE_NATS_PER_EVENT * n_events);
        if found.bursts.is_empty() {
            return None;
        }
        let chances = found.n_frames as f64 * size.n_pixels() as f64;
        let parts: Vec<Vec<BurstPart>> =
            found.bursts.iter().map(|burst| parts(burst, chances)).collect();
        let shares = parts.iter().map(|parts| parts.iter().map(|part| part.n).sum()).collect();
        let rows = (0..size.height).map(|y| row(&found.bursts, &parts, starts_us, y)).collect();
        Some(Self { found, shares, rows })
    }

    pub(crate) fn of_row(&self, y: u16) -> Arc<[BurstWindow]> {
        self.rows.get(usize::from(y)).cloned().unwrap_or_default()
    }

    /// The effect.
    pub(crate) fn departure(&self) -> Departure {
        Departure {
            id: EffectId::ApsCoupling,
            parameters: self.estimates(),
            description: self.description(),
            z: self.z(),
            without: None,
        }
    }

    /// Standard scores of the most significant burst.
    pub(crate) fn z(&self) -> f64 {
        self.found.bursts.iter().map(|burst| burst.z).fold(0.0, f64::max)
    }

    /// Share of the pixels that fire after a frame's start, and the line of the largest burst, with
    /// standard errors.
    fn estimates(&self) -> Vec<(&'static str, [f64; 2])> {
        let bursts = self.found.bursts.iter().zip(&self.shares);
        let Some((burst, _)) = bursts.max_by(|a, b| a.1.total_cmp(b.1)) else { return Vec::new() };
        let fraction: f64 = self.shares.iter().sum();
        let relative = burst.share.standard_error / burst.share.value;
        // Events of a burst wait for each other at the readout, in an order that is not known.
        let queue_us = burst.width_us.value / 12.0_f64.sqrt();
        let row_queue_us = queue_us / self.rows.len() as f64;
        let of = |estimate: &Estimate, queue_us: f64| {
            [estimate.value, estimate.standard_error.hypot(queue_us)]
        };
        vec![
            ("events_fraction", [fraction, relative * fraction]),
            ("delay_us", of(&burst.delay_us, queue_us)),
            ("row_us", of(&burst.row_us, row_queue_us)),
        ]
    }

    /// The same with 90 % intervals.
    pub(crate) fn parameters(&self) -> Vec<(&'static str, ConfidenceInterval)> {
        let estimates = self.estimates().into_iter();
        estimates.map(|(key, estimate)| (key, ConfidenceInterval::normal(estimate))).collect()
    }

    fn description(&self) -> String {
        let one = |burst: &CouplingBurst| {
            format!(
                "{:.2} % of the {} events {:.0} us after a frame's start (row 0) plus {:.2} us \
                 per row, within {:.0} us",
                100.0 * burst.share.value,
                burst.polarity,
                burst.delay_us.value,
                burst.row_us.value,
                burst.width_us.value
            )
        };
        let all: Vec<String> = self.found.bursts.iter().map(one).collect();
        format!("bursts follow the camera's own frames: {}", all.join("; "))
    }
}

/// Events of a burst's polarity in the bins of its profile that hold it, and in a bin before it.
fn counts(burst: &CouplingBurst) -> (Vec<(ProfileBin, f64)>, f64) {
    let [low, high] = burst.window_us;
    let count = |bin: &ProfileBin| match burst.polarity {
        PolarityName::On => bin.n_on as f64,
        PolarityName::Off => bin.n_off as f64,
    };
    let before: Vec<f64> = burst.profile.iter().filter(|bin| bin.to_us <= low).map(count).collect();
    let background = before.iter().sum::<f64>() / before.len().max(1) as f64;
    let inside = burst.profile.iter().filter(|bin| bin.to_us > low && bin.from_us < high);
    (inside.map(|bin| (*bin, count(bin))).collect(), background)
}

/// Log-likelihood of a burst's events over that under the rate before it.
fn excess_nats(burst: &CouplingBurst) -> f64 {
    let (inside, background) = counts(burst);
    // Half an event stands for none.
    let b = background.max(0.5);
    inside.iter().filter(|(_, n)| *n > b).map(|(_, n)| n * (n / b).ln() - (n - b)).sum()
}

/// The excess of a burst's polarity over the rate before it, in the bins of its profile.
fn parts(burst: &CouplingBurst, chances: f64) -> Vec<BurstPart> {
    let (inside, background) = counts(burst);
    inside
        .into_iter()
        .map(|(bin, n)| BurstPart {
            from_us: bin.from_us,
            to_us: bin.to_us,
            n: (n - background).max(0.0) / chances,
        })
        .filter(|part| part.n > 0.0)
        .collect()
}

fn row(
    bursts: &[CouplingBurst],
    parts: &[Vec<BurstPart>],
    starts_us: &[i64],
    y: u16,
) -> Arc<[BurstWindow]> {
    let mut windows = Vec::new();
    for (burst, parts) in bursts.iter().zip(parts) {
        let line_us = burst.delay_us.value + burst.row_us.value * f64::from(y);
        let side = usize::from(burst.polarity == PolarityName::Off);
        for (start_us, part) in starts_us.iter().flat_map(|s| parts.iter().map(move |p| (*s, p))) {
            let about_us = start_us as f64 + line_us;
            let mut hz = [0.0; 2];
            hz[side] = 1e6 * part.n / (part.to_us - part.from_us);
            windows.push(BurstWindow {
                from_us: about_us + part.from_us,
                to_us: about_us + part.to_us,
                hz,
            });
        }
    }
    windows.sort_by(|a, b| a.from_us.total_cmp(&b.from_us));
    windows.into()
}
