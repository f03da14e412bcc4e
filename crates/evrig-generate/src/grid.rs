//! What all generators share: frames are checked, pixels worked on in blocks by several
//! threads, and their events put in order.

use super::merge::{Crossing, EventMerger};
use super::sequence::{FrameSequence, FrameSpan};
use super::threads::Threads;
use crate::generator::{GenerateError, Generator};
use crate::parameter_error::ParameterError;
use evrig_core::event::Events;
use evrig_core::frame::Luminance;
use evrig_core::geometry::Size;
use std::num::NonZeroUsize;

/// Pixels of a block: what one thread takes at a time. Results do not depend on it.
const BLOCK_PIXELS: usize = 4096;

/// The most events a pixel may be expected to fire between two frames; more is a slip of unit.
const MAX_EVENTS_PER_INTERVAL: f64 = 1_000.0;

/// A model of a pixel that sees brightness at the ends of an interval.
pub(super) trait FramePixelModel: Send + Sync {
    /// The model's name on the command line.
    const NAME: &'static str;

    /// What is kept of a block's pixels from frame to frame.
    type State: Send;

    /// A number of events that no pixel's mean exceeds in an interval.
    fn max_mean_events(&self, interval: FrameSpan) -> f64;

    /// The pixels from row-major number `first` on, which see `brightness` in the first frame.
    fn start(&self, first: u32, brightness: &[f32]) -> Self::State;

    /// Lets pixel number `i` of a block begin anew with what the last frame showed it.
    fn restart(&self, block: &mut PixelBlock<Self::State>, i: usize);

    /// Moves a block's pixels through an interval.
    fn run(&self, block: &mut PixelBlock<Self::State>, after: &[f32], interval: FrameSpan);
}

/// A run of pixels.
#[derive(Debug)]
pub(super) struct PixelBlock<S> {
    /// Row-major number of the first.
    pub(super) first: u32,
    /// Brightness in the frame at the interval's start.
    pub(super) before: Vec<f32>,
    /// Where events of the interval go: each pixel's in ascending time.
    pub(super) hits: Vec<Crossing>,
    /// What the model keeps.
    pub(super) state: S,
}

/// A generator that works pixel by pixel.
#[derive(Debug)]
pub(super) struct PixelGrid<M: FramePixelModel> {
    model: M,
    threads: Threads,
    sequence: FrameSequence,
    blocks: Vec<PixelBlock<M::State>>,
    block_pixels: usize,
    merger: EventMerger,
}

impl<M: FramePixelModel> PixelGrid<M> {
    /// A generator for any number of pixels; the first frame sets the size.
    pub(super) fn new(model: M, threads: Option<NonZeroUsize>) -> Result<Self, ParameterError> {
        Ok(Self {
            model,
            threads: Threads::new(threads)?,
            sequence: FrameSequence::default(),
            blocks: Vec::new(),
            block_pixels: BLOCK_PIXELS,
            merger: EventMerger::default(),
        })
    }

    /// The same generator with blocks of another size.
    #[cfg(test)]
    pub(super) fn with_block_pixels(self, block_pixels: usize) -> Self {
        Self { block_pixels, ..self }
    }

    /// The state of all blocks.
    #[cfg(test)]
    pub(super) fn states(&self) -> impl Iterator<Item = &M::State> {
        self.blocks.iter().map(|block| &block.state)
    }

    fn start(&mut self, brightness: &[f32]) {
        let parts = brightness.chunks(self.block_pixels).enumerate();
        let blocks = parts.map(|(number, part)| {
            let first = (number * self.block_pixels) as u32;
            let state = self.model.start(first, part);
            PixelBlock { first, before: part.to_vec(), hits: Vec::new(), state }
        });
        self.blocks = blocks.collect();
    }

    fn run(&mut self, interval: FrameSpan, after: &[f32], size: Size, out: &mut Events) {
        let parts = self.blocks.iter_mut().zip(after.chunks(self.block_pixels)).collect();
        let model = &self.model;
        self.threads.for_each(parts, |(block, after): (&mut PixelBlock<M::State>, &[f32])| {
            block.hits.clear();
            model.run(block, after, interval);
            block.before.copy_from_slice(after);
        });
        let hits = self.blocks.iter().map(|block| block.hits.as_slice());
        self.merger.merge(hits, size, interval, out);
    }

    fn check_rate(&self, interval: FrameSpan) -> Result<(), GenerateError> {
        let expected = self.model.max_mean_events(interval);
        if expected <= MAX_EVENTS_PER_INTERVAL {
            return Ok(());
        }
        let FrameSpan { index, span_us, .. } = interval;
        Err(GenerateError::TooManyEvents {
            index,
            span_us,
            expected,
            limit: MAX_EVENTS_PER_INTERVAL,
        })
    }
}

impl<M: FramePixelModel> Generator for PixelGrid<M> {
    fn name(&self) -> &'static str {
        M::NAME
    }

    fn push(&mut self, frame: &Luminance, out: &mut Events) -> Result<(), GenerateError> {
        let checked = self.sequence.check(frame)?;
        match checked.interval {
            None => self.start(&frame.values),
            Some(interval) => {
                self.check_rate(interval)?;
                self.run(interval, &frame.values, frame.size, out);
            }
        }
        self.sequence.accept(checked);
        Ok(())
    }

    fn restart(&mut self, pixels: &[u32]) {
        for &pixel in pixels {
            let (block, i) =
                (pixel as usize / self.block_pixels, pixel as usize % self.block_pixels);
            if let Some(block) = self.blocks.get_mut(block).filter(|block| i < block.before.len()) {
                self.model.restart(block, i);
            }
        }
    }
}

/// Centre of the pixel of a row-major number; pixel `i` covers `i..i + 1`.
pub(super) fn pixel_centre(size: Size, pixel: usize) -> [f64; 2] {
    let width = usize::from(size.width).max(1);
    [(pixel % width) as f64 + 0.5, (pixel / width) as f64 + 0.5]
}
