//! A pixel as a model predicts it.

use crate::diagnose::PixelEvidence;
use crate::predict::law::ComparatorLaw;
use crate::predict::signal::SampledSignal;

/// A pixel on its way through the stages.
#[derive(Debug)]
pub(crate) struct ModelledPixel<'a> {
    pub(crate) pixel: &'a PixelEvidence,
    pub(crate) y: u16,
    pub(crate) middle: [f64; 2],
    pub(crate) signal: Vec<f64>,
    pub(crate) start_us: f64,
    pub(crate) step_us: f64,
    pub(crate) law: ComparatorLaw,
    pub(crate) darkness: Vec<f64>,
}

impl ModelledPixel<'_> {
    pub(crate) fn sampled(&self) -> SampledSignal<'_> {
        SampledSignal {
            start_us: self.start_us,
            step_us: self.step_us,
            signal: &self.signal,
            level: &self.pixel.light,
            darkness: &self.darkness,
            bursts: if self.law.burst_factor > 0.0 { &self.pixel.bursts } else { &[] },
        }
    }
}
