//! Residuals of the prediction: each event with its innovation and covariates, and expected and
//! observed counts of each time block.

use super::likelihood::{EventTerm, LikelihoodVisitor, SilentInterval, visit};
use super::pixel_events::Spike;
use super::pixel_law::PixelLaw;
use super::pixel_signal::PixelSignal;
use super::time_blocks::TimeBlocks;

/// The pixel's event before an event.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PreviousEvent {
    /// Time since it, seconds.
    pub ago_s: f64,
    /// Its polarity.
    pub on: bool,
}

/// One event against its prediction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Residual {
    /// Pixel column.
    pub x: u16,
    /// Pixel row.
    pub y: u16,
    /// Microseconds since the start of the window.
    pub t_us: i64,
    /// Polarity.
    pub on: bool,
    /// Change of the signal beyond the threshold at the event, in thresholds: positive for a late
    /// event, negative for an early one. `None` for a first event.
    pub innovation: Option<f64>,
    /// Logarithm of the predicted hazard, per second.
    pub log_hazard: f64,
    /// Share of background in that hazard, 0 to 1.
    pub background_share: f64,
    /// Compensator since the event before: exponential with mean 1 under the true parameters.
    pub compensator: f64,
    /// Slope of the signal towards the event's polarity, log intensity per second.
    pub slope_per_s: f64,
    /// Log intensity relative to white.
    pub level: f64,
    /// The pixel's event before, inside the window.
    pub previous: Option<PreviousEvent>,
}

/// Counts of one pixel in one time block.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct BlockCounts {
    /// Seconds of known signal.
    pub seconds: f64,
    /// Expected ON events.
    pub expected_on: f64,
    /// Expected OFF events.
    pub expected_off: f64,
    /// Observed ON events.
    pub on: u32,
    /// Observed OFF events.
    pub off: u32,
}

struct ResidualRecorder<'a> {
    law: &'a PixelLaw,
    pixel: (u16, u16),
    spikes: &'a [Spike],
    residuals: Vec<Residual>,
    counts: Vec<BlockCounts>,
}

impl LikelihoodVisitor for ResidualRecorder<'_> {
    fn silence(&mut self, interval: &SilentInterval) {
        let counts = &mut self.counts[interval.block];
        counts.seconds += (interval.to_us - interval.from_us) * 1e-6;
        counts.expected_on += interval.on;
        counts.expected_off += interval.off;
    }

    fn event(&mut self, term: &EventTerm) {
        let Spike { t_us, on } = term.spike;
        let counts = &mut self.counts[term.block];
        *(if on { &mut counts.on } else { &mut counts.off }) += 1;
        let before = term.index.checked_sub(1).map(|index| self.spikes[index]);
        let previous =
            before.map(|b| PreviousEvent { ago_s: (t_us - b.t_us) as f64 * 1e-6, on: b.on });
        self.residuals.push(Residual {
            x: self.pixel.0,
            y: self.pixel.1,
            t_us,
            on,
            innovation: term.change.map(|change| change / self.law.theta(on) - 1.0),
            log_hazard: term.log_hazard,
            background_share: term.background_share,
            compensator: term.compensator,
            slope_per_s: term.slope_per_s,
            level: term.level,
            previous,
        });
    }
}

/// Residuals of one pixel's events in order of time, and its counts in each block.
#[must_use]
pub fn residuals(
    law: &PixelLaw,
    signal: PixelSignal<'_>,
    pixel: (u16, u16),
    spikes: &[Spike],
    blocks: &TimeBlocks,
) -> (Vec<Residual>, Vec<BlockCounts>) {
    let counts = vec![BlockCounts::default(); blocks.n()];
    let mut recorder = ResidualRecorder { law, pixel, spikes, residuals: Vec::new(), counts };
    visit(law, signal, spikes, blocks, &mut recorder);
    (recorder.residuals, recorder.counts)
}
