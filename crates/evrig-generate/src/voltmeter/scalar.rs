//! The event model, one pixel after another in f64: the plain form of the law.

use super::coefficients::Coefficients;
use super::law::VoltmeterLaw;
use super::{passage, reference};
use crate::grid::{FramePixelModel, PixelBlock};
use crate::merge::Crossing;
use crate::random::RandomSource;
use crate::sequence::FrameSpan;

/// The event model with every pixel's voltage drawn at every frame.
#[derive(Debug)]
pub(crate) struct ScalarVoltmeter {
    k: Coefficients,
    law: VoltmeterLaw,
    source: RandomSource,
}

impl ScalarVoltmeter {
    pub(crate) fn new(k: Coefficients, law: VoltmeterLaw, seed: u64) -> Self {
        Self { k, law, source: RandomSource::new(seed) }
    }
}

impl FramePixelModel for ScalarVoltmeter {
    const NAME: &'static str = "voltmeter";

    /// Voltage of each pixel, in −1..1.
    type State = Vec<f64>;

    fn max_mean_events(&self, interval: FrameSpan) -> f64 {
        self.k.max_mean_events(interval)
    }

    fn start(&self, _first: u32, brightness: &[f32]) -> Vec<f64> {
        vec![0.0; brightness.len()]
    }

    fn restart(&self, block: &mut PixelBlock<Vec<f64>>, i: usize) {
        block.state[i] = 0.0;
    }

    fn run(&self, block: &mut PixelBlock<Vec<f64>>, after: &[f32], interval: FrameSpan) {
        let advance = match self.law {
            VoltmeterLaw::Exact => passage::advance,
            VoltmeterLaw::Reference => reference::advance,
        };
        let span_us = f64::from(interval.span_us);
        for (i, (&before, &after)) in block.before.iter().zip(after).enumerate() {
            let pixel = block.first + i as u32;
            let motion = self.k.motion(before, after, span_us);
            let mut draws = self.source.draws(pixel, interval.index);
            let mut fire = |t, on| block.hits.push(Crossing::new(pixel, t, interval.span_us, on));
            block.state[i] = advance(block.state[i], motion, span_us, &mut draws, &mut fire);
        }
    }
}
