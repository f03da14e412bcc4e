//! Physical effects of an event camera and of the frames its input is made from.
//!
//! An effect acts at one stage of the signal path ([`SignalStage`]). Those before the comparator
//! change a pixel's log-intensity signal; those of the comparator change its
//! [`PixelModel`](crate::forward::PixelModel); those behind it change the events. An effect of the
//! frame camera is an error of the frames, so here it is inverted: a generator with `tone_curve`
//! undoes the curve and makes the events of the true intensity.
//!
//! Parameters have the keys of
//! [`EffectId::parameters`](evrig_core::effect_id::EffectId::parameters); further parameters have
//! defaults.

mod error;
#[macro_use]
mod model;
mod library;
mod low_pass;
mod pixel_site;
mod region;
mod set;
#[cfg(test)]
mod test_support;

pub use error::EffectError;
pub use library::*;
pub use model::{EffectDescription, EffectModel, EffectParameter, ReadoutContext, SignalStage};
pub use pixel_site::{PixelSite, RecordingContext, SiteSignal};
pub use region::Region;
pub use set::{AppliedEffect, EffectSet};
