//! The paper's event model: a pixel's voltage is a Brownian motion whose drift and
//! diffusion follow the brightness (Lin et al., DVS-Voltmeter, ECCV 2022; Raw2Event).
//!
//! Between two frames dV = μ dt + σ dW with [`Coefficients::motion`]'s μ and σ; V fires
//! On at +1, Off at −1, restarts at 0 and is carried from frame to frame.

pub mod closed_form;
mod coefficients;
mod passage;
mod reference;

pub use coefficients::{Coefficients, Motion};

use super::merge::{Hit, Merger};
use super::random::{Draws, Purpose, Source};
use super::sequence::{Interval, Sequence};
use super::threads::Threads;
use super::{GenerateError, Generator, Law, ParameterError};
use crate::event::Events;
use crate::frame::Luminance;
use std::num::NonZeroUsize;

/// Pixels of a block: what one thread takes at a time. Results do not depend on it.
const BLOCK_PIXELS: usize = 4096;

/// The most events a pixel may be expected to fire between two frames; more is a slip of unit.
const MAX_EVENTS_PER_INTERVAL: f64 = 1_000.0;

/// The event model, one pixel after another in f64.
///
/// With [`Law::Exact`] it is the plain form of the law, which faster forms are tested against.
#[derive(Debug)]
pub struct ScalarVoltmeter {
    k: Coefficients,
    law: Law,
    source: Source,
    threads: Threads,
    sequence: Sequence,
    /// Brightness of the frame before.
    before: Vec<f32>,
    /// Voltage of each pixel, in −1..1.
    voltage: Vec<f64>,
    /// Hits of the interval, block by block.
    hits: Vec<Vec<Hit>>,
    merger: Merger,
}

/// A run of pixels that one thread works on.
struct Block<'a> {
    /// Row-major number of the first.
    first: u32,
    before: &'a mut [f32],
    after: &'a [f32],
    voltage: &'a mut [f64],
    hits: &'a mut Vec<Hit>,
}

impl ScalarVoltmeter {
    /// A generator for any number of pixels; the first frame sets the size.
    ///
    /// # Errors
    /// [`ParameterError::Threads`] when the threads cannot be started.
    pub fn new(
        k: Coefficients,
        law: Law,
        seed: u64,
        threads: Option<NonZeroUsize>,
    ) -> Result<Self, ParameterError> {
        Ok(Self {
            k,
            law,
            source: Source::new(seed),
            threads: Threads::new(threads)?,
            sequence: Sequence::default(),
            before: Vec::new(),
            voltage: Vec::new(),
            hits: Vec::new(),
            merger: Merger::default(),
        })
    }

    fn blocks<'a>(&'a mut self, after: &'a [f32]) -> (&'a Threads, Vec<Block<'a>>) {
        let before = self.before.chunks_mut(BLOCK_PIXELS);
        let after = after.chunks(BLOCK_PIXELS);
        let voltage = self.voltage.chunks_mut(BLOCK_PIXELS);
        let parts = before.zip(after).zip(voltage).zip(&mut self.hits).enumerate();
        let blocks = parts.map(|(number, (((before, after), voltage), hits))| Block {
            first: (number * BLOCK_PIXELS) as u32,
            before,
            after,
            voltage,
            hits,
        });
        (&self.threads, blocks.collect())
    }

    fn run(&mut self, interval: Interval, after: &[f32]) {
        let (k, law, source) = (self.k, self.law, self.source);
        let (threads, blocks) = self.blocks(after);
        threads.for_each(blocks, |block| match law {
            Law::Exact => block.run(&k, source, interval, passage::advance),
            Law::Reference => block.run(&k, source, interval, reference::advance),
        });
    }
}

impl Block<'_> {
    fn run(
        self,
        k: &Coefficients,
        source: Source,
        interval: Interval,
        advance: impl Fn(f64, Motion, f64, &mut Draws, &mut dyn FnMut(f64, bool)) -> f64,
    ) {
        self.hits.clear();
        let span_us = f64::from(interval.span_us);
        for (i, (before, after)) in self.before.iter_mut().zip(self.after).enumerate() {
            let pixel = self.first + i as u32;
            let motion = k.motion(*before, *after, span_us);
            let mut draws = source.draws(pixel, Purpose::Interval(interval.index));
            let mut fire = |t, on| self.hits.push(Hit::new(pixel, t, interval.span_us, on));
            self.voltage[i] = advance(self.voltage[i], motion, span_us, &mut draws, &mut fire);
            *before = *after;
        }
    }
}

impl Generator for ScalarVoltmeter {
    fn name(&self) -> &'static str {
        "voltmeter"
    }

    fn push(&mut self, frame: &Luminance, out: &mut Events) -> Result<(), GenerateError> {
        let checked = self.sequence.check(frame)?;
        if let Some(interval) = checked.interval {
            check_rate(&self.k, interval)?;
            self.run(interval, &frame.values);
            let blocks = self.hits.iter().map(Vec::as_slice);
            self.merger.merge(blocks, frame.size, interval, out);
        } else {
            self.before.clone_from(&frame.values);
            self.voltage = vec![0.0; frame.values.len()];
            self.hits.resize_with(frame.values.len().div_ceil(BLOCK_PIXELS), Vec::new);
        }
        self.sequence.accept(checked);
        Ok(())
    }
}

/// Refuses an interval in which the k would let a pixel fire without bound.
fn check_rate(k: &Coefficients, interval: Interval) -> Result<(), GenerateError> {
    let expected = k.most_events(f64::from(interval.brightest), f64::from(interval.span_us));
    if expected <= MAX_EVENTS_PER_INTERVAL {
        return Ok(());
    }
    Err(GenerateError::TooManyEvents {
        index: interval.index,
        span_us: interval.span_us,
        expected,
        limit: MAX_EVENTS_PER_INTERVAL,
    })
}

#[cfg(test)]
mod tests;
