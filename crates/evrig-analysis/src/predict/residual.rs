//! What the prediction leaves over, event by event and silence by silence.
//!
//! This is the record that locating a mismatch works on: every event's innovation with what it may
//! depend on, and the expected counts of every cell of time beside the counts that came.

use super::{Blocks, EventTerm, Light, PixelLaw, Spike, Stretch, Witness, walk};

/// A pixel's event before this one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Previous {
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
    /// Its polarity.
    pub on: bool,
    /// By how much the light had changed beyond the threshold when it came, in thresholds:
    /// above 0 the event is late, below 0 early. `None` for a first event.
    pub innovation: Option<f64>,
    /// Logarithm of its predicted hazard, a second.
    pub log_hazard: f64,
    /// The part of that hazard which is background, 0 to 1.
    pub background_share: f64,
    /// The compensator of the silence before it: exponential of mean one under a true law.
    pub spent: f64,
    /// Speed of the light in the event's direction, log intensity a second.
    pub slope_per_s: f64,
    /// Log intensity over white.
    pub level: f64,
    /// The pixel's event before it, inside the window.
    pub previous: Option<Previous>,
}

/// Counts of one pixel in one block of time.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Silence {
    /// Seconds of known light.
    pub seconds: f64,
    /// Expected On events.
    pub expected_on: f64,
    /// Expected Off events.
    pub expected_off: f64,
    /// On events that came.
    pub on: u32,
    /// Off events that came.
    pub off: u32,
}

struct Recorder<'a> {
    law: &'a PixelLaw,
    place: (u16, u16),
    spikes: &'a [Spike],
    residuals: Vec<Residual>,
    cells: Vec<Silence>,
}

impl Witness for Recorder<'_> {
    fn silence(&mut self, stretch: &Stretch) {
        let cell = &mut self.cells[stretch.block];
        cell.seconds += (stretch.to_us - stretch.from_us) * 1e-6;
        cell.expected_on += stretch.on;
        cell.expected_off += stretch.off;
    }

    fn event(&mut self, term: &EventTerm) {
        let Spike { t_us, on } = term.spike;
        let cell = &mut self.cells[term.block];
        *(if on { &mut cell.on } else { &mut cell.off }) += 1;
        let before = term.index.checked_sub(1).map(|index| self.spikes[index]);
        let previous = before.map(|b| Previous { ago_s: (t_us - b.t_us) as f64 * 1e-6, on: b.on });
        self.residuals.push(Residual {
            x: self.place.0,
            y: self.place.1,
            t_us,
            on,
            innovation: term.change.map(|change| change / self.law.theta(on) - 1.0),
            log_hazard: term.log_hazard,
            background_share: term.background_share,
            spent: term.spent,
            slope_per_s: term.slope_per_s,
            level: term.level,
            previous,
        });
    }
}

/// The residuals of one pixel's events in the order of time, and its counts in each block.
#[must_use]
pub fn residuals(
    law: &PixelLaw,
    light: Light<'_>,
    place: (u16, u16),
    spikes: &[Spike],
    blocks: &Blocks,
) -> (Vec<Residual>, Vec<Silence>) {
    let cells = vec![Silence::default(); blocks.n()];
    let mut recorder = Recorder { law, place, spikes, residuals: Vec::new(), cells };
    walk(law, light, spikes, blocks, &mut recorder);
    (recorder.residuals, recorder.cells)
}
