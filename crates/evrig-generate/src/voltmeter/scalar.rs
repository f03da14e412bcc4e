//! The event model, one pixel after another in f64: the plain form of the law.

use super::{Coefficients, passage, reference};
use crate::Law;
use crate::grid::{Block, PixelModel};
use crate::merge::Hit;
use crate::random::Source;
use crate::sequence::Interval;

/// The event model with every pixel's voltage drawn at every frame.
#[derive(Debug)]
pub(crate) struct ScalarVoltmeter {
    k: Coefficients,
    law: Law,
    source: Source,
}

impl ScalarVoltmeter {
    pub(crate) fn new(k: Coefficients, law: Law, seed: u64) -> Self {
        Self { k, law, source: Source::new(seed) }
    }
}

impl PixelModel for ScalarVoltmeter {
    const NAME: &'static str = "voltmeter";

    /// Voltage of each pixel, in −1..1.
    type State = Vec<f64>;

    fn most_events(&self, interval: Interval) -> f64 {
        self.k.most_events(interval)
    }

    fn start(&self, _first: u32, brightness: &[f32]) -> Vec<f64> {
        vec![0.0; brightness.len()]
    }

    fn restart(&self, block: &mut Block<Vec<f64>>, i: usize) {
        block.state[i] = 0.0;
    }

    fn run(&self, block: &mut Block<Vec<f64>>, after: &[f32], interval: Interval) {
        let advance = match self.law {
            Law::Exact => passage::advance,
            Law::Reference => reference::advance,
        };
        let span_us = f64::from(interval.span_us);
        for (i, (&before, &after)) in block.before.iter().zip(after).enumerate() {
            let pixel = block.first + i as u32;
            let motion = self.k.motion(before, after, span_us);
            let mut draws = self.source.draws(pixel, interval.index);
            let mut fire = |t, on| block.hits.push(Hit::new(pixel, t, interval.span_us, on));
            block.state[i] = advance(block.state[i], motion, span_us, &mut draws, &mut fire);
        }
    }
}
